# SPDX-License-Identifier: MIT
"""Proofs of right binaries, and of binaries with planted faults, which must be refused."""

import csv
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bitneat.champion import Champion, load
from bitneat.codegen import STYLES, Style, generate
from bitneat.controller import Controller, DiscreteAction, Input, Link, Node, Reference, Signal
from bitneat.controller.interval import Interval
from bitneat.prove import execute, operations, semantics
from bitneat.prove.check import PROCESSORS, prove
from bitneat.prove.equivalence import Lemmas
from bitneat.prove.proof import prove_function
from bitneat.prove.subject import Subject
from bitneat.prove.terms import Atom, Terms
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import HostC, entries
from bitneat.verify.vectors import random_vectors
from tests.prove.campaign import COUNT, EVERYWHERE, TABLE, box_action, case, prove_case
from tests.prove.faults import FAULTS, Fault
from tests.prove.proving import CHAMPIONS, compiled, controller_with_state, proof_of
from tests.verify.champions import champion, plain_champion, written


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize(("target", "level"), [("x86-64", "-O3"), ("cortex-m0", "-Os"), ("cortex-m4", "-O2")])
def test_a_committed_champion_is_proved(style: Style, target: str, level: str, tmp_path: Path) -> None:
    whose = load(CHAMPIONS / "tiny.pkl")
    code = written(whose, tmp_path, style)
    for entry in entries(code):
        with compiled(code, target, level, entry) as emulated:
            proof = proof_of(whose, emulated, target)
        assert proof.verdict == "proved", proof.reason


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("target", ["x86-64", "cortex-m0"])
def test_the_stack_is_the_one_that_verify_measures(style: Style, target: str, tmp_path: Path) -> None:
    whose = load(CHAMPIONS / "tiny.pkl")
    with compiled(written(whose, tmp_path, style), target) as emulated:
        proof = proof_of(whose, emulated, target)
        traced = emulated.trace(random_vectors(whose.controller, 1, 1), 1)
    assert proof.stack_bytes == traced.stack


def test_a_choice_among_actions_is_proved_and_a_wrong_one_is_not(tmp_path: Path) -> None:
    whose = champion("CartPole-v1")
    assert isinstance(whose.action, DiscreteAction)
    code = written(whose, tmp_path)
    report = prove(whose, [code], targets=["x86-64"], optimizations=["-O2"], use_cache=False)
    assert {one.function: one.verdict for one in report.pairs[0].functions} == {
        "legs_step": "proved",
        "legs_decide": "proved",
    }
    wrong = Champion(whose.controller, DiscreteAction(whose.action.n, whose.action.start + 1), whose.environment)
    refused = prove(wrong, [code], targets=["x86-64"], optimizations=["-O2"], use_cache=False)
    assert {one.function: one.verdict for one in refused.pairs[0].functions}["legs_decide"] == "not proved"


def test_a_value_that_is_a_line_where_it_lies_is_taken_for_one(tmp_path: Path) -> None:
    moved = Node((Link(0),), 512, 0, "identity")  # 256 to 768, and 0 after a reset
    turned = Node((Link(1, sign=-1),), 0, 0, "abs")
    after = Node((Link(1, delay=1), Link(2, delay=1, shift=1)), 0, 0, "clamped")
    drawn = Controller((Input(limit=256),), (moved, turned, after), (Signal(3), Signal(2)), 8)
    model = semantics.build(Terms(), drawn, guard=False)
    assert model.previous[2] is model.previous[1]
    code = CFile.write(generate(drawn, "legs", "table"), tmp_path)
    report = prove(Champion(drawn, box_action(2), None), [code], targets=["x86-64"], use_cache=False)
    assert report.passed


@pytest.mark.parametrize("delay", [0, 1])
def test_a_value_is_within_what_its_activation_can_give_where_it_is_a_multiple_of_another(
    delay: int, tmp_path: Path
) -> None:
    """Near 0 `hat` is One less a magnitude, of which the terms alone would not tell that it is none below 0."""
    near = Node((Link(0),), 0, -3, "hat")
    after = Node((Link(1, delay=delay), Link(0, delay=1)), 0, 0, "clamped")
    drawn = Controller((Input(limit=1000),), (near, after), (Signal(2),), 8)
    model = semantics.build(Terms(), drawn, guard=False)
    assert (model.signals[1].low, model.signals[1].high) == (256 - 125, 256)
    code = CFile.write(generate(drawn, "legs", "table"), tmp_path)
    report = prove(Champion(drawn, box_action(1), None), [code], targets=["cortex-m0"], use_cache=False)
    assert report.passed


@pytest.mark.parametrize(
    ("bounds", "constant", "factor", "found"),
    [
        ((0, 7), 1, 2, (0, 3)),
        ((0, 7), 1, -2, (-3, 0)),
        ((-100, 100), 0, 1, (-10, 10)),
        ((-5, 5), 1 << 31, 1, None),
    ],
)
def test_bounds_of_a_part_are_those_of_the_whole(
    bounds: tuple[int, int], constant: int, factor: int, found: tuple[int, int] | None
) -> None:
    part = Terms().var(Atom("part", -10, 10), 32)
    expected = None if found is None else Interval(*found)
    assert semantics._unscaled_bounds(Interval(*bounds), part, constant, factor) == expected


def test_a_value_is_found_where_code_takes_its_magnitude_first_and_that_is_another_value(tmp_path: Path) -> None:
    turned = Node((Link(0), Link(1)), 0, -1, "tanh")
    large = Node((Link(2),), 0, 0, "abs")
    after = Node((Link(2, shift=2), Link(3), Link(0, sign=-1)), 0, 0, "clamped")
    drawn = Controller((Input(), Input()), (turned, large, after), (Signal(4), Signal(3)), 12)
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    report = prove(Champion(drawn, box_action(2), None), [code], targets=["cortex-m0"], use_cache=False)
    assert report.passed
    assert [pair.functions[0].effort.solver for pair in report.pairs] == [0, 0, 0, 0]


ONCE_NOT_PROVED = [178, 201, 230, 284, 295, 404, 549, 595, 648, 690, 823, 944]


@pytest.mark.parametrize("seed", [50, 51, 52, 53, *ONCE_NOT_PROVED])
def test_random_controllers_are_proved(seed: int) -> None:
    for pair in prove_case(case(seed)):
        assert pair.proved, f"seed {seed}: {pair.target} {pair.optimization}: {pair.to_data()}"


@pytest.mark.long
def test_a_thousand_random_controllers_are_proved() -> None:
    for seed in range(COUNT):
        for pair in prove_case(case(seed)):
            assert pair.proved, f"seed {seed}: {pair.target} {pair.optimization}: {pair.to_data()}"


def test_the_table_of_proofs_is_what_the_page_says() -> None:
    rows = list(csv.DictReader(TABLE.read_text().splitlines()))
    assert {row["verdict"] for row in rows} == {"proved"}
    seeds = Counter(int(row["seed"]) for row in rows)
    assert seeds == {seed: 12 if seed < EVERYWHERE else 1 for seed in range(COUNT)}
    page = (TABLE.parent / "verification.md").read_text(encoding="utf-8")
    assert f"| all {COUNT} proved, the first {EVERYWHERE} at all twelve compilations, the others at one each" in page


@pytest.mark.parametrize("target", ["x86-64", "cortex-m0"])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_is_refused(fault: Fault, target: str, tmp_path: Path) -> None:
    if fault.only not in ("", target):
        return
    whose = plain_champion()
    code = faulty(whose, fault, tmp_path)
    with compiled(code, target) as emulated:
        proof = proof_of(whose, emulated, target)
        assert proof.verdict != "proved"
        if fault.shows:
            found = proof.counterexample
            assert found is not None, proof.reason
            inputs = np.array(found.sequence[-1], dtype=np.int16)
            assert Reference(whose.controller).step(found.sequence[-1]) == list(found.expected)
            assert tuple(emulated.step(inputs)) == found.found != found.expected


def faulty(whose: Champion, fault: Fault, folder: Path) -> CFile:
    code = written(whose, folder)
    text = code.source.replace("const unsigned n0", "unsigned n0")
    if fault.line:
        text = text.replace("    action[0]", f"    {fault.line}\n    action[0]", 1)
    else:
        assert fault.old in text
        text = text.replace(fault.old, fault.new)
    code.path.write_text(text)
    return CFile.read(code.path)


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.rare], ids=lambda fault: fault.name)
def test_a_million_random_vectors_miss_the_rare_ones(fault: Fault, tmp_path: Path) -> None:
    whose = plain_champion()
    vectors = random_vectors(whose.controller, 7, 1_000_000)
    right = written(whose, tmp_path, stem="right")
    with HostC(right) as sound, HostC(faulty(whose, fault, tmp_path)) as wrong:
        for start in range(0, len(vectors), 100_000):
            rows = vectors[start : start + 100_000]
            assert (sound.run(rows) == wrong.run(rows)).all()


def test_one_value_of_a_sum_too_wide_to_be_tried_whole_is_found(tmp_path: Path) -> None:
    drawn = Controller((Input(),) * 20, (Node(tuple(Link(i) for i in range(20)), 0, -3, "clamped"),), (Signal(20),), 8)
    whose = Champion(drawn, box_action(1), None)
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    with compiled(code, "x86-64") as emulated:
        assert proof_of(whose, emulated, "x86-64").verdict == "proved"
    text = code.source.replace("    action[0] = legs_signal(n0)", "    action[0] = legs_signal(n0 ^ (sum0 == 654321U))")
    assert text != code.source
    code.path.write_text(text)
    with compiled(CFile.read(code.path), "x86-64") as emulated:
        proof = proof_of(whose, emulated, "x86-64")
    assert proof.verdict == "refuted", proof.reason
    assert proof.counterexample is not None
    assert sum(proof.counterexample.sequence[-1]) == 654321


def test_machine_code_without_one_of_its_additions_is_refused(tmp_path: Path) -> None:
    whose = load(CHAMPIONS / "walker.pkl")
    code = written(whose, tmp_path)
    inputs = random_vectors(whose.controller, 1, 3)
    with compiled(code, "cortex-m4") as emulated:
        faults = emulated.faults(inputs)
    assert len(faults) >= 30
    for what, wrong in random.Random(1).sample(faults, 12):
        assert proof_of(whose, wrong, "cortex-m4").verdict != "proved", what
        wrong.close()


def test_instructions_that_are_lifted_wrong_are_seen_in_the_emulator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    operations.operation.cache_clear()
    monkeypatch.setitem(operations._SCALAR, "Add", lambda t, x, y: t.add(x, y, t.const(x.width, x.width == 32)))
    with compiled(code, "cortex-m0", "-O0") as emulated:
        proof = proof_of(whose, emulated, "cortex-m0")
    operations.operation.cache_clear()
    assert proof.verdict == "not proved"


def test_a_binary_that_is_right_only_as_it_is_lifted_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = faulty(whose, Fault("its lowest bit", "n0 ^= 1U;"), tmp_path)
    operations.operation.cache_clear()
    monkeypatch.setitem(operations._SCALAR, "Xor", lambda t, x, y: x)
    with compiled(code, "cortex-m0") as emulated:
        proof = proof_of(whose, emulated, "cortex-m0")
    operations.operation.cache_clear()
    assert proof.verdict == "refuted"
    assert "the emulator computes something else" in proof.reason


def test_a_choice_that_is_right_only_as_it_is_lifted_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = champion("CartPole-v1")
    code = written(whose, tmp_path)
    right, wrong = "return (int32_t)index", "return (int32_t)(index | (best & 4U))"
    assert code.source.count(right) == 1
    code.path.write_text(code.source.replace(right, wrong))
    operations.operation.cache_clear()
    monkeypatch.setitem(operations._SCALAR, "Or", lambda t, x, y: x)
    with compiled(CFile.read(code.path), "cortex-m0") as emulated:
        subject = Subject(whose.controller, emulated, PROCESSORS["cortex-m0"], Lemmas())
        proof = prove_function(subject, "decide")
    operations.operation.cache_clear()
    assert proof.verdict == "not proved"
    assert "the emulator computes something else" in proof.reason


def test_a_state_that_is_seldom_wrong_is_refused(tmp_path: Path) -> None:
    drawn = controller_with_state()
    whose = Champion(drawn, box_action(3), None)
    code = CFile.write(generate(drawn, "legs", "unrolled"), tmp_path)
    rare = "(uint32_t)((observation[0] == 217) & (observation[1] == -20217))"
    wrong = code.source.replace("delayed[0] = legs_signal(x1)", f"delayed[0] = legs_signal(x1 ^ {rare})")
    assert wrong != code.source
    code.path.write_text(wrong)
    with compiled(CFile.read(code.path), "cortex-m4") as emulated:
        proof = proof_of(whose, emulated, "cortex-m4")
    assert proof.verdict != "proved"
    assert proof.reason.startswith("state ")


def test_code_that_does_not_come_back_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execute, "MAX_INSTRUCTIONS", 2000)
    fault = Fault("a loop without end", "{ volatile int on = 1; while (on) { } }")
    with compiled(faulty(plain_champion(), fault, tmp_path), "cortex-m0") as emulated:
        monkeypatch.setattr("bitneat.prove.proof.search", lambda *arguments: None)
        proof = proof_of(plain_champion(), emulated, "cortex-m0")
    assert proof.verdict == "not proved"
    assert "did not come back" in proof.reason


def test_two_solvers_and_every_value_agree_where_they_are_asked_to(tmp_path: Path) -> None:
    whose = plain_champion()
    with compiled(written(whose, tmp_path, "table"), "x86-64", "-O2") as emulated:
        proof = proof_of(whose, emulated, "x86-64", paranoid=True)
    assert proof.verdict == "proved", proof.reason
    assert proof.effort.solver > 0
    assert proof.effort.exhaustive > 0
