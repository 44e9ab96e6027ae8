# SPDX-License-Identifier: MIT
"""A float network as a quantizer sees it: one weight for each source of a node, in terms of input signals; constants evaluated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bitneat.controller import Constant, Input, Output, Signal
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.network import ACTIVATIONS, FloatNetwork
from bitneat.quantize.draft import QuantizeError


@dataclass(frozen=True)
class EffectiveNode:
    """``activation(bias + sum of weight * signal)``."""

    weights: Mapping[int, float]
    """By source, none of them 0."""
    bias: float
    activation: str


class Constants:
    """The nodes that turned out to be constant, because no weight is left of theirs."""

    def __init__(self) -> None:
        self._values: dict[int, float] = {}

    def note(self, index: int, node: EffectiveNode) -> None:
        """A node has no links."""
        self._values[index] = ACTIVATIONS[node.activation](node.bias)

    def outputs(self, outputs: Sequence[int], frac_bits: int) -> list[Output]:
        """The outputs; those that are constant as numbers."""
        return [
            Constant(max(-SIGNAL_MAX, min(SIGNAL_MAX, round(self._values[index] * 2**frac_bits))))
            if index in self._values
            else Signal(index)
            for index in outputs
        ]

    def effective(self, network: FloatNetwork, place: int, inputs: Sequence[Input]) -> EffectiveNode:
        """Node ``place`` with its response in its weights, and constants that it reads in its bias.

        An input of scale s is a signal of 2^s times the observation, so that its weights are 2^s times smaller.
        """
        node = network.nodes[place]
        weights: dict[int, float] = {}
        bias = node.bias
        for source, weight in node.links:
            value = weight * node.response
            if source in self._values:
                bias += value * self._values[source]
            else:
                scale = inputs[source].scale if source < len(inputs) else 0
                weights[source] = weights.get(source, 0.0) + value * 2.0**-scale
        return EffectiveNode({source: w for source, w in weights.items() if w}, bias, node.activation)


def require_inputs(network: FloatNetwork, inputs: Sequence[Input]) -> tuple[Input, ...]:
    """The inputs, one for each of the network's.

    Raises:
        QuantizeError: if there are more or fewer.
    """
    if len(inputs) != network.num_inputs:
        raise QuantizeError(f"the network has {network.num_inputs} inputs, the controller is to have {len(inputs)}")
    return tuple(inputs)
