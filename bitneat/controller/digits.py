# SPDX-License-Identifier: MIT
"""Integers as sums of few signed powers of two, which is what shifted links of weight ±1 can express."""

from __future__ import annotations

from bitneat.controller.ir import SHIFT_RANGE

LARGEST_SHIFTED_WEIGHT = sum(1 << shift for shift in range(SHIFT_RANGE[1], -1, -2))
"""The largest integer whose canonical signed digits are shifts of a link."""


def signed_powers(value: int) -> list[tuple[int, int]]:
    """The canonical signed digits of an integer: (power, sign) with no two neighbouring powers, the lowest power first.

    No sum of signed powers of two has fewer terms (Reitwiesner 1960).
    """
    digits = []
    power = 0
    while value:
        if value & 1:
            sign = 2 - (value & 3)  # 1 or -1, whichever leaves a number divisible by four
            digits.append((power, sign))
            value -= sign
        value >>= 1
        power += 1
    return digits


def halved(value: int) -> int:
    """Half an integer, toward zero: what is left of a weight at half the resolution."""
    return value // 2 if value >= 0 else -(-value // 2)
