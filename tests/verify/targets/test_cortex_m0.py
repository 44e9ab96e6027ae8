# SPDX-License-Identifier: MIT
"""Cycles of a Cortex-M0 by Arm's table, on code by hand."""

import pytest

from bitneat.verify.targets.cortex_m0 import cycles

CODE = bytes.fromhex("00d4 0020 7047")  # bmi to the return; movs r0, #0; bx lr


@pytest.mark.parametrize(("path", "expected"), [((0, 2, 4), 1 + 1 + 3), ((0, 4), 3 + 3)])
def test_a_branch_over_one_instruction_costs_what_a_branch_costs(path: tuple[int, ...], expected: int) -> None:
    assert cycles(CODE, 0, path) == expected
