# SPDX-License-Identifier: MIT
"""Cycles of a Cortex-M0 by Arm's table, on code by hand."""

import pytest

from bitneat.errors import BitneatError
from bitneat.verify.targets.cortex_m0 import cycles

CODE = bytes.fromhex("00d4 0020 7047")  # bmi to the return; movs r0, #0; bx lr


@pytest.mark.parametrize(("path", "expected"), [((0, 2, 4), 1 + 1 + 3), ((0, 4), 3 + 3)])
def test_a_branch_over_one_instruction_costs_what_a_branch_costs(path: tuple[int, ...], expected: int) -> None:
    assert cycles(CODE, 0, path) == expected


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("03b4", 1 + 2),  # push {r0, r1}
        ("10b5", 1 + 2),  # push {r4, lr}
        ("10bd", 4 + 2),  # pop {r4, pc}
        ("07c8", 1 + 3),  # ldm r0!, {r0, r1, r2}
        ("0ec0", 1 + 3),  # stm r0!, {r1, r2, r3}
        ("00f000f8", 4),  # bl
        ("0868", 2),  # ldr r0, [r1]
    ],
)
def test_each_costs_what_arms_table_says(code: str, expected: int) -> None:
    assert cycles(bytes.fromhex(code + "7047"), 0, (0, len(code) // 2)) == expected + 3


def test_code_may_lie_anywhere() -> None:
    assert cycles(CODE, 0x800, (0x800, 0x802, 0x804)) == 1 + 1 + 3


def test_a_return_by_pop_costs_the_same_wherever_it_leads() -> None:
    assert cycles(bytes.fromhex("10b510bd"), 0, (0, 2)) == 3 + 6


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("4843", "muls r0, r1, r0: .* gives no cycles that always hold"),
        ("ffff", "0x20: cannot disassemble what was executed"),
    ],
)
def test_what_has_no_known_cycles_is_refused(code: str, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        cycles(bytes.fromhex(code), 32, (32,))
