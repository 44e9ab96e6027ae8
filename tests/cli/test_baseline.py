# SPDX-License-Identifier: MIT
"""``bitneat baseline``."""

import json
import sys
from pathlib import Path

import pytest

from bitneat.cli import main


def test_a_missing_library_is_one_line_and_exit_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["baseline", "ppo", "-o", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.endswith("is not installed; pip install 'bitneat[baselines]'\n")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["a2c"], "invalid choice: 'a2c'"),
        ([], "required: method"),
        (["ars", "--steps", "0"], "--steps: '0' is not a whole number of 1 or more"),
        (["ars", "--hardcore"], "baseline: hardcore is for ppo, not for ars"),
        (["ars", "--seed", "600000000"], "seed: expected a whole number in 0..536870912"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_status_2(
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["baseline", *arguments]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_training_is_told_line_by_line_and_written_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("torch", "stable_baselines3", "sb3_contrib"):
        pytest.importorskip(name, reason="needs bitneat[baselines]")
    command = ["baseline", "ars", "--steps", "1", "-o", str(tmp_path / "run"), "--json", str(tmp_path / "out.json")]
    assert main(command) == 0
    first = capsys.readouterr()
    data = json.loads((tmp_path / "out.json").read_text())
    assert f"{data['held_out']['mean']:.1f} ± {data['held_out']['std']:.1f} over 100 held-out episodes" in first.out
    assert "100 parameters, 400 bytes" in first.out
    assert first.err.splitlines()[-1].startswith("ars scoring steps ")
    assert main(command) == 0
    again = capsys.readouterr()
    assert (again.out, again.err) == (first.out, "")
