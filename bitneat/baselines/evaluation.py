# SPDX-License-Identifier: MIT
"""The score of a float network on the walker: the same protocol as for controllers, in the native simulator.

Episodes are walked side by side, but every signal is computed by the same operations in the same order as in
`FloatNetwork.step`, so that the rewards are those of one episode after the other in Gymnasium, to the bit.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.network import ACTIVATIONS, FloatNetwork, FloatNode, decode
from bitneat.sim.walker.episodes import ACTION
from bitneat.sim.walker.rollout import Policy, run_policy
from bitneat.sim.walker.vector import step_limit

SOLVED = 300.0
"""An episode's reward from which on it counts as solved."""

Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HeldOut:
    """Official rewards over episodes that nothing was chosen on."""

    episodes: int
    mean: float
    std: float
    """Of the episodes, not of their mean."""
    min: float
    max: float
    solved: float
    """Part of the episodes with `SOLVED` or more."""

    @classmethod
    def of(cls, rewards: Sequence[float]) -> HeldOut:
        """The score of some episodes, at least one."""
        return cls(
            len(rewards),
            statistics.fmean(rewards),
            statistics.pstdev(rewards),
            min(rewards),
            max(rewards),
            sum(reward >= SOLVED for reward in rewards) / len(rewards),
        )

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {name: getattr(self, name) for name in ("episodes", "mean", "std", "min", "max", "solved")}


def network_policy(network: FloatNetwork, table: npt.NDArray[np.float32] | None = None) -> Policy:
    """What the network does: its outputs decoded as the walker's action, or the row of ``table`` with the largest output."""
    forward = batched(network)

    def act(which: npt.NDArray[np.int32], observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        outputs = forward(observations)
        if table is not None:
            chosen: npt.NDArray[np.float32] = table[outputs.argmax(axis=1)]
            return chosen
        return np.array([decode(ACTION, row) for row in outputs], np.float32)

    return act


def batched(network: FloatNetwork, *, exact: bool = True) -> Callable[[npt.NDArray[Any]], Doubles]:
    """A function from observations (n, inputs) to outputs (n, outputs), each row of which is `FloatNetwork.step`'s.

    Args:
        network: which.
        exact: to the bit. If not, it is some twenty times as fast and may differ in the last bits.
    """
    blocks = [_Block(network.num_inputs, nodes) for nodes in _alike(network)]
    functions: dict[str, Callable[[Doubles], Doubles]] = {
        name: np.vectorize(function, otypes=[float]) if exact else _NUMPY[name]
        for name, function in ACTIVATIONS.items()
    }
    functions["identity"] = _same

    def forward(observations: npt.NDArray[Any]) -> Doubles:
        signals = np.empty((network.num_inputs + len(network.nodes), len(observations)))
        signals[: network.num_inputs] = np.asarray(observations, np.float64).T
        for block in blocks:
            if exact:
                total = np.zeros((len(block.bias), len(observations)))
                for source, weights in zip(block.sources, block.weights, strict=True):
                    total += signals[source] * weights
            else:
                total = block.matrix @ signals[block.sources]
            total = block.bias + block.response * total
            signals[block.first : block.first + len(total)] = functions[block.activation](total)
        outputs: Doubles = signals[list(network.outputs)].T
        return outputs

    return forward


def _same(z: Doubles) -> Doubles:
    return z


_NUMPY: dict[str, Callable[[Doubles], Doubles]] = {
    "identity": _same,
    "clamped": lambda z: np.clip(z, -1.0, 1.0),
    "relu": lambda z: np.maximum(z, 0.0),
    "abs": np.abs,
    "hat": lambda z: np.maximum(0.0, 1.0 - np.abs(z)),
    "step": lambda z: np.where(z > 0.0, 1.0, 0.0),
    "tanh": lambda z: np.tanh(np.clip(2.5 * z, -60.0, 60.0)),
    "sigmoid": lambda z: 1.0 / (1.0 + np.exp(-np.clip(5.0 * z, -60.0, 60.0))),
    "sin": lambda z: np.sin(np.clip(5.0 * z, -60.0, 60.0)),
    "gauss": lambda z: np.exp(-5.0 * np.clip(z, -3.4, 3.4) ** 2),
}
"""`bitneat.network.ACTIVATIONS`, on arrays."""


class _Block:
    """Neighbouring nodes that read the same sources in the same order, computed side by side."""

    def __init__(self, num_inputs: int, nodes: Sequence[tuple[int, FloatNode]]) -> None:
        self.first = num_inputs + nodes[0][0]
        self.sources = [source for source, _ in nodes[0][1].links]
        self.weights = [
            np.array([[node.links[place][1]] for _, node in nodes], np.float64) for place in range(len(self.sources))
        ]
        self.matrix = np.array([[weight for _, weight in node.links] for _, node in nodes], np.float64)
        self.bias = np.array([[node.bias] for _, node in nodes], np.float64)
        self.response = np.array([[node.response] for _, node in nodes], np.float64)
        self.activation = nodes[0][1].activation


def _alike(network: FloatNetwork) -> list[list[tuple[int, FloatNode]]]:
    """The nodes with their indices, split where a node reads other sources than the one before it, or has another activation.

    Nodes that read the same sources do not read one another, since a source comes before all its readers.
    """
    key = None
    blocks: list[list[tuple[int, FloatNode]]] = []
    for index, node in enumerate(network.nodes):
        mine = (node.activation, *(source for source, _ in node.links))
        if mine != key:
            blocks.append([])
        blocks[-1].append((index, node))
        key = mine
    return blocks


def score(
    policy: Policy, seeds: Sequence[int], threads: int | None = None, *, hardcore: bool = False
) -> tuple[HeldOut, int]:
    """Walk an episode on every seed: the score, and the steps taken.

    Raises:
        BitneatError: as of `run_policy`.
    """
    rewards, steps = run_policy(policy, seeds, step_limit(hardcore), hardcore=hardcore, threads=threads)
    return HeldOut.of([float(reward) for reward in rewards]), math.floor(steps.sum())
