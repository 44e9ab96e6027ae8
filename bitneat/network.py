# SPDX-License-Identifier: MIT
"""Float networks: what plain NEAT, and trainers with gradients, produce.

A `FloatNetwork` is no controller: nothing here generates C for one. It is there to be compared with controllers in the same
episodes, and to be made one by `bitneat quantize`. It computes what neat-python's ``FeedForwardNetwork`` does with the aggregation
``sum``, in float64 and in a fixed order: the same bits as neat-python's on Python 3.11, given the observation as float64.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from bitneat.controller import Action, BoxAction, Controller
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    import numpy.typing as npt

MAX_NODES = 8000
MAX_LINKS = 1_000_000
MAX_VALUE = 1e12
"""Of weights, biases and responses."""


class NetworkError(BitneatError):
    """A float network is malformed; the message names the field."""


def _identity(z: float) -> float:
    return z


def _clamped(z: float) -> float:
    return max(-1.0, min(1.0, z))


def _relu(z: float) -> float:
    return z if z > 0.0 else 0.0


def _hat(z: float) -> float:
    return max(0.0, 1 - abs(z))


def _step(z: float) -> float:
    return 1.0 if z > 0.0 else 0.0


def _tanh(z: float) -> float:
    return math.tanh(max(-60.0, min(60.0, 2.5 * z)))


def _sigmoid(z: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-60.0, min(60.0, 5.0 * z))))


def _sin(z: float) -> float:
    return math.sin(max(-60.0, min(60.0, 5.0 * z)))


def _gauss(z: float) -> float:
    z = max(-3.4, min(3.4, z))
    return math.exp(-5.0 * (z * z))


ACTIVATIONS: Mapping[str, Callable[[float], float]] = {
    "identity": _identity,
    "clamped": _clamped,
    "relu": _relu,
    "abs": abs,
    "hat": _hat,
    "step": _step,
    "tanh": _tanh,
    "sigmoid": _sigmoid,
    "sin": _sin,
    "gauss": _gauss,
}
"""By name, scaled as neat-python's: tanh(2.5 z), sigmoid(5 z), sin(5 z), exp(-5 z^2). The native walker has the same order."""


@dataclass(frozen=True, slots=True)
class FloatNode:
    """``activation(bias + response * (the sum of weight * source, in the order of the links))``.

    A source below the number of inputs is an input, one from there on a node.
    """

    links: tuple[tuple[int, float], ...]
    """(source, weight) each."""
    bias: float = 0.0
    response: float = 1.0
    activation: str = "clamped"


@dataclass(frozen=True)
class FloatNetwork:
    """A feed-forward network: nodes in topological order, and which of the signals are its outputs.

    Raises:
        NetworkError: if a source or output is not an input or an earlier node, or a number is not finite or beyond `MAX_VALUE`.
    """

    num_inputs: int
    nodes: tuple[FloatNode, ...]
    outputs: tuple[int, ...]

    def __post_init__(self) -> None:
        if type(self.num_inputs) is not int or not 1 <= self.num_inputs <= MAX_NODES:
            raise NetworkError(f"num_inputs: expected an integer from 1 to {MAX_NODES}")
        if len(self.nodes) > MAX_NODES or self.num_links > MAX_LINKS:
            raise NetworkError(f"nodes: expected at most {MAX_NODES} with {MAX_LINKS} links")
        for index, node in enumerate(self.nodes):
            where = f"nodes[{index}]"
            if node.activation not in ACTIVATIONS:
                raise NetworkError(
                    f"{where}.activation: {node.activation!r:.40} is not one of {', '.join(ACTIVATIONS)}"
                )
            known = self.num_inputs + index
            for place, (source, weight) in enumerate(node.links):
                if type(source) is not int or not 0 <= source < known:
                    raise NetworkError(
                        f"{where}.links[{place}]: {source!r:.40} is not an input or an earlier node (0..{known - 1})"
                    )
                _require_number(weight, f"{where}.links[{place}]")
            _require_number(node.bias, f"{where}.bias")
            _require_number(node.response, f"{where}.response")
        if not self.outputs:
            raise NetworkError("outputs: expected at least one")
        known = self.num_inputs + len(self.nodes)
        for place, output in enumerate(self.outputs):
            if type(output) is not int or not 0 <= output < known:
                raise NetworkError(f"outputs[{place}]: {output!r:.40} is not an input or a node (0..{known - 1})")

    @property
    def num_links(self) -> int:
        """Links of all nodes."""
        return sum(len(node.links) for node in self.nodes)

    @property
    def is_recurrent(self) -> bool:
        """Never: a float network has no state."""
        return False

    @cached_property
    def sha256(self) -> str:
        """Of the numeric content."""
        text = json.dumps(self.to_data(), separators=(",", ":"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def used_inputs(self) -> list[int]:
        """The inputs that a node or an output reads."""
        read = {source for node in self.nodes for source, _ in node.links} | set(self.outputs)
        return sorted(source for source in read if source < self.num_inputs)

    def reset(self) -> None:
        """Nothing to forget."""

    def step(self, observation: Sequence[float]) -> list[float]:
        """The outputs, of shape (outputs,), for an observation of shape (inputs,)."""
        signals = [float(value) for value in observation]
        for node in self.nodes:
            total = 0.0
            for source, weight in node.links:
                total += signals[source] * weight
            signals.append(ACTIVATIONS[node.activation](node.bias + node.response * total))
        return [signals[output] for output in self.outputs]

    def to_data(self) -> dict[str, Any]:
        """Plain data that `network_from_data` reads back without loss."""
        return {
            "num_inputs": self.num_inputs,
            "nodes": [
                {
                    "links": [[source, weight] for source, weight in node.links],
                    "bias": node.bias,
                    "response": node.response,
                    "activation": node.activation,
                }
                for node in self.nodes
            ],
            "outputs": list(self.outputs),
        }


Policy = Controller | FloatNetwork
"""What runs in an episode."""


def network_from_data(data: object) -> FloatNetwork:
    """Read what `FloatNetwork.to_data` wrote.

    Raises:
        NetworkError: if a key is missing or unknown, or a value cannot be.
    """
    if not isinstance(data, Mapping) or set(data) != {"num_inputs", "nodes", "outputs"}:
        raise NetworkError("network: expected a mapping with the keys num_inputs, nodes, outputs")
    if not isinstance(data["nodes"], (list, tuple)) or not isinstance(data["outputs"], (list, tuple)):
        raise NetworkError("network: expected lists of nodes and outputs")
    nodes = []
    for index, entry in enumerate(data["nodes"]):
        if not isinstance(entry, Mapping) or set(entry) != {"links", "bias", "response", "activation"}:
            raise NetworkError(f"nodes[{index}]: expected a mapping with the keys links, bias, response, activation")
        links = entry["links"]
        if not isinstance(links, (list, tuple)) or not all(isinstance(e, (list, tuple)) and len(e) == 2 for e in links):
            raise NetworkError(f"nodes[{index}].links: expected a list of pairs")
        if not isinstance(entry["activation"], str):
            raise NetworkError(f"nodes[{index}].activation: expected a name")
        pairs = tuple((source, weight) for source, weight in links)
        nodes.append(FloatNode(pairs, entry["bias"], entry["response"], entry["activation"]))
    return FloatNetwork(data["num_inputs"], tuple(nodes), tuple(data["outputs"]))


def decode(action: Action, outputs: Sequence[float]) -> int | npt.NDArray[Any]:
    """The action for a network's outputs, by the formulas that hold for a controller's, whose outputs stand for y / 2^F."""
    import numpy as np

    values = np.asarray(outputs, dtype=np.float64)
    if not isinstance(action, BoxAction):
        return action.start + int(values.argmax())
    low = np.array(action.low)
    clipped = np.where(values < 1.0, values, 1.0)  # an output that is no number counts as 1
    clipped = np.where(clipped > -1.0, clipped, -1.0)
    scaled = low + (clipped + 1.0) / 2.0 * (np.array(action.high) - low)
    decoded: npt.NDArray[Any] = scaled.astype(action.dtype).reshape(action.shape)
    return decoded


def _require_number(value: object, where: str) -> None:
    if type(value) not in (int, float) or not math.isfinite(value) or abs(value) > MAX_VALUE:  # type: ignore[arg-type]
        raise NetworkError(f"{where}: expected a finite number of at most {MAX_VALUE:g} in size")
