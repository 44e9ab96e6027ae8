# SPDX-License-Identifier: MIT
"""Signed powers of two."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from bitneat.controller.digits import LARGEST_SHIFTED_WEIGHT, signed_powers


@given(st.integers(-(2**20), 2**20))
def test_signed_powers_add_up_and_no_two_are_neighbours(value: int) -> None:
    digits = signed_powers(value)
    assert sum(sign << power for power, sign in digits) == value
    powers = [power for power, _ in digits]
    assert all(b - a >= 2 for a, b in pairwise(powers))


def test_the_largest_shifted_weight_is_the_last_without_a_shift_of_eight() -> None:
    assert all(power <= 7 for value in range(LARGEST_SHIFTED_WEIGHT + 1) for power, _ in signed_powers(value))
    assert signed_powers(LARGEST_SHIFTED_WEIGHT + 1)[-1][0] == 8
