# SPDX-License-Identifier: MIT
"""What places of a state keep, and what is taken to be true of states: guessed, and then shown."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bitneat.champion import Champion
from bitneat.codegen import STYLES, Style, generate
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.interval import Interval, Intervals, intervals
from bitneat.prove import proof as proving
from bitneat.prove import semantics
from bitneat.prove.check import prove
from bitneat.prove.places import one_each
from bitneat.prove.terms import Terms
from bitneat.verify.cfile import CFile
from tests.prove.campaign import box_action
from tests.prove.proving import compiled, controller_with_rare_values, controller_with_state, proof_of


@pytest.mark.parametrize("style", STYLES)
def test_places_of_the_state_that_look_alike_are_told_apart(style: Style, tmp_path: Path) -> None:
    drawn = controller_with_rare_values()
    code = CFile.write(generate(drawn, "legs", style), tmp_path)
    report = prove(Champion(drawn, box_action(1), None), [code], targets=["x86-64"], use_cache=False)
    assert report.passed


def test_places_are_guessed_to_keep_signals_in_their_order() -> None:
    alike = [6, 9, 11, 19]
    assert one_each([[7], alike, [10], alike, [18], alike, [], alike]) == [7, 9, 10, 11, 18, 19, None, 6]
    assert one_each([[2, 3, 1], [2, 3, 1]]) == [2, 3]
    assert one_each([[4], [4], [4]]) == [4, 4, 4]


def test_a_wrong_guess_of_what_a_place_keeps_is_given_up_for_another(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = controller_with_rare_values()
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    agreeing, given = proving.agreeing, []

    def wrong_at_first(
        executed: Any, model: Any, samples: Any, candidates: Sequence[Sequence[int]], tried: Sequence[Any]
    ) -> list[int | None] | None:
        given.append(samples)
        return (
            agreeing(executed, model, samples, candidates, tried) if tried else [found[0] for found in candidates[::-1]]
        )

    monkeypatch.setattr(proving, "agreeing", wrong_at_first)
    with compiled(code, "x86-64", "-O2") as emulated:
        found = proof_of(Champion(drawn, box_action(1), None), emulated, "x86-64")
    assert found.verdict == "proved", found.reason
    before, after = given
    changed = {row for atom in before for row in np.flatnonzero(before[atom] != after[atom])}
    assert changed == {1}  # to the state in which the wrong guess shows


def test_what_was_tried_is_not_guessed_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    drawn = controller_with_rare_values()
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    agreeing, guesses = proving.agreeing, []

    def again(executed: Any, model: Any, samples: Any, candidates: Any, tried: Sequence[Any]) -> Any:
        first = agreeing(executed, model, samples, candidates, tried)
        guesses.append((first, agreeing(executed, model, samples, candidates, [*tried, first])))
        return first

    monkeypatch.setattr(proving, "agreeing", again)
    with compiled(code, "x86-64", "-O2") as emulated:
        assert proof_of(Champion(drawn, box_action(1), None), emulated, "x86-64").verdict == "proved"
    ((first, second),) = guesses
    assert first is not None
    assert second != first


def test_a_state_by_a_wrong_guess_refutes_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(
        proving, "agreeing", lambda *arguments: None if arguments[4] else [found[0] for found in arguments[3]]
    )
    drawn = controller_with_rare_values()
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    report = prove(
        Champion(drawn, box_action(1), None), [code], targets=["x86-64"], optimizations=["-O2"], use_cache=False
    )
    step = report.pairs[0].functions[0]
    assert (step.verdict, step.counterexample) == ("not proved", None)
    assert step.reason == "output 0: can differ, if the state keeps what it seems to"


@pytest.mark.parametrize("style", STYLES)
def test_states_are_proved_by_induction_from_reset(style: Style, tmp_path: Path) -> None:
    drawn = controller_with_state()
    whose = Champion(drawn, box_action(3), None)
    code = CFile.write(generate(drawn, "legs", style), tmp_path)
    report = prove(whose, [code], targets=["cortex-m4"], optimizations=["-O2"], use_cache=False)
    assert [(one.function, one.verdict) for one in report.pairs[0].functions][:2] == [
        ("legs_step", "proved"),
        ("legs_reset", "proved"),
    ]
    assert report.passed


def test_a_reset_that_forgets_something_is_refused(tmp_path: Path) -> None:
    drawn = controller_with_state()
    whose = Champion(drawn, box_action(3), None)
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    before = code.source.index("_reset(")
    wrong = code.source[:before] + code.source[before:].replace("= 0;", "= 1;", 1)
    assert wrong != code.source
    code.path.write_text(wrong)
    report = prove(whose, [CFile.read(code.path)], targets=["cortex-m0"], optimizations=["-Os"], use_cache=False)
    assert {one.function: one.verdict for one in report.pairs[0].functions}["legs_reset"] == "not proved"


# What the model takes to be true of states --------------------------------------------------------------------------


def test_bounds_of_states_that_a_step_can_leave_are_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = controller_with_state()
    right = semantics.build(Terms(), drawn, guard=False)
    narrow = intervals(drawn)
    wrong = Intervals(tuple(Interval(-1, 1) for _ in narrow.signals), narrow.nodes)
    monkeypatch.setattr(semantics, "intervals", lambda controller: wrong)
    model = semantics.build(Terms(), drawn, guard=False)
    assert [(atom.low, atom.high) for atom in model.free] != [(-1, 1)] * len(model.free)
    for before, after in zip(model.free, right.free, strict=True):
        assert before.low <= after.low <= after.high <= before.high


@pytest.mark.parametrize("value", [0, 5])
def test_a_constant_that_a_step_changes_is_not_believed(value: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = controller_with_state()
    found = intervals(drawn)
    for signal in range(2, drawn.num_signals):
        bounds = [*found.signals]
        bounds[signal] = Interval(value, value)
        monkeypatch.setattr(semantics, "intervals", lambda _, b=bounds: Intervals(tuple(b), found.nodes))
        model = semantics.build(Terms(), drawn, guard=False)
        assert not model.constant
        assert not model.previous[signal].is_const


def test_a_constant_that_a_step_can_leave_for_what_it_was_at_reset_is_not_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes = (Node((Link(0),), 0, 0, "step"), Node((Link(1, delay=1), Link(0)), 0, 0, "identity"))
    drawn = Controller((Input(limit=9),), nodes, (Signal(2),), 8)
    found = intervals(drawn)
    wrong = Intervals((found.signals[0], Interval(256, 256), found.signals[2]), found.nodes)
    monkeypatch.setattr(semantics, "intervals", lambda _: wrong)
    model = semantics.build(Terms(), drawn, guard=False)
    assert found.signals[1] == (0, 256)
    assert not model.constant
    assert "started" not in [atom.name for atom in model.free]


def test_what_is_the_same_after_every_step_is_one_unknown_before_it() -> None:
    nodes = (
        Node((Link(0),), 1 << 20, 0, "clamped"),
        Node((Link(0, sign=-1),), -(1 << 20), 0, "clamped"),
        Node((Link(0),), -(1 << 20), 0, "relu"),
        Node((Link(1, delay=1), Link(2, delay=1), Link(3, delay=1), Link(0)), 0, 0, "identity"),
    )
    drawn = Controller((Input(limit=9),), nodes, (Signal(4),), 8)
    terms = Terms()
    model = semantics.build(terms, drawn, guard=False)
    assert model.constant == {1: 256, 2: -256, 3: 0}
    assert model.previous[3] is terms.const(32, 0)
    assert model.previous[1] is terms.neg(model.previous[2])
    assert [(atom.name, atom.low, atom.high) for atom in model.free if atom.name == "started"] == [("started", 0, 1)]
    assert model.outputs[0] is terms.var(model.inputs[0], 32)  # the two cancel


def test_nodes_that_only_seemed_equal_are_told_apart_before_anything_is_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes = tuple(Node((Link(i), Link(2 + i, delay=1)), 0, 0, "clamped") for i in range(2))
    drawn = Controller((Input(limit=9), Input(limit=9)), nodes, (Signal(2), Signal(3)), 8)
    monkeypatch.setattr(semantics, "_seen_equal", lambda controller: [0, 1, 2, 2])
    model = semantics.build(Terms(), drawn, guard=False)
    assert model.previous[2] is not model.previous[3]


def test_signals_that_were_equal_by_chance_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = controller_with_state()
    right = semantics.build(Terms(), drawn, guard=False)
    monkeypatch.setattr(semantics, "_seen_equal", lambda controller: [0] * controller.num_signals)
    model = semantics.build(Terms(), drawn, guard=False)
    assert len(model.free) == len(right.free)
    assert model.previous[2] is model.previous[3]
    assert model.previous[0] is not model.previous[2]
