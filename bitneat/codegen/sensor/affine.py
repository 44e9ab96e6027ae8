# SPDX-License-Identifier: MIT
"""Affine maps of integers: the exact one, and one of shifts and additions whose distance from it is proved.

All bounds are computed in rational numbers, so nothing here depends on a rounding of floats.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import ceil, floor

from bitneat.controller.interval import Interval

MAX_TERMS = 8
SUM_LIMIT = 2**30
"""No sum on the way may reach this magnitude, which leaves a 32-bit word room for a comparison by subtraction."""


@dataclass(frozen=True, slots=True)
class ExactMap:
    """``clip(slope · clip(x, domain) + intercept, image)``, a real number for each integer x."""

    slope: Fraction
    intercept: Fraction
    domain: Interval
    image: Interval

    def real(self, x: int) -> Fraction:
        """The value at x before the last clip, x in the domain."""
        return self.slope * x + self.intercept

    def __call__(self, x: int) -> Fraction:
        """The value at any x."""
        value = self.real(min(max(x, self.domain.low), self.domain.high))
        return min(max(value, Fraction(self.image.low)), Fraction(self.image.high))


@dataclass(frozen=True, slots=True)
class Term:
    """One signed power of two of the multiplier: ``sign · 2^shift``."""

    sign: int
    shift: int


@dataclass(frozen=True, slots=True)
class IntegerMap:
    """``clip(floor((bias + Σ sign·(q << shift)) / 2^post), image)`` where q is ``(clip(x, domain) - domain.low) >> pre``.

    ``error`` bounds the distance from the exact map at every x.
    """

    domain: Interval
    image: Interval
    pre: int
    terms: tuple[Term, ...]
    bias: int
    post: int
    error: Fraction

    @property
    def multiplier(self) -> int:
        """The sum of the terms."""
        return sum(term.sign << term.shift for term in self.terms)

    def __call__(self, x: int) -> int:
        """The value at any integer x: the reference that the C must equal."""
        q = (min(max(x, self.domain.low), self.domain.high) - self.domain.low) >> self.pre
        value = (self.bias + self.multiplier * q) >> self.post
        return min(max(value, self.image.low), self.image.high)

    @property
    def unclipped(self) -> Interval:
        """All values before the last clip."""
        ends = [
            (self.bias + self.multiplier * q) >> self.post
            for q in (0, (self.domain.high - self.domain.low) >> self.pre)
        ]
        return Interval(min(ends), max(ends))


@dataclass(frozen=True, slots=True)
class NoFit:
    """No map of at most `MAX_TERMS` terms is within the tolerance; the nearest is this far, None if none fits 32 bits."""

    nearest: Fraction | None


def active(exact: ExactMap) -> Interval | None:
    """Where the exact map moves: the x of the domain at which it is not clipped, and one neighbour on either side.

    None if every x is clipped. Beyond these x a monotone map is as near to the exact one as at the neighbour.
    """
    at = sorted((Fraction(bound) - exact.intercept) / exact.slope for bound in exact.image)
    low, high = max(exact.domain.low, floor(at[0])), min(exact.domain.high, ceil(at[1]))
    # Of a domain that touches the image in one point, or not at all, nothing could be measured.
    return Interval(low, high) if at[0] < exact.domain.high and at[1] > exact.domain.low and low < high else None


@lru_cache(maxsize=4096)
def fit(exact: ExactMap, tolerance: Fraction) -> IntegerMap | NoFit:
    """The map of the fewest terms that is found within ``tolerance`` of the exact one, and of those the nearest.

    ``exact`` has a slope other than 0 and moves somewhere (`active`).
    """
    moving = active(exact)
    if moving is None:
        raise ValueError("the map is constant over its domain")
    nearest: IntegerMap | None = None
    for count in range(1, MAX_TERMS + 1):
        for pre, post in _shifts(exact, tolerance):
            for terms in _signed_powers(exact.slope * 2 ** (pre + post), count):
                if nearest is not None and _slip(exact, moving, pre, terms, post) > nearest.error:
                    continue
                candidate = _centred(exact, moving, pre, terms, post)
                if candidate is not None and (nearest is None or candidate.error < nearest.error):
                    nearest = candidate
        if nearest is not None and nearest.error <= tolerance:
            return nearest
    return NoFit(None if nearest is None else nearest.error)


def _shifts(exact: ExactMap, tolerance: Fraction) -> Iterator[tuple[int, int]]:
    """Every pair of a first and a last shift that leaves the sums within the word."""
    reach = max(abs(exact.real(exact.domain.low)), abs(exact.real(exact.domain.high)), Fraction(1))
    span = exact.domain.high - exact.domain.low
    for pre in range(span.bit_length()):
        # What the bits that are dropped first are worth must not use up the tolerance.
        if pre and abs(exact.slope) * (2**pre - 1) >= 2 * tolerance:
            break
        post = 0
        while reach * 2**post < SUM_LIMIT:
            yield pre, post
            post += 1


def _slip(exact: ExactMap, moving: Interval, pre: int, terms: tuple[Term, ...], post: int) -> float:
    """What a map errs by its slope alone: a quick look in floats, and a little less than that, to be on the safe side."""
    slope = sum(term.sign << term.shift for term in terms) / (1 << pre + post)
    return abs(slope - float(exact.slope)) * (moving.high - moving.low) / 2 * 0.999 - 1e-6


def _signed_powers(target: Fraction, count: int) -> set[tuple[Term, ...]]:
    """Sums of ``count`` signed powers of two near a number: at each step the power below or the one above what is left."""
    found: set[tuple[Term, ...]] = set()
    waiting: list[tuple[tuple[Term, ...], Fraction]] = [((), target)]
    while waiting:
        terms, rest = waiting.pop()
        if len(terms) == count:
            found.add(tuple(sorted(terms, key=lambda term: (-term.sign, -term.shift))))
            continue
        sign = 1 if rest > 0 else -1
        below = floor(abs(rest)).bit_length() - 1
        used = {term.shift for term in terms}
        for shift in {max(below, 0), below + 1}:
            if rest and shift < SUM_LIMIT.bit_length() and shift not in used:
                waiting.append(((*terms, Term(sign, shift)), rest - sign * 2**shift))
    return found


def _centred(exact: ExactMap, moving: Interval, pre: int, terms: tuple[Term, ...], post: int) -> IntegerMap | None:
    """The map with the bias that puts its error's range around 0; None if it turns the wrong way or leaves the word."""
    multiplier = sum(term.sign << term.shift for term in terms)
    if multiplier * exact.slope <= 0:
        return None
    gain = Fraction(multiplier, 2**post)
    # y - exact = drift(x) + bias/2^post - gain·(what the first shift drops) - (what the last shift drops)
    drifts = [gain * (x - exact.domain.low) / 2**pre - exact.real(x) for x in moving]
    dropped_first = gain * Fraction(2**pre - 1, 2**pre)
    least = min(drifts) - max(dropped_first, 0) - (1 - Fraction(1, 2**post))
    most = max(drifts) - min(dropped_first, 0)
    bias = round(-(least + most) / 2 * 2**post)
    offset = Fraction(bias, 2**post)
    last = (exact.domain.high - exact.domain.low) >> pre
    if max(abs(bias), abs(bias + multiplier * last)) >= SUM_LIMIT:
        return None
    error = max(abs(least + offset), abs(most + offset))
    return IntegerMap(exact.domain, exact.image, pre, terms, bias, post, error)
