# SPDX-License-Identifier: MIT
"""The same function with weights of ±1: integer controllers made ternary."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from bitneat.controller import Controller, Link, Node, Signal
from bitneat.controller.digits import signed_powers
from bitneat.controller.interval import intervals
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.quantize.draft import Draft, DraftNode, Key, QuantizeError

_MOST_TERMS = 1024
"""Of one node, after those that are too large for one signal have been split."""


def to_ternary(controller: Controller, *, exact: bool = True) -> Controller:
    """A ternary controller that gives the same outputs for every input sequence from reset.

    Links of shift k into one node are gathered by helper nodes of gain k, its bias by nodes of bias 2^F and signals that are always
    a power of two. A helper must not saturate where the sum did not, so that its bound decides how many links it can take. A link
    whose source times 2^k is no signal at all is split into links of a smaller shift, twice as many for each.

    Args:
        controller: any.
        exact: if false, links are not split and helpers may saturate, at SIGNAL_MAX, where the sum did not.

    Raises:
        QuantizeError: if a node would need more than a thousand terms, or its sums could leave the accumulator.
    """
    controller = controller.canonical
    if controller.is_ternary:
        return controller
    bounds = [interval.magnitude for interval in intervals(controller).signals]
    first = len(controller.inputs)
    draft = Draft(controller.inputs, controller.frac_bits, _anchor(controller))
    for index, node in enumerate(controller.nodes, start=first):
        _translate(draft, index, node, bounds if exact else [0] * len(bounds))
    result = draft.controller(controller.outputs)
    if not result.is_ternary:
        raise QuantizeError("has no equal ternary controller: a constant in it is no power of two")
    return result


def _anchor(controller: Controller) -> int:
    """An input that is read anyway."""
    read = {link.source for node in controller.nodes for link in node.links}
    read |= {output.index for output in controller.outputs if isinstance(output, Signal)}
    return min((source for source in read if source < len(controller.inputs)), default=0)


def _translate(draft: Draft, index: int, node: Node, bounds: Sequence[int]) -> None:
    total = DraftNode({}, 0, node.gain, node.activation)
    planes: dict[int, list[_Plane]] = {}
    for power, link in _split(node.links, bounds, index):
        key: tuple[Key, int] = (("source", link.source), link.delay)
        if not power and key not in total.links:
            total.links[key] = link.sign
            continue
        size = bounds[link.source] << power
        rows = planes.setdefault(power, [])
        plane = next((p for p in rows if p.bound + size <= SIGNAL_MAX and key not in p.node.links), None)
        if plane is None:
            plane = _Plane(power)
            rows.append(plane)
        plane.node.links[key] = link.sign
        plane.bound += size
    rest = _put_bias(draft, total, planes, _needed_bias(node, bounds))
    for rows in planes.values():
        for plane in rows:
            total.links[draft.helper(plane.node), 0] = 1
    total.links.update({(constant, 0): sign for constant, sign in draft.constants(rest).items()})
    draft.place(index, total)


class _Plane:
    """A helper node of gain ``power`` and a bound of its value."""

    def __init__(self, power: int) -> None:
        self.node = DraftNode(gain=power)
        self.bound = 0


def _split(links: Sequence[Link], bounds: Sequence[int], index: int) -> list[tuple[int, Link]]:
    """The links by the power of two that they are worth, each a signal; those that are no signal in parts."""
    waiting = deque((link.shift, link) for link in links)
    parts = []
    while waiting:
        power, link = waiting.popleft()
        if power and bounds[link.source] << power > SIGNAL_MAX:
            waiting.extend([(power - 1, link)] * 2)
        else:
            parts.append((power, link))
        if len(parts) + len(waiting) > _MOST_TERMS:
            raise QuantizeError(f"node {index}: needs more than {_MOST_TERMS} links of weight 1 to be exact")
    return sorted(parts)


def _needed_bias(node: Node, bounds: Sequence[int]) -> int:
    """The bias, less what only saturates the node further."""
    reach = sum(bounds[link.source] << link.shift for link in node.links)
    enough = reach + (SIGNAL_MAX << max(-node.gain, 0))
    return max(-enough, min(enough, node.bias)) if any(bounds) else node.bias


def _put_bias(draft: Draft, total: DraftNode, planes: dict[int, list[_Plane]], bias: int) -> int:
    """Spend the ±2^F that nodes have for free on the bias; returns what is left of it."""
    rest = 0
    for power, sign in signed_powers(bias):
        above = power - draft.frac_bits
        size = draft.one << max(above, 0)
        plane = next((p for p in planes.get(above, ()) if not p.node.bias and p.bound + size <= SIGNAL_MAX), None)
        if above == 0:
            total.bias = sign * draft.one
        elif plane is not None:
            plane.node.bias = sign * draft.one
            plane.bound += size
        else:
            rest += sign << power
    return rest
