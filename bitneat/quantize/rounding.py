# SPDX-License-Identifier: MIT
"""Quantization weight by weight: rounding, as the paper has it, and ternary weights by a threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bitneat.controller import Controller, ControllerError, Input, Link, Node, Output, Signal
from bitneat.controller.digits import LARGEST_SHIFTED_WEIGHT, signed_powers
from bitneat.controller.ir import GAIN_RANGE
from bitneat.network import FloatNetwork
from bitneat.quantize.draft import QuantizeError
from bitneat.quantize.effective import Constants, EffectiveNode, require_inputs
from bitneat.quantize.exact import to_ternary

_THRESHOLD = 0.7


def round_weights(network: FloatNetwork, inputs: Sequence[Input], frac_bits: int, *, ternary: bool) -> Controller:
    """Weights and biases rounded to the nearest integer, or to the nearest of -1, 0 and 1.

    A response becomes the power of two nearest to it on a logarithmic scale, the node's gain. A controller adds a bias before its
    gain, a network after its response, so the bias is divided by the gain.

    Args:
        network: any.
        inputs: one for each of the network's. An input of scale s divides its weights by 2^s, before they are rounded.
        frac_bits: F of the controller.
        ternary: which of the two.

    Raises:
        QuantizeError: if a weight is beyond shifts, or a sum could leave the accumulator.
    """
    inputs = require_inputs(network, inputs)
    nodes = []
    for place, node in enumerate(network.nodes):
        gain = _gain(node.response)
        sign = 0.0 if not node.response else math.copysign(1.0, node.response)
        total: dict[int, float] = {}
        for source, weight in node.links:
            scale = inputs[source].scale if source < len(inputs) else 0
            total[source] = total.get(source, 0.0) + sign * weight * 2.0**-scale
        weights = {source: round(weight) for source, weight in total.items()}
        if ternary:
            weights = {source: max(-1, min(1, weight)) for source, weight in weights.items()}
        elif max(map(abs, weights.values()), default=0) > LARGEST_SHIFTED_WEIGHT:
            raise QuantizeError(f"node {network.num_inputs + place}: a weight is beyond ±{LARGEST_SHIFTED_WEIGHT}")
        bias = round(node.bias)
        bias = max(-1, min(1, bias)) if ternary else bias
        nodes.append(Node(_links(weights), round(math.ldexp(bias, frac_bits - gain)), gain, node.activation))
    controller = _controller(inputs, nodes, [Signal(index) for index in network.outputs], frac_bits)
    return to_ternary(controller) if ternary else controller


def threshold_weights(network: FloatNetwork, inputs: Sequence[Input], frac_bits: int) -> Controller:
    """A ternary controller with a scale for each node, as in Ternary Weight Networks (Li, Zhang and Liu 2016, arXiv:1605.04711).

    Weights below delta = 0.7 mean |w| become 0, the others ±1 times alpha, the mean size of those. alpha is rounded to a power of
    two and is the node's gain. The bias, which has no part in that, becomes 0 or ±2^gain, whichever is nearest. Means are over the
    links of a node.

    Args:
        network: any.
        inputs: one for each of the network's; weights make up for their scales.
        frac_bits: F of the controller.

    Raises:
        QuantizeError: if a scale is beyond gains, or a sum could leave the accumulator.
    """
    inputs = require_inputs(network, inputs)
    constants = Constants()
    nodes = []
    for place in range(len(network.nodes)):
        index = network.num_inputs + place
        node = constants.effective(network, place, inputs)
        if not node.weights:
            constants.note(index, node)
            nodes.append(Node())
            continue
        nodes.append(_thresholded(node, index, frac_bits))
    return _controller(inputs, nodes, constants.outputs(network.outputs, frac_bits), frac_bits)


def _thresholded(node: EffectiveNode, index: int, frac_bits: int) -> Node:
    sizes = [abs(weight) for weight in node.weights.values()]
    threshold = _THRESHOLD * math.fsum(sizes) / len(sizes)
    kept = [size for size in sizes if size > threshold]
    gain = _nearest_exponent(math.fsum(kept) / len(kept))
    if not GAIN_RANGE[0] <= gain <= GAIN_RANGE[1]:
        raise QuantizeError(f"node {index}: its weights' scale 2^{gain} is no gain of {GAIN_RANGE[0]}..{GAIN_RANGE[1]}")
    weights = {s: (1 if w > 0 else -1) for s, w in node.weights.items() if abs(w) > threshold}
    bias = max(-1, min(1, round(math.ldexp(node.bias, -gain))))
    return Node(_links(weights), bias << frac_bits, gain, node.activation)


def _gain(response: float) -> int:
    """The power of two nearest to a response; one that is 0 leaves no weights to scale."""
    if not response:
        return 0
    return max(GAIN_RANGE[0], min(GAIN_RANGE[1], _nearest_exponent(abs(response))))


def _nearest_exponent(value: float) -> int:
    return round(math.log2(value))


def _links(weights: dict[int, int]) -> tuple[Link, ...]:
    links = (Link(s, 0, power, sign) for s, weight in weights.items() for power, sign in signed_powers(weight))
    return tuple(sorted(links))


def _controller(
    inputs: Sequence[Input], nodes: Sequence[Node], outputs: Sequence[Output], frac_bits: int
) -> Controller:
    try:
        return Controller(tuple(inputs), tuple(nodes), tuple(outputs), frac_bits).canonical
    except ControllerError as error:
        raise QuantizeError(f"has no such controller: {error}") from None
