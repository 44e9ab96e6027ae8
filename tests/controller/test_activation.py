# SPDX-License-Identifier: MIT
"""Every activation at every one of its 65,535 arguments, for each of the nine F."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from neat.activations import ActivationFunctionSet

from bitneat.controller import ACTIVATION_NAMES
from bitneat.controller.activation import (
    ACTIVATION_CODES,
    PROGRAMS,
    Op,
    Program,
    evaluate,
    output_limit,
    real_function,
    table,
)

IntArray = npt.NDArray[np.int64]

ARGUMENTS: IntArray = np.arange(-32767, 32768, dtype=np.int64)
EVERY_F = pytest.mark.parametrize("frac_bits", range(4, 13))
EVERY_ACTIVATION = pytest.mark.parametrize("name", ACTIVATION_NAMES)


def by_hand(name: str, u: IntArray, frac_bits: int) -> IntArray:
    """The ten functions once more, from their formulas: floor divisions and products in place of shifts, no program."""
    one = 2**frac_bits
    a = np.abs(u)

    def real(value: float, bits: int = frac_bits) -> int:
        """A constant: rounded to 12 fractional bits, then cut to ``bits``."""
        return int(np.rint(value * 4096)) * 2**bits // 4096

    def tanh() -> IntArray:
        lines = [
            2 * a + a // 2,
            2 * a + a // 32 + real(0.0509),
            a + a // 4 + real(0.2620),
            a // 2 + a // 16 + real(0.5660),
            a // 8 + a // 64 + real(0.8480),
            np.full_like(a, one),
        ]
        return np.sign(u) * np.min(lines, axis=0)

    def sin() -> IntArray:
        fine = frac_bits + 8
        turns, half = np.divmod(815 * np.minimum(a, 12 * one), 2 ** (frac_bits + 9))
        quarter = np.where(half <= 2**fine, half, 2 * 2**fine - half)
        lines = [
            quarter + quarter // 2,
            quarter + quarter // 16 + real(0.16746, fine),
            quarter // 2 + quarter // 128 + real(0.53587, fine),
            np.full_like(a, 2**fine),
        ]
        return np.sign(u) * (-1) ** (turns % 2) * (np.min(lines, axis=0) // 256)

    def gauss() -> IntArray:
        head = np.min(
            [np.full_like(a, one), real(1.0495) - a - a // 16, real(1.1600) + a // 4 - 2 * a],
            axis=0,
        )
        return np.max([head, real(0.75) + a // 32 - a, real(0.3010) - a // 4 - a // 16, np.zeros_like(a)], axis=0)

    functions: dict[str, Callable[[], IntArray]] = {
        "identity": lambda: u,
        "clamped": lambda: np.clip(u, -one, one),
        "relu": lambda: np.where(u > 0, u, 0),
        "abs": lambda: a,
        "hat": lambda: np.where(a < one, one - a, 0),
        "step": lambda: np.where(u > 0, one, 0),
        "tanh": tanh,
        "sigmoid": lambda: (one + tanh()) // 2,
        "sin": sin,
        "gauss": gauss,
    }
    return functions[name]()


@EVERY_F
class TestEveryArgument:
    @EVERY_ACTIVATION
    def test_has_the_value_that_was_worked_out_by_hand(self, name: str, frac_bits: int) -> None:
        assert (table(name, frac_bits) == by_hand(name, ARGUMENTS, frac_bits)).all()

    @EVERY_ACTIVATION
    def test_stays_within_the_declared_limit(self, name: str, frac_bits: int) -> None:
        values = table(name, frac_bits)
        assert np.abs(values).max() <= output_limit(name, frac_bits)
        if name in ("hat", "step", "sigmoid", "gauss", "relu", "abs"):
            assert values.min() == 0

    @EVERY_ACTIVATION
    def test_reaches_the_declared_limit(self, name: str, frac_bits: int) -> None:
        assert np.abs(table(name, frac_bits)).max() == output_limit(name, frac_bits)

    @pytest.mark.parametrize("name", ["identity", "clamped", "relu", "abs", "hat", "step"])
    def test_of_a_simple_activation_is_exact(self, name: str, frac_bits: int) -> None:
        assert (table(name, frac_bits) / 2**frac_bits == real_function(name, ARGUMENTS / 2**frac_bits)).all()

    @pytest.mark.parametrize("name", ["tanh", "sigmoid", "sin", "gauss"])
    def test_of_a_smooth_activation_is_close(self, name: str, frac_bits: int) -> None:
        z = ARGUMENTS / 2**frac_bits
        error = np.abs(table(name, frac_bits) / 2**frac_bits - real_function(name, z))
        near = np.abs(z) <= 4 if name == "sin" else np.full(z.shape, True)
        if frac_bits >= 8:
            assert error[near].max() <= 0.02
            assert error.max() <= 0.05
        else:
            # Below F = 8 the rounding of a few terms, each by less than a unit, is no longer small beside the lines' error.
            assert error.max() <= 0.02 + 1.5 / 2**frac_bits

    @pytest.mark.parametrize("name", ["identity", "clamped", "tanh", "sin"])
    def test_gives_the_negative_of_its_negative_where_the_function_is_odd(self, name: str, frac_bits: int) -> None:
        assert (table(name, frac_bits) == -table(name, frac_bits)[::-1]).all()

    @pytest.mark.parametrize("name", ["abs", "hat", "gauss"])
    def test_gives_the_same_as_its_negative_where_the_function_is_even(self, name: str, frac_bits: int) -> None:
        assert (table(name, frac_bits) == table(name, frac_bits)[::-1]).all()

    @pytest.mark.parametrize("name", ["identity", "clamped", "relu", "step", "tanh", "sigmoid"])
    def test_never_gives_less_than_a_smaller_one_where_the_function_rises(self, name: str, frac_bits: int) -> None:
        assert (np.diff(table(name, frac_bits)) >= 0).all()

    @pytest.mark.parametrize("name", ["hat", "gauss"])
    def test_never_gives_more_than_one_nearer_to_zero_where_the_function_is_a_bump(
        self, name: str, frac_bits: int
    ) -> None:
        assert (np.diff(table(name, frac_bits)[32767:]) <= 0).all()

    @EVERY_ACTIVATION
    def test_needs_no_more_than_32_bits_on_the_way(self, name: str, frac_bits: int) -> None:
        largest = 0
        for length in range(1, len(PROGRAMS[name].steps) + 1):
            values = Program(name, "", PROGRAMS[name].steps[:length])(ARGUMENTS, frac_bits)
            largest = max(largest, int(np.abs(values).max()))
        assert largest < 2**25

    def test_of_sigmoid_is_half_of_one_and_tanh(self, frac_bits: int) -> None:
        expected = (2**frac_bits + table("tanh", frac_bits)) >> 1
        assert (table("sigmoid", frac_bits) == expected).all()


class TestValuesAtLandmarks:
    @EVERY_F
    def test_are_exact(self, frac_bits: int) -> None:
        one = 1 << frac_bits
        values = {name: [evaluate(name, u, frac_bits) for u in (0, 32767, -32767)] for name in ACTIVATION_NAMES}
        assert values["tanh"] == [0, one, -one]
        assert values["sigmoid"] == [one // 2, one, 0]
        assert values["gauss"] == [one, 0, 0]
        assert values["hat"] == [one, 0, 0]
        assert values["sin"][0] == 0
        assert values["step"] == [0, one, 0]


class TestPrograms:
    @EVERY_ACTIVATION
    def test_use_a_few_plain_operations_on_earlier_values(self, name: str) -> None:
        for number, step in enumerate(PROGRAMS[name].steps, start=1):
            assert 0 <= step.x < number
            assert 0 <= step.y < number
            if step.op in (Op.SHL, Op.SHR):
                assert 1 <= step.k <= 10

    @EVERY_ACTIVATION
    def test_give_the_same_for_a_number_as_for_an_array(self, name: str) -> None:
        for frac_bits in (4, 8, 12):
            values = table(name, frac_bits)
            for u in (*range(-32767, 32768, 499), -1, 0, 1, 32767):
                result = evaluate(name, u, frac_bits)
                assert type(result) is int
                assert result == values[u + 32767]

    def test_have_codes_that_packed_controllers_rely_on(self) -> None:
        assert ACTIVATION_CODES == {
            "identity": 0, "clamped": 1, "relu": 2, "abs": 3, "hat": 4,
            "step": 5, "tanh": 6, "sigmoid": 7, "sin": 8, "gauss": 9,
        }  # fmt: skip

    def test_have_tables_that_cannot_be_written_to(self) -> None:
        with pytest.raises(ValueError, match="read-only"):
            table("tanh", 8)[0] = 1


@pytest.mark.parametrize("name", [name for name in ACTIVATION_NAMES if name != "step"])
def test_the_real_functions_are_those_of_neat_python(name: str) -> None:
    theirs = ActivationFunctionSet().get(name)
    z = np.linspace(-20.0, 20.0, 2001)
    # neat-python clips some arguments where the function is flat to the last bit or nearly so.
    assert np.abs(real_function(name, z) - [theirs(float(value)) for value in z]).max() < 1e-12


def test_an_unknown_name_has_no_real_function() -> None:
    with pytest.raises(ValueError, match=r"^'cube' is no activation$"):
        real_function("cube", np.zeros(1))


def test_a_table_cannot_be_changed_by_who_reads_it() -> None:
    with pytest.raises(ValueError, match="read-only"):
        table("hat", 8)[0] = 1
