# SPDX-License-Identifier: MIT
"""What a compiler could make a multiplication of is found, and only that."""

from __future__ import annotations

import re

import pytest

from bitneat.codegen import generate
from bitneat.codegen.recombined import recombined
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.interval import intervals


def controller(gain: int, activation: str, other: int) -> Controller:
    """x0 doubled by a node, and x``other`` added to that."""
    nodes = (Node((Link(0), Link(1)), 0, gain, activation), Node((Link(2), Link(other)), 0, 0, "identity"))
    return Controller((Input(limit=255), Input(limit=255)), nodes, (Signal(3),), 8)


@pytest.mark.parametrize(
    ("gain", "activation", "other", "found"),
    [
        (1, "identity", 0, {0}),
        (3, "identity", 1, {0}),
        (1, "clamped", 0, set()),
        (0, "identity", 0, set()),
        (-1, "identity", 0, set()),
    ],
)
def test_a_shifted_sum_that_meets_what_it_is_made_of(gain: int, activation: str, other: int, found: set[int]) -> None:
    made = controller(gain, activation, other)
    assert recombined(made, intervals(made).nodes) == found
    text = generate(made, "legs", "unrolled").source
    assert bool(re.search(r"legs_opaque\(sum0\) << ", text)) == bool(found)


def test_nothing_is_found_where_no_signal_comes_twice() -> None:
    nodes = (Node((Link(0),), 0, 1, "identity"), Node((Link(2), Link(1)), 0, 0, "identity"))
    made = Controller((Input(limit=255), Input(limit=255)), nodes, (Signal(3),), 8)
    assert not recombined(made, intervals(made).nodes)
