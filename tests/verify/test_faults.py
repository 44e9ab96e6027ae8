# SPDX-License-Identifier: MIT
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bitneat.champion import Champion
from bitneat.codegen import STYLES
from bitneat.controller import Controller, Input, Signal
from bitneat.errors import BitneatError
from bitneat.native.compiler import CompilerError, host_compiler
from bitneat.verify import campaign as under_test
from bitneat.verify import faults
from bitneat.verify.campaign import run_campaign, verify_fault
from bitneat.verify.check import Settings, verify
from bitneat.verify.faults import choose, plant
from bitneat.verify.implementation import HostC, ImplementationError
from bitneat.verify.loop import LoopResult
from bitneat.verify.targets import select
from tests.verify.champions import champion, plain_champion, written

RECORDED = Settings(episodes=2, max_steps=60, record=True)


@pytest.mark.parametrize("style", STYLES)
def test_a_fault_is_one_bit_of_one_number(style: str, tmp_path: Path) -> None:
    code = written(champion("CartPole-v1", seed=1, recurrent=True), tmp_path, style)  # type: ignore[arg-type]
    for number in range(60):
        fault = choose(code, number)
        assert (int(fault.before, 0) ^ int(fault.after, 0)).bit_count() == 1
        assert len(fault.before) == len(fault.after) or not fault.before.startswith("0x")
        assert code.source[fault.start : fault.end] == fault.before
        line = code.source.splitlines()[fault.line - 1]
        assert fault.before in line
        assert not re.match(r"\s*(#|/\*|static const)", line)
        assert choose(code, number) == fault


def test_faults_fall_on_the_table_and_on_the_code(tmp_path: Path) -> None:
    code = written(champion(seed=1), tmp_path, "table")
    kinds = Counter(choose(code, number).what.split()[0] for number in range(200))
    assert min(kinds["byte"], kinds["a"]) > 20


def test_the_original_is_not_touched(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    before = (code.path.read_bytes(), code.header_path.read_bytes())
    verify_fault(whose, code, 0, select(["host-unrolled"]), Settings(episodes=1, max_steps=20))
    assert (code.path.read_bytes(), code.header_path.read_bytes()) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["legs.c", "legs.h"]


def test_a_planted_fault_makes_verify_fail(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    number = next(n for n in range(1000) if choose(code, n).what.startswith("byte 0") and choose(code, n).bit < 6)
    fault, report = verify_fault(whose, code, number, select(["host-unrolled"]), Settings(episodes=1, max_steps=20))
    assert str(fault).startswith(f"line {fault.line}: bit {fault.bit} of byte 0 of legs_weights: 0x25 becomes 0x")
    assert not report.passed
    assert report.mismatch is not None
    assert report.warnings == ()


@pytest.mark.parametrize("style", STYLES)
def test_most_faults_are_caught_and_each_survivor_is_explained(style: str, tmp_path: Path) -> None:
    whose = champion("CartPole-v1" if style == "table" else "Pendulum-v1", seed=4, recurrent=style == "table")
    code = written(whose, tmp_path, style)  # type: ignore[arg-type]
    report = verify(whose, code, select([f"host-{style}"]), RECORDED)
    assert report.passed
    assert report.loop is not None
    results = list(run_campaign(whose, code, report.loop.episodes, host_compiler(), 12))
    assert [result.number for result in results] == list(range(12))
    assert sum(result.caught for result in results) >= 10
    for result in results:
        if not result.caught:
            assert "equivalent or unreachable" in result.detail or "not reached" in result.detail


def test_a_survivor_that_other_inputs_show_has_a_counterexample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    report = verify(whose, code, select(["host-unrolled"]), RECORDED)
    assert report.loop is not None
    # A fault that needs a large sum, and a verify that sees hardly any input at all.
    number = next(n for n in range(2000) if choose(code, n).before == "256" and choose(code, n).bit == 8)
    monkeypatch.setattr(under_test, "domain_vectors", lambda controller: (report.loop.episodes[0].inputs[:0], 1))  # type: ignore[union-attr, index]
    campaign = under_test.Campaign(whose, code, (), host_compiler(), tmp_path / "faulty")
    (tmp_path / "faulty").mkdir()
    result = campaign.judge(number)
    assert (result.outcome, result.caught) == ("unreached", False)
    assert result.counterexample is not None


def test_code_that_crashes_or_does_not_compile_counts_as_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    report = verify(whose, code, select(["host-unrolled"]), RECORDED)
    assert report.loop is not None
    outcomes = []
    for text in ("*(volatile int *)0 = 1; action[0] =", "nonsense; action[0] ="):
        monkeypatch.setattr(under_test, "plant", lambda code, fault, folder, text=text: plant_text(code, folder, text))
        (result,) = run_campaign(whose, code, report.loop.episodes, host_compiler(), 1)
        outcomes.append(result.outcome)
    assert outcomes == ["crash", "compile"]


def judged(
    outputs: np.ndarray, decisions: np.ndarray | None, whose: Champion, folder: Path, loop: LoopResult, *, chooses: bool
) -> Any:
    """What the campaign says of code that answers the episodes with these outputs and decisions."""
    campaign = under_test.Campaign(whose, written(whose, folder), loop.episodes, host_compiler(), folder)
    assert campaign._code.has_decide == chooses
    code: Any = SimpleNamespace(reset=lambda: None, run=lambda inputs: outputs, decisions=lambda rows: decisions)
    return campaign._difference([code], campaign._loop)


def test_the_first_wrong_output_or_decision_is_named(tmp_path: Path) -> None:
    whose = champion("CartPole-v1", seed=4)
    loop = verify(whose, written(whose, tmp_path), select(["host-unrolled"]), RECORDED).loop
    assert loop is not None
    episode = loop.episodes[0]
    assert episode.outputs is not None
    assert episode.inputs is not None
    right = np.array([[whose.action.decode(row, 8)] for row in episode.outputs], np.int32)
    arguments: Any = (whose, tmp_path, replace(loop, episodes=(episode,)))
    assert judged(episode.outputs, right, *arguments, chooses=True) is None
    wrong = episode.outputs.copy()
    wrong[3:, 1] += 1
    seen = judged(wrong, right, *arguments, chooses=True)
    assert seen is not None
    place = f"episode 0 (seed {episode.seed}), step 3"
    assert seen.text == f"{place}: output 1 is {wrong[3, 1]}, expected {wrong[3, 1] - 1}"
    assert seen.inputs == tuple(episode.inputs[3].tolist())
    others = right.copy()
    others[3:] = 1 - others[3:]
    seen = judged(episode.outputs, others, *arguments, chooses=True)
    assert seen is not None
    assert seen.text == f"{place}: the decision is {others[3, 0]}, expected {right[3, 0]}"
    pendulum = plain_champion()
    loop = verify(pendulum, written(pendulum, tmp_path), select(["host-unrolled"]), RECORDED).loop
    assert loop is not None
    same = loop.episodes[0].outputs
    assert same is not None
    whole = replace(loop, episodes=loop.episodes[:1])
    assert judged(same, None, pendulum, tmp_path, whole, chooses=False) is None


@pytest.mark.parametrize("dies", [False, True])
def test_a_survivor_is_equivalent_as_far_as_can_be_seen_or_crashes_on_others(dies: bool, tmp_path: Path) -> None:
    whose = champion("CartPole-v1", seed=4, recurrent=True)
    code = written(whose, tmp_path)
    campaign = under_test.Campaign(whose, code, (), host_compiler(), tmp_path)
    with HostC(code) as original:
        one: Any = original
        if dies:
            one = SimpleNamespace(reset=lambda: None, run=raising("crashed (SIGILL)"))
        result = campaign._survivor(7, choose(code, 7), [one])
    assert (result.number, result.caught, result.counterexample) == (7, False, None)
    assert (result.outcome, result.detail) == (
        ("unreached", "not reached by these inputs: on others it crashed (SIGILL)")
        if dies
        else ("equivalent", "no difference on 100000 random vectors: equivalent or unreachable")
    )


def test_a_table_that_codegen_does_not_write_is_caught_where_no_output_shows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    monkeypatch.setattr(under_test, "plant", lambda code, fault, folder: code)
    campaign = under_test.Campaign(whose, code, (), host_compiler(), tmp_path)
    campaign._weights = b"another"
    result = campaign.judge(5)
    assert (result.outcome, result.caught) == ("table", True)
    assert result.detail == "legs.c: its weight table is not the one that codegen writes"


def raising(reason: str) -> Callable[..., Any]:
    def run(*arguments: object) -> None:
        raise ImplementationError(reason)

    return run


def test_targets_that_do_not_run_the_file_are_refused_by_its_own_name(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    with pytest.raises(BitneatError, match=rf"no target of these runs {re.escape(str(code.path))} \(style unrolled\)"):
        verify_fault(whose, code, 3, select(["host-table"]), RECORDED)


def test_code_without_a_table_has_faults_in_its_numbers_alone(tmp_path: Path) -> None:
    whose = replace(plain_champion(), controller=Controller((Input(0, 256),) * 3, (), (Signal(1),), 8))
    code = written(whose, tmp_path)
    assert code.table is None
    found = {choose(code, number).what for number in range(50)}
    assert found
    assert not any("byte" in what for what in found)


def test_a_fault_that_does_not_compile_fails_a_verify(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise CompilerError("cc: legs.c: failed: nonsense")

    monkeypatch.setattr(under_test, "verify", refuse)
    whose = plain_champion()
    code = written(whose, tmp_path)
    _, report = verify_fault(whose, code, 3, select(["host-unrolled"]), Settings(episodes=1, max_steps=2))
    assert not report.passed
    assert report.failures == ("cc: legs.c: failed: nonsense",)
    assert report.code.path == code.path
    assert report.environment_id == "Pendulum-v1"
    assert report.to_data()["verdict"] == "fail"


def plant_text(code, folder, text):  # type: ignore[no-untyped-def]
    faulty = plant(code, choose(code, 0), folder)
    faulty.path.write_text(code.source.replace("action[0] =", text))
    return type(faulty).read(faulty.path)


def test_no_fault_is_planted_where_only_another_chips_compiler_looks() -> None:
    source = (
        "#if defined(__clang__) && defined(__AVR__)\nx = 1;\n#if 1\nx = 2;\n#endif\n"
        "#elif !defined(__AVR__)\nx = 3;\n#else\nx = 4;\n#endif\nx = 5;\n"
    )
    assert re.findall(r"\d(?=;)", faults._without_other_chips(source)) == ["3", "4", "5"]
