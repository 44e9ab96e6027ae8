# SPDX-License-Identifier: MIT
"""Which values every signal and sum of a controller can take: bounds that hold at every step of every input sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

from bitneat.controller.activation import evaluate, table
from bitneat.controller.ir import SIGNAL_MAX, Controller, Node
from bitneat.controller.reference import apply_gain, saturate

_ROUNDS_BEFORE_WIDENING = 24
_NARROWINGS = 4


class Interval(NamedTuple):
    """All integers from ``low`` to ``high``, both included."""

    low: int
    high: int

    @property
    def magnitude(self) -> int:
        """The largest absolute value in it."""
        return max(-self.low, self.high)

    def hull(self, other: Interval) -> Interval:
        """The smallest interval that holds both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))


_ZERO = Interval(0, 0)


@dataclass(frozen=True, slots=True)
class NodeIntervals:
    """Bounds of what one node computes on the way to its value."""

    accumulator: Interval
    """The sum of bias and links, before the gain."""
    scaled: Interval
    """The sum after the gain, before it is clipped."""
    argument: Interval
    """u, what the activation gets."""


@dataclass(frozen=True, slots=True)
class Intervals:
    """Bounds of a whole controller."""

    signals: tuple[Interval, ...]
    """One for each signal: its values at the end of any step, the first included. The 0 after reset need not be in it."""
    nodes: tuple[NodeIntervals, ...]
    """One for each node."""


@lru_cache(maxsize=4)
def intervals(controller: Controller) -> Intervals:
    """Bounds that hold for every input sequence in the declared domain, from reset.

    What a delayed link can read is found from below: from the reset state step by step, until nothing new comes up. A loop
    that keeps growing is cut short by giving the bounds that still move the whole range of their activation, and a few more
    rounds then take back what was given too much. Links are taken to be independent of each other, except that the links
    from one source with one delay count as one weight; so the bounds are sound, and exact for a single sum over the inputs.
    """
    reads = [_ZERO] * controller.num_signals
    result = one_step(controller, reads)
    if not controller.is_recurrent:
        return result
    rounds = 0
    while True:
        grown = [read.hull(value) for read, value in zip(reads, result.signals, strict=True)]
        if grown == reads:
            break
        if rounds >= _ROUNDS_BEFORE_WIDENING:
            grown = [_widened(controller, i, *pair) for i, pair in enumerate(zip(reads, grown, strict=True))]
        reads = grown
        result = one_step(controller, reads)
        rounds += 1
    # Each of these starts from bounds that hold and so gives bounds that hold.
    for _ in range(_NARROWINGS if rounds > _ROUNDS_BEFORE_WIDENING else 0):
        result = one_step(controller, [_ZERO.hull(value) for value in result.signals])
    return result


def one_step(controller: Controller, reads: Sequence[Interval]) -> Intervals:
    """Bounds of one step, in which a delayed link from signal i can read ``reads[i]``."""
    signals = [Interval(-entry.limit, entry.limit) for entry in controller.inputs]
    nodes = []
    for node in controller.nodes:
        accumulator = _accumulator(node, signals, reads)
        scaled = Interval(*(apply_gain(bound, node.gain) for bound in accumulator))
        argument = Interval(*map(saturate, scaled))
        nodes.append(NodeIntervals(accumulator, scaled, argument))
        signals.append(image(node.activation, argument, controller.frac_bits))
    return Intervals(tuple(signals), tuple(nodes))


def _accumulator(node: Node, signals: Sequence[Interval], reads: Sequence[Interval]) -> Interval:
    weights: dict[tuple[int, int], int] = {}
    for link in node.links:
        key = (link.source, link.delay)
        weights[key] = weights.get(key, 0) + (link.sign << link.shift)
    low = high = node.bias
    for (source, delay), weight in weights.items():
        bounds = [weight * bound for bound in (reads if delay else signals)[source]]
        low += min(bounds)
        high += max(bounds)
    return Interval(low, high)


def _widened(controller: Controller, index: int, before: Interval, after: Interval) -> Interval:
    if index < len(controller.inputs) or before == after:
        return after
    whole = _whole_image(controller.nodes[index - len(controller.inputs)].activation, controller.frac_bits)
    return Interval(
        whole.low if after.low < before.low else after.low, whole.high if after.high > before.high else after.high
    )


_RISING = frozenset({"identity", "clamped", "relu", "step", "tanh", "sigmoid"})
"""Never fall anywhere, so that their extremes are at the ends of an interval."""
_EVEN = frozenset({"abs", "hat", "gauss"})
"""Even, and never change direction on either side of 0."""


def image(activation: str, argument: Interval, frac_bits: int) -> Interval:
    """The exact smallest and largest value of an activation over an interval within -32767..32767."""
    if activation in _RISING:
        ends = [argument.low, argument.high]
    elif activation in _EVEN:
        nearest = max(argument.low, -argument.high, 0)
        ends = [nearest, argument.magnitude]
    else:
        part = table(activation, frac_bits)[argument.low + SIGNAL_MAX : argument.high + SIGNAL_MAX + 1]
        return Interval(int(part.min()), int(part.max()))
    found = [evaluate(activation, end, frac_bits) for end in ends]
    return Interval(min(found), max(found))


@cache
def _whole_image(activation: str, frac_bits: int) -> Interval:
    return image(activation, Interval(-SIGNAL_MAX, SIGNAL_MAX), frac_bits)
