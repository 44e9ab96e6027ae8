# SPDX-License-Identifier: MIT
"""What an expression of C that clips is made of."""

import pytest

from bitneat.codegen.sensor.emit import _Emitter
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
