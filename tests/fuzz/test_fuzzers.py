# SPDX-License-Identifier: MIT
"""The other fuzzers, briefly; the driver; and the figures that docs/verification.md shows."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from bitneat.controller import Controller
from tests.fuzz import __main__ as driver
from tests.fuzz import activations, agreement, figures, steps
from tests.fuzz.target import ROOT, Batch, FindingError, Target


def test_random_controllers_step_alike_everywhere(budget: int) -> None:
    batch = steps.compare(range(steps.FIRST_SEED, steps.FIRST_SEED + 3 * budget), "-O0")
    assert batch.count == 3 * budget * steps.STEPS


def test_the_drawn_steps_hold_extremes_and_constant_sequences() -> None:
    cases = [steps.drawn_case(seed) for seed in range(40)]
    recurrent = [case for case in cases if case.controller.is_recurrent]
    assert 5 < len(recurrent) < 35
    for case in cases:
        limits = np.array([entry.limit for entry in case.controller.inputs])
        assert case.inputs.shape[0] * case.inputs.shape[1] == steps.STEPS
        assert (abs(case.inputs.astype(int)) <= limits).all()
        for extreme in (limits, -limits, 0 * limits):
            assert (case.inputs == extreme).all(axis=2).any()
    for case in recurrent:
        assert (case.inputs == case.inputs[:, :1]).all(axis=(1, 2)).sum() >= 3


def test_a_difference_in_what_blobs_mean_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checker = agreement.build(tmp_path)
    blobs = agreement.valid_blobs(range(20))
    assert agreement.compare(checker, blobs) == len(blobs)

    def misread(blob: bytes) -> Controller:
        controller = original(blob)
        nodes = tuple(dataclasses.replace(node, bias=node.bias // 2 + 1) for node in controller.nodes)
        return dataclasses.replace(controller, nodes=nodes)

    original = agreement.unpack
    monkeypatch.setattr(agreement, "unpack", misread)
    with pytest.raises(FindingError, match="outputs differ"):
        agreement.compare(checker, blobs)


def test_a_wrong_activation_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    some = activations.ARGUMENTS[::97]
    assert activations.compare("host-unrolled", 8, some) == some.size * 10
    original = activations.table
    monkeypatch.setattr(activations, "table", lambda name, f: original(name, f) + (name == "sin"))
    with pytest.raises(FindingError, match=r"sin\(-32767\) at F=8 on host-unrolled"):
        activations.compare("host-unrolled", 8, some)


@pytest.fixture
def counting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The driver with a fuzzer that notes which batches it ran, and finds something in batch 5."""
    ran: list[int] = []

    def run(number: int) -> Batch:
        if number == 5:
            raise FindingError("it is odd")
        ran.append(number)
        return Batch(10, {"pairs": 5})

    monkeypatch.setattr(figures, "WORK", tmp_path)
    monkeypatch.setattr(figures, "FIGURES", tmp_path / "figures.json")
    monkeypatch.setattr(driver, "TARGETS", {"counting": Target("counts", "cases", "-", lambda: "none", run)})
    return ran


def run_driver(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["python -m tests.fuzz", "counting", *arguments])
    return driver.main()


def test_a_fuzzer_goes_on_where_it_stopped(counting: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_driver(monkeypatch, "--count", "15") == 0
    assert counting == [0, 1]
    assert run_driver(monkeypatch, "--count", "40", "--record") == 0
    assert counting == [0, 1, 2, 3]
    figure = json.loads(figures.FIGURES.read_text())["counting"]
    assert (figure["count"], figure["also"], figure["findings"]) == (40, {"pairs": 20}, 0)
    assert run_driver(monkeypatch, "--count", "10", "--fresh") == 0
    assert counting == [0, 1, 2, 3, 0]


def test_a_finding_ends_the_run_and_is_not_recorded(
    counting: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_driver(monkeypatch, "--count", "100", "--record") == 1
    assert "FOUND it is odd" in capsys.readouterr().err
    assert counting == [0, 1, 2, 3, 4]
    assert not figures.FIGURES.exists()
    assert run_driver(monkeypatch, "--batch", "5") == 1


def test_the_page_shows_the_figures_that_were_recorded() -> None:
    """If not: put what ``python -m tests.fuzz table`` prints into docs/verification.md."""
    assert figures.table(figures.committed()) in (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")


def test_the_recorded_figures_are_as_large_as_they_have_to_be() -> None:
    done = figures.committed()
    assert all(figure["findings"] == 0 for figure in done.values())
    assert done["activations"]["count"] == activations.TOTAL
    assert done["steps"]["count"] >= 10**7
    assert done["steps"]["also"]["controllers"] >= 10**4
    assert done["blobs"]["count"] >= 10**7
    assert sum(done[name]["count"] for name in ("champions", "configs")) >= 10**6
