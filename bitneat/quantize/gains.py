# SPDX-License-Identifier: MIT
"""Weights as sums of few signed powers of two: the method that spends gains and parallel paths.

Each node has a step 2^e of its own, ``bits`` below its largest weight. Its weights and bias are rounded to multiples of the step
and written in canonical signed digits. An integer controller has a shifted link for each digit, and the step is the node's gain.
A ternary one has a helper node for each power of two, whose gain is the power and whose links, of weight ±1, read all sources that
have this digit; the digits of one power, the largest that is not above 1, are links of the node itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from bitneat.controller import Controller, ControllerError, Input, Link, Node
from bitneat.controller.digits import signed_powers
from bitneat.controller.ir import GAIN_RANGE, SHIFT_RANGE
from bitneat.network import FloatNetwork
from bitneat.quantize.draft import LARGEST_POWER, Draft, DraftNode, QuantizeError
from bitneat.quantize.effective import Constants, EffectiveNode, require_inputs

BITS_RANGE = (0, 7)
_SMALLEST_POWER = 2 * GAIN_RANGE[0]
"""Of a ternary controller's digits: a helper's gain and that of its reader. Less would move no signal by more than two units."""

Digits = Sequence[tuple[int, int]]
"""(power, sign) each."""


def spend_gains(
    network: FloatNetwork,
    inputs: Sequence[Input],
    frac_bits: int,
    *,
    ternary: bool,
    bits: int,
    terms: int | None = None,
) -> Controller:
    """A canonical controller near the network.

    Args:
        network: any.
        inputs: one for each of the network's; weights make up for their scales.
        frac_bits: F of the controller.
        ternary: whether all weights must be ±1.
        bits: the largest weight of a node is at most 2^bits of the node's steps; 0..7.
        terms: most signed powers of two of a weight; one that has more is rounded to fewer. None is no limit.

    Raises:
        QuantizeError: if a weight is beyond gains and shifts, or a sum could leave the accumulator.
    """
    if not BITS_RANGE[0] <= bits <= BITS_RANGE[1]:
        raise QuantizeError(f"bits: {bits} is outside {BITS_RANGE[0]}..{BITS_RANGE[1]}")
    inputs = require_inputs(network, inputs)
    constants = Constants()
    nodes: list[tuple[int, EffectiveNode, int, dict[int, Digits]]] = []
    for place in range(len(network.nodes)):
        node = constants.effective(network, place, inputs)
        step = max(exponent(node.weights.values()) - bits, _SMALLEST_POWER if ternary else GAIN_RANGE[0])
        digits = {source: _digits(weight, step, terms) for source, weight in node.weights.items()}
        digits = {source: row for source, row in digits.items() if row}
        index = network.num_inputs + place
        if digits:
            nodes.append((index, node, step, digits))
        else:
            constants.note(index, node)
    outputs = constants.outputs(network.outputs, frac_bits)
    if ternary:
        anchor = min((s for *_, digits in nodes for s in digits if s < len(inputs)), default=0)
        draft = Draft(inputs, frac_bits, anchor)
        for entry in nodes:
            _add_planes(draft, *entry)
        return draft.controller(outputs)
    shifted = dict.fromkeys(range(network.num_inputs, network.num_inputs + len(network.nodes)), Node())
    shifted.update({entry[0]: _shifted(frac_bits, *entry) for entry in nodes})
    try:
        return Controller(inputs, tuple(shifted.values()), tuple(outputs), frac_bits).canonical
    except ControllerError as error:
        raise QuantizeError(f"has no such controller: {error}") from None


def exponent(weights: Iterable[float]) -> int:
    """The least e such that no weight exceeds 2^e in size; far below any gain if there is none."""
    mantissa, power = math.frexp(max(map(abs, weights), default=0.0))
    if not mantissa:
        return -1000
    return power - 1 if mantissa == 0.5 else power


def _digits(value: float, step: int, terms: int | None) -> Digits:
    """The signed powers of two of a value that is rounded to a multiple of 2^step, or of a larger power to save terms."""
    while True:
        digits = signed_powers(round(math.ldexp(value, -step)))
        if terms is None or len(digits) <= terms:
            return [(power + step, sign) for power, sign in digits]
        step += 1


def _shifted(frac_bits: int, index: int, node: EffectiveNode, step: int, digits: Mapping[int, Digits]) -> Node:
    links = [Link(source, 0, power - step, sign) for source, row in digits.items() for power, sign in row]
    if step > GAIN_RANGE[1] or max(link.shift for link in links) > SHIFT_RANGE[1]:
        raise QuantizeError(f"node {index}: a weight of {max(map(abs, node.weights.values())):g} is too large")
    return Node(tuple(sorted(links)), round(math.ldexp(node.bias, frac_bits - step)), step, node.activation)


def _add_planes(draft: Draft, index: int, node: EffectiveNode, step: int, digits: Mapping[int, Digits]) -> None:
    planes: dict[int, DraftNode] = {}
    for source, row in digits.items():
        for power, sign in row:
            planes.setdefault(power, DraftNode()).links[("source", source), 0] = sign
    bias = _digits(node.bias, step, None)
    own = _own_power(planes, bias, draft.frac_bits)
    if own > GAIN_RANGE[1] or max(planes) - own > GAIN_RANGE[1]:
        raise QuantizeError(f"node {index}: a weight of {max(map(abs, node.weights.values())):g} is too large")
    total = planes.pop(own, DraftNode())
    total.gain, total.activation = own, node.activation
    rest = _put_bias(draft, total, planes, bias)
    for power in sorted(planes):
        planes[power].gain = power - own
        total.links[draft.helper(planes[power]), 0] = 1
    total.links.update({(constant, 0): sign for constant, sign in draft.constants(rest).items()})
    draft.place(index, total)


def _own_power(planes: Mapping[int, DraftNode], bias: Digits, frac_bits: int) -> int:
    """The power of two that a node's own links are worth, its gain.

    Helpers round down, each by less than a unit, and a gain of the node above 0 would multiply that. A bias far above the weights
    is no signal in units of theirs, so the gain then is larger.
    """
    own = max(max((power for power in planes if power <= 0), default=min(planes)), GAIN_RANGE[0])
    needed = max((power for power, _ in bias), default=own) + frac_bits - LARGEST_POWER
    return max(own, min(needed, 0, min(planes) - GAIN_RANGE[0]))


def _put_bias(draft: Draft, total: DraftNode, planes: Mapping[int, DraftNode], bias: Digits) -> int:
    """Spend the ±2^F that each node has for free on the bias's digits; returns what is left, in units of the node's sum."""
    rest = 0
    for power, sign in bias:
        units = power - total.gain + draft.frac_bits
        if power == total.gain:
            total.bias = sign * draft.one
        elif power in planes:
            planes[power].bias = sign * draft.one
        elif units >= 0:
            rest += sign << units
    return rest
