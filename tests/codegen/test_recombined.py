# SPDX-License-Identifier: MIT
"""What a compiler could make a multiplication of is found, and only that."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from bitneat.codegen import generate
from bitneat.codegen.recombined import Recombined, recombined
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.interval import intervals
from bitneat.verify.cfile import CFile
from bitneat.verify.machine import examine
from bitneat.verify.targets.chips import CHIPS


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
    assert recombined(made, intervals(made).nodes) == Recombined(frozenset(found), frozenset())
    text = generate(made, "legs", "unrolled").source
    assert bool(re.search(r"legs_opaque\(sum0\) << ", text)) == bool(found)


def test_nothing_is_found_where_no_signal_comes_twice() -> None:
    nodes = (Node((Link(0),), 0, 1, "identity"), Node((Link(2), Link(1)), 0, 0, "identity"))
    made = Controller((Input(limit=255), Input(limit=255)), nodes, (Signal(3),), 8)
    assert recombined(made, intervals(made).nodes) == Recombined(frozenset(), frozenset())


def test_a_shifted_link_to_a_sum_of_what_is_read_besides() -> None:
    made = two_outputs(*MEETING["a shifted link"])
    assert recombined(made, intervals(made).nodes) == Recombined(frozenset(), frozenset({1}))
    assert "legs_opaque(n0 << 1)" in generate(made, "legs", "unrolled").source


def test_of_several_sums_each_is_followed() -> None:
    nodes = (
        Node((Link(0), Link(1, sign=-1)), 0, 0, "clamped"),
        Node((Link(1),), 0, 2, "identity"),
        Node((Link(3), Link(0)), 0, 0, "identity"),
        Node((Link(4), Link(1)), 0, 0, "identity"),
    )
    made = Controller((Input(limit=255), Input(limit=255)), nodes, tuple(Signal(2 + i) for i in range(4)), 8)
    assert recombined(made, intervals(made).nodes) == Recombined(frozenset({1}), frozenset())


@pytest.mark.parametrize(("limit", "found"), [(16384, {1}), (16385, set())])
def test_a_sum_that_is_clipped_is_no_longer_linear(limit: int, found: set[int]) -> None:
    made = replace(two_outputs(*MEETING["a shifted link"]), inputs=(Input(limit=16383), Input(limit=limit)))
    assert recombined(made, intervals(made).nodes) == Recombined(frozenset(), frozenset(found))


MEETING = {
    "a signal": (Node((Link(0),), 0, 1, "identity"), Node((Link(0), Link(2)), 0, 0, "identity")),
    "a sum": (Node((Link(0), Link(1)), 0, 1, "identity"), Node((Link(0), Link(1), Link(2)), 0, 0, "identity")),
    "a shifted link": (
        Node((Link(0), Link(1)), 0, 0, "identity"),
        Node((Link(0), Link(1), Link(2, shift=1)), 0, 0, "identity"),
    ),
}


def two_outputs(*nodes: Node) -> Controller:
    """Both nodes are outputs, so that neither becomes a part of the other."""
    return Controller((Input(limit=255), Input(limit=255)), nodes, (Signal(2), Signal(3)), 8)


@pytest.mark.parametrize("case", MEETING)
@pytest.mark.parametrize("target", ["wasm32", "ppc"])
def test_clang_multiplies_by_none_of_them(case: str, target: str, tmp_path: Path) -> None:
    made = two_outputs(*MEETING[case])
    (chip,) = (chip for chip in CHIPS if chip.name == target)
    toolchain = chip.toolchain()
    assert toolchain is not None
    assert examine(CFile.write(generate(made, "legs", "unrolled"), tmp_path), toolchain).violations == ()
