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

from bitneat.network import ACTIVATIONS, FloatNetwork, decode
from bitneat.sim.walker.episodes import ACTION
from bitneat.sim.walker.rollout import Policy, run_policy

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


def batched(network: FloatNetwork) -> Callable[[npt.NDArray[Any]], Doubles]:
    """A function from observations (n, inputs) to outputs (n, outputs), each row of which is `FloatNetwork.step`'s."""
    nodes = []
    for node in network.nodes:
        function = None if node.activation == "identity" else np.vectorize(ACTIVATIONS[node.activation], otypes=[float])
        nodes.append((node, function))

    def forward(observations: npt.NDArray[Any]) -> Doubles:
        count = len(observations)
        signals = np.empty((network.num_inputs + len(nodes), count))
        signals[: network.num_inputs] = np.asarray(observations, np.float64).T
        product = np.empty(count)
        for index, (node, function) in enumerate(nodes, start=network.num_inputs):
            total = np.zeros(count)
            for source, weight in node.links:
                np.multiply(signals[source], weight, out=product)
                total += product
            total = node.bias + node.response * total
            signals[index] = total if function is None else function(total)
        outputs: Doubles = signals[list(network.outputs)].T
        return outputs

    return forward


def score(policy: Policy, seeds: Sequence[int], threads: int | None = None) -> tuple[HeldOut, int]:
    """Walk an episode on every seed: the score, and the steps taken.

    Raises:
        BitneatError: as of `run_policy`.
    """
    rewards, steps = run_policy(policy, seeds, threads=threads)
    return HeldOut.of([float(reward) for reward in rewards]), math.floor(steps.sum())
