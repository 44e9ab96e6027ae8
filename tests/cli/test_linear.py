# SPDX-License-Identifier: MIT
"""``bitneat linear`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.cli.main import main
from tests.cli.interrupts import check_interrupted


def test_walkers_end_the_same_whatever_runs_them_and_however_often_they_stop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["linear", "--pop", "8", "--seed", "7"]
    whole, parts = str(tmp_path / "whole"), str(tmp_path / "parts")
    assert main([*common, "--generations", "3", "-o", whole, "--json", str(tmp_path / "whole.json")]) == 0
    assert main([*common, "--generations", "2", "--workers", "1", "-o", parts]) == 0
    assert main(["linear", "--resume", parts, "--generations", "3"]) == 0
    assert (tmp_path / "whole/champion.pkl").read_bytes() == (tmp_path / "parts/champion.pkl").read_bytes()
    assert "held-out episodes" in capsys.readouterr().out
    summary = json.loads((tmp_path / "whole.json").read_text())
    assert summary["controller"]["ternary"]
    assert champions.load(tmp_path / "whole/champion.pkl").controller.sha256 == summary["controller"]["sha256"]
    assert main(["polish", whole + "/champion.pkl", "--generations", "1", "-o", str(tmp_path / "polished")]) == 0


def test_other_environments_have_linear_policies_too(tmp_path: Path) -> None:
    arguments = ["linear", "--env", "CartPole-v1", "--pop", "12", "--generations", "4", "--workers", "1"]
    assert main([*arguments, "-o", str(tmp_path / "run")]) == 0
    champion = champions.load(tmp_path / "run/champion.json")
    assert champion.provenance["held_out"]["mean"] > 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--env", "Nowhere-v0"], "environment Nowhere-v0"),
        (["--pop", "3"], "'3' is not a whole number of 4 or more"),
        (["--env", "CartPole-v1", "--simulator", "native"], "--simulator native: serves"),
        (["--resume", "nowhere"], "nowhere: holds no run of bitneat linear"),
        (["--resume", "nowhere", "--pop", "9"], "--pop: not with --resume"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if "--resume" in arguments:
        # argparse and we agree: nothing is asked of the folder before the options make sense
        assert not Path("nowhere").exists()
    try:
        status = main(["linear", *arguments])
    except SystemExit as exit_:
        status = int(str(exit_.code))
    assert status == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_damaged_run_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "linear.json").write_text('{"format": "bitneat-linear", "version": 1, "settings": {}}')
    assert main(["linear", "--resume", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "linear.json: damaged: KeyError" in error
    assert error.count("\n") == 1


def test_a_run_cannot_be_made_shorter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    common = ["linear", "--env", "CartPole-v1", "--pop", "4", "--workers", "1"]
    assert main([*common, "--generations", "3", "-o", str(run)]) == 0
    before = {path: path.read_bytes() for path in run.iterdir()}
    capsys.readouterr()
    assert main(["linear", "--resume", str(run), "--generations", "2", "--workers", "1"]) == 2
    error = capsys.readouterr().err
    assert error == f"bitneat: --resume {run}: has completed 3 generations, more than the 2 asked for\n"
    assert {path: path.read_bytes() for path in run.iterdir()} == before


def test_the_modules_of_a_resumed_run_are_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["linear", "--env", "bitneat/Matrix-v0", "--import", "tests.sim.strange", "--pop", "4", "--workers", "1"]
    assert main([*common, "--generations", "2", "-o", str(tmp_path / "whole")]) == 0
    assert main([*common, "--generations", "1", "-o", str(tmp_path / "parts")]) == 0
    resume = ["linear", "--resume", str(tmp_path / "parts"), "--generations", "2", "--workers", "1"]
    with monkeypatch.context() as patch:
        patch.setattr("bitneat.sim.environment._allowed_imports", set())
        assert main(resume) == 2
        assert "needs --import tests.sim.strange" in capsys.readouterr().err
        assert main([*resume, "--import", "tests.sim.strange", "--import", "json"]) == 0
    champion = champions.load(tmp_path / "parts/champion.pkl")
    assert champion.environment is not None
    assert champion.environment.imports == ("tests.sim.strange",)
    assert (tmp_path / "parts/champion.pkl").read_bytes() == (tmp_path / "whole/champion.pkl").read_bytes()


@pytest.mark.parametrize("generations", [0, 1])
def test_an_interrupt_says_how_to_go_on_or_that_nothing_is_kept_though_a_second_one_comes_while_it_closes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], generations: int
) -> None:
    check_interrupted("linear", ["--env", "CartPole-v1", "--pop", "4"], tmp_path / "run", generations, capsys)
