# SPDX-License-Identifier: MIT
"""Cycles counted by hand from Arm's table against those of the module."""

import pytest

from bitneat.errors import BitneatError
from bitneat.verify.targets.cortex_m0 import cycles

BASE = 0x10000


def code(*words: int) -> bytes:
    return b"".join(word.to_bytes(2, "little") for word in words)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((0x1840, 0x4770), 1 + 3),  # adds r0, r0, r1; bx lr
        ((0x8801, 0x8041, 0x4770), 2 + 2 + 3),  # ldrh r1, [r0]; strh r1, [r0, #2]; bx lr
        ((0xB570, 0x1840, 0xBD70), (1 + 4) + 1 + (4 + 4)),  # push {r4-r6, lr}; adds; pop {r4-r6, pc}
        ((0xC830, 0xC130, 0x4770), 3 + 3 + 3),  # ldm r0!, {r4, r5}; stm r1!, {r4, r5}; bx lr
        ((0x4640, 0xB082, 0xB002, 0x4770), 1 + 1 + 1 + 3),  # mov r0, r8; sub sp; add sp; bx lr
    ],
)
def test_a_straight_run_takes_what_the_table_says(words: tuple[int, ...], expected: int) -> None:
    path = tuple(BASE + 2 * at for at in range(len(words)))
    assert cycles(code(*words), BASE, path) == expected


def test_a_branch_costs_more_if_it_is_taken() -> None:
    words = (0x3801, 0xD1FD, 0x4770)  # again: subs r0, #1; bne again; bx lr
    twice = (BASE, BASE + 2, BASE, BASE + 2, BASE + 4)
    assert cycles(code(*words), BASE, twice) == 1 + 3 + 1 + 1 + 3


def test_a_call_is_four_bytes_and_four_cycles() -> None:
    words = (0xF000, 0xF801, 0x4770, 0x4770)  # bl +2; bx lr; bx lr
    assert cycles(code(*words), BASE, (BASE, BASE + 6, BASE + 4)) == 4 + 3 + 3


def test_a_multiplication_has_no_fixed_cycles() -> None:
    with pytest.raises(BitneatError, match=r"muls .* gives no cycles that always hold"):
        cycles(code(0x4348, 0x4770), BASE, (BASE, BASE + 2))
