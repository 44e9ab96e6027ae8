# SPDX-License-Identifier: MIT
"""Integer maps against the exact ones: the bound holds at every count, and nothing leaves the word."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bitneat.codegen.sensor.affine import (
    SUM_LIMIT,
    ExactMap,
    IntegerMap,
    NoFit,
    Term,
    _centred,
    _signed_powers,
    active,
    fit,
)
from bitneat.codegen.sensor.plan import plan
from bitneat.codegen.sensor.read import MappedInput, MappedOutput, SensorMap
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal
from bitneat.controller.interval import Interval

RATIONALS = st.fractions(min_value=-500, max_value=500, max_denominator=10_000)


@st.composite
def exact_maps(draw: st.DrawFn) -> ExactMap:
    """Maps of up to 401 counts anywhere in ±2^24, some almost flat, some that clip nearly everywhere."""
    low = draw(st.integers(-(2**24), 2**24 - 400))
    span = draw(st.integers(1, 400))
    limit = draw(st.integers(1, 32767))
    slope = draw(RATIONALS) / draw(st.sampled_from([1, 50, 5000]))
    assume(slope != 0)
    middle = draw(st.integers(low, low + span))
    return ExactMap(slope, draw(RATIONALS) - slope * middle, Interval(low, low + span), Interval(-limit, limit))


def distance(exact: ExactMap, integer: IntegerMap) -> Fraction:
    """The largest distance there is, by trying every argument and some beyond."""
    return max(
        abs(integer(x) - exact(x)) for x in [*range(exact.domain.low - 2, exact.domain.high + 3), -(2**31), 2**31 - 1]
    )


@given(exact_maps(), st.sampled_from([Fraction(51, 100), Fraction(3, 5), Fraction(1), Fraction(20)]))
def test_the_bound_holds_at_every_count(exact: ExactMap, tolerance: Fraction) -> None:
    assume(active(exact) is not None)
    found = fit(exact, tolerance)
    if isinstance(found, NoFit):
        assert found.nearest is None or found.nearest > tolerance
        return
    assert distance(exact, found) <= found.error <= tolerance


@given(exact_maps())
def test_no_sum_leaves_its_limit(exact: ExactMap) -> None:
    assume(active(exact) is not None)
    found = fit(exact, Fraction(1))
    if isinstance(found, NoFit):
        return
    last = (exact.domain.high - exact.domain.low) >> found.pre
    for q in (0, last):
        assert abs(found.bias + found.multiplier * q) < SUM_LIMIT
    values = [found(x) for x in range(exact.domain.low, exact.domain.high + 1)]
    assert min(values) >= exact.image.low
    assert max(values) <= exact.image.high
    wide = replace(found, image=Interval(-SUM_LIMIT, SUM_LIMIT))
    values = [wide(x) for x in range(exact.domain.low, exact.domain.high + 1)]
    assert found.unclipped == Interval(min(values), max(values))


@given(exact_maps())
def test_a_map_is_monotone(exact: ExactMap) -> None:
    assume(active(exact) is not None)
    found = fit(exact, Fraction(1))
    if isinstance(found, IntegerMap):
        values = [found(x) for x in range(exact.domain.low, exact.domain.high + 1)]
        assert values == sorted(values, reverse=exact.slope < 0)


@pytest.mark.parametrize(
    ("slope", "terms"),
    [
        (Fraction(1), 1),
        (Fraction(1, 8), 1),
        (Fraction(-4), 1),
        (Fraction(7), 2),  # 8 - 1
        (Fraction(5, 1024), 2),
        (Fraction(21), 3),
    ],
)
def test_a_slope_takes_no_more_terms_than_it_needs(slope: Fraction, terms: int) -> None:
    exact = ExactMap(slope, Fraction(0), Interval(0, 4095), Interval(-32767, 32767))
    tight = fit(exact, Fraction(501, 1000))
    assert isinstance(tight, IntegerMap)
    assert len(tight.terms) == terms
    if slope.denominator == 1:
        assert (tight.pre, tight.post, tight.multiplier) == (0, 0, slope)


def test_the_count_of_terms_is_the_least_that_any_multiplier_allows() -> None:
    """By brute force over all multipliers of fewer terms, at every shift, with the best bias of each."""
    exact = ExactMap(Fraction(2 * 804, 1023), Fraction(-804), Interval(0, 1023), Interval(-2047, 2047))
    tolerance = Fraction(7, 10)
    found = fit(exact, tolerance)
    assert isinstance(found, IntegerMap)
    powers = [sign << shift for shift in range(13) for sign in (1, -1)]
    fewer = {0}
    for _ in range(len(found.terms) - 1):
        fewer = fewer | {total + power for total in fewer for power in powers}
    for post in range(12):
        for multiplier in fewer:
            # With floor, the error's range is at least as wide as that of the slope.
            slip = abs(Fraction(multiplier, 2**post) - exact.slope) * 1023
            assert slip + 1 - Fraction(1, 2**post) > 2 * tolerance, (multiplier, post)


def test_what_does_not_fit_32_bits_is_no_fit() -> None:
    steep = ExactMap(Fraction(10**9), Fraction(1, 3), Interval(-1000, 1000), Interval(-32767, 32767))
    assert fit(steep, Fraction(1)) == NoFit(None)


def test_a_tolerance_that_cannot_be_met_names_the_nearest() -> None:
    exact = ExactMap(Fraction(1, 3), Fraction(0), Interval(0, 65535), Interval(-32767, 32767))
    found = fit(exact, Fraction(500_000_001, 1_000_000_000))
    assert isinstance(found, NoFit)
    assert found.nearest is not None
    assert found.nearest > Fraction(1, 2)


@pytest.mark.parametrize(("intercept", "slope"), [(3000, 1), (-3000, -1), (2047, 1), (-4000, Fraction(1, 2))])
def test_a_map_that_never_moves_is_told_apart(intercept: int, slope: Fraction) -> None:
    assert active(ExactMap(Fraction(slope), Fraction(intercept), Interval(0, 500), Interval(-2047, 2047))) is None


@pytest.mark.parametrize("pre", [0, 1, 2, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_what_comes_before_the_last_clip_is_bounded_by_its_ends(pre: int, sign: int) -> None:
    terms = (Term(sign, 3), Term(-sign, 0))
    made = IntegerMap(Interval(-7, 42), Interval(-SUM_LIMIT, SUM_LIMIT), pre, terms, 5, 1, Fraction(1))
    values = [made(x) for x in range(-7, 43)]
    assert made.unclipped == Interval(min(values), max(values))


@pytest.mark.parametrize(
    ("target", "count", "found"),
    [
        (Fraction(1), 1, {(1,), (2,)}),
        (Fraction(-1), 1, {(-1,), (-2,)}),
        (Fraction(3), 1, {(2,), (4,)}),
        (Fraction(1, 2), 1, {(1,)}),
        (Fraction(3), 2, {(2, 1), (4, -1), (4, -2)}),
        (Fraction(0), 1, set()),
    ],
)
def test_sums_of_powers_are_those_next_to_what_is_left(
    target: Fraction, count: int, found: set[tuple[int, ...]]
) -> None:
    sums = _signed_powers(target, count)
    assert {tuple(term.sign << term.shift for term in terms) for terms in sums} == found


def test_what_never_moves_has_no_fit() -> None:
    with pytest.raises(ValueError, match="constant over its domain"):
        fit(ExactMap(Fraction(1), Fraction(100), Interval(0, 9), Interval(-5, 5)), Fraction(1))


def test_a_map_that_turns_the_wrong_way_or_not_at_all_is_none() -> None:
    exact = ExactMap(Fraction(1, 2), Fraction(0), Interval(0, 9), Interval(-50, 50))
    moving = active(exact)
    assert moving is not None
    for terms in ((Term(-1, 3),), (Term(1, 3), Term(-1, 3)), (Term(1, 3), Term(-1, 4))):
        assert _centred(exact, moving, 0, terms, 4) is None
    assert _centred(exact, moving, 0, (Term(1, 3),), 4) is not None


def test_a_wide_range_that_is_mostly_clipped_is_mapped_where_it_moves() -> None:
    """300 signals a count over 24 bits leave 32 bits by far, but only 14 counts are not clipped."""
    entry = MappedInput("cell", Interval(-(2**23), 2**23), Fraction(300, 256), Fraction(1, 7), Fraction(1))
    controller = Controller((Input(0, 2047),), (Node((Link(0),)),), (Signal(1),))
    mapped = MappedOutput("a", (Fraction(-1), Fraction(1)), (0, 255), Fraction(1))
    action = BoxAction((-1.0,), (1.0,), (1,), "float32")
    channel = plan(controller, action, SensorMap("map.toml", (entry,), (mapped,))).inputs[0]
    arguments = [*range(-40, 41), -(2**23), 2**23, -(2**31), 2**31 - 1]
    assert max(abs(channel.integer(x) - channel.exact(x)) for x in arguments) <= channel.integer.error <= 1
    assert channel.exact.domain == entry.counts


def test_the_bound_counts_what_the_first_shift_drops_and_no_more() -> None:
    exact = ExactMap(Fraction(1, 8), Fraction(0), Interval(0, 799), Interval(-500, 500))
    moving = active(exact)
    assert moving is not None
    made = _centred(exact, moving, 3, (Term(1, 0),), 0)
    assert made is not None
    assert (made.bias, made.error) == (0, Fraction(7, 8))
    assert distance(exact, made) == Fraction(7, 8)


@pytest.mark.parametrize("low", [2**24 - 10, -(2**24)])
def test_counts_far_from_zero_leave_no_word(low: int) -> None:
    exact = ExactMap(Fraction(100), Fraction(-100 * low - 500), Interval(low, low + 10), Interval(-32767, 32767))
    found = fit(exact, Fraction(1))
    assert isinstance(found, IntegerMap)
    assert distance(exact, found) <= 1
