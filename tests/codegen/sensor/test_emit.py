# SPDX-License-Identifier: MIT
"""What an expression of C that clips is made of."""

import random
import re
from dataclasses import replace
from fractions import Fraction

import pytest

from bitneat.codegen import generate
from bitneat.codegen.sensor.affine import ExactMap, IntegerMap, Term, fit
from bitneat.codegen.sensor.emit import _arguments, _Emitter, _member, _word, formula, sensor_files
from bitneat.codegen.sensor.plan import Channel, plan
from bitneat.codegen.sensor.read import MappedInput, MappedOutput, SensorMap
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal
from bitneat.controller.interval import Interval

HALF = 2**31


@pytest.mark.parametrize(
    ("values", "limits", "helpers"),
    [
        ((-5, 5), (-5, 5), []),
        ((-5, 5), (-4, 5), ["at_least"]),
        ((-5, 5), (-5, 4), ["at_most"]),
        ((-6, 6), (-5, 5), ["at_least", "at_most"]),
        ((-HALF + 1, 0), (0, 0), ["at_least"]),
        ((-HALF, 0), (0, 0), ["at_least_any"]),  # the difference is 2^31, whose sign is lost
        ((-1, HALF - 1), (0, HALF - 1), ["at_least"]),
        ((-1, HALF), (0, HALF), ["at_least_any"]),
        ((0, HALF - 1), (0, 0), ["at_most"]),
        ((0, HALF), (0, 0), ["at_most_any"]),
        ((-HALF + 1, 1), (-HALF + 1, 0), ["at_most"]),
        ((-HALF, 1), (-HALF, 0), ["at_most_any"]),
    ],
)
def test_only_sides_that_can_be_exceeded_are_clipped_by_subtraction_where_that_keeps_its_sign(
    values: tuple[int, int], limits: tuple[int, int], helpers: list[str]
) -> None:
    emitter = _Emitter("legs")
    text = emitter.clamp("x", Interval(*values), Interval(*limits))
    assert sorted(emitter.helpers) == helpers
    assert text.count("legs_") == len(helpers)


@pytest.mark.parametrize(("low", "q"), [(-1, "x + 1"), (0, "x"), (1, "x - 1"), (2, "x - 2")])
def test_a_formula_says_where_its_argument_begins(low: int, q: str) -> None:
    made = IntegerMap(Interval(low, 1000), Interval(-500, 500), 0, (Term(1, 3),), -7, 4, Fraction(1, 2))
    assert formula(made) == f"floor((8 q - 7) / 2^4), q = {q}"
    halved = replace(made, pre=1)
    assert formula(halved).endswith(f"q = floor({q} / 2^1)" if low == 0 else f"q = floor(({q}) / 2^1)")


@pytest.mark.parametrize(
    ("low", "high", "name"),
    [
        (0, 65535, "uint16_t"),
        (0, 65536, "int32_t"),
        (-1, 32767, "int16_t"),
        (-32768, 0, "int16_t"),
        (-1, 32768, "int32_t"),
        (-32769, 0, "int32_t"),
    ],
)
def test_a_member_has_the_first_type_that_holds_its_counts(low: int, high: int, name: str) -> None:
    exact = ExactMap(Fraction(1, 4), Fraction(0), Interval(low, high), Interval(-32767, 32767))
    found = fit(exact, Fraction(1))
    assert isinstance(found, IntegerMap)
    assert _member(Channel(0, "speed", exact, found), Interval(low, high), "signals").type == name


def test_where_nothing_can_be_exceeded_nothing_is_clipped() -> None:
    controller = Controller((Input(0, 32767),), (Node((Link(0),), gain=-7, activation="identity"),), (Signal(1),), 8)
    action = BoxAction((-1.0,), (1.0,), (1,), "float32")
    counts = MappedInput("cell", Interval(0, 65535), Fraction(1, 2**15), Fraction(0), Fraction(1))
    motor = MappedOutput("motor", (Fraction(-1), Fraction(1)), (-30000, 30000), Fraction(100))
    sensors = plan(controller, action, SensorMap("map.toml", (counts,), (motor,)))
    files = sensor_files(generate(controller, "legs", "unrolled"), controller, sensors)
    assert "at_least" not in files.source
    assert "at_most" not in files.source
    assert "_mask" not in files.source
    # 32767 >> 7 is less than One, so the self-test does not ask for what comes at One.
    assert (sensors.outputs[0].takes, sensors.outputs[0].exact.domain) == (Interval(-256, 255), Interval(-256, 256))
    signals = re.search(r"legs_test_signals\[[^{]*\{([^;]*)\};", files.selftest)
    assert signals is not None
    numbers = [int(number) for number in re.findall(r"-?\d+", signals[1])]
    assert (min(numbers), max(numbers)) == (-256, 255)


def test_a_self_test_asks_at_both_ends_and_every_second_time_where_the_map_moves() -> None:
    exact = ExactMap(Fraction(100), Fraction(0), Interval(-(2**20), 2**20), Interval(-1000, 1000))
    channels = [(exact.domain, exact), (Interval(50, 60), exact)]  # what comes in there never moves the second
    rng = random.Random(1)
    rows = [_arguments(channels, step, rng) for step in range(60)]
    assert rows[:2] == [[-(2**20), 50], [2**20, 60]]
    assert all(abs(row[0]) <= 11 for row in rows[3::2])
    assert sum(abs(row[0]) > 1000 for row in rows[2::2]) > 25
    assert all(50 <= row[1] <= 60 for row in rows)


@pytest.mark.parametrize(
    ("terms", "texts", "helpers"),
    [
        ((Term(1, 3),), ["+= q << 3"], set()),
        ((Term(1, 0),), ["+= q"], set()),
        ((Term(-1, 3),), ["-= legs_opaque(q << 3)"], {"opaque"}),
        ((Term(1, 3), Term(-1, 0)), ["+= legs_opaque(q << 3)", "-= q"], {"opaque"}),
    ],
)
def test_a_shift_is_hidden_where_a_compiler_could_multiply(
    terms: tuple[Term, ...], texts: list[str], helpers: set[str]
) -> None:
    emitter = _Emitter("legs")
    made = IntegerMap(Interval(0, 9), Interval(-500, 500), 0, terms, 0, 0, Fraction(1))
    assert [emitter.term(made, index) for index in range(len(terms))] == texts
    assert emitter.helpers == helpers


@pytest.mark.parametrize(
    ("value", "text"), [(0, "UINT32_C(0)"), (7, "UINT32_C(7)"), (-7, "(UINT32_C(0) - UINT32_C(7))")]
)
def test_a_constant_is_written_in_twos_complement(value: int, text: str) -> None:
    assert _word(value) == text
