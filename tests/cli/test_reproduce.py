# SPDX-License-Identifier: MIT
"""``bitneat reproduce`` from end to end, in the smallest of its budgets."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bitneat.cli.main import main
from bitneat.evolve.randomness import report_seeds
from bitneat.reproduce.results import load_all, policy_from_data
from bitneat.reproduce.schedule import run_all
from bitneat.sim.walker import run_episodes
from tests.sealed import resealed

SOME = ("default-1", "bit-1", "ptq-ternary-round-1", "ptq-int-round-1")


def reproduce(folder: Path, *names: str) -> int:
    only = [argument for name in names for argument in ("--only", name)]
    return main(["reproduce", "--budget", "smoke", "-o", str(folder), "--workers", "1", *only])


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reproduce") / "paper"
    assert reproduce(folder, *SOME) == 0
    return folder


def test_it_leaves_tables_figures_and_a_page(reproduced: Path) -> None:
    names = {path.name for path in reproduced.iterdir()}
    assert names >= {"table1.csv", "quantization.csv", "claims.csv", "README.md", "figure4-fitness.svg"}
    assert names >= {"figure2-growth-bit.png", "figure3-walk-default.png"}
    rows = list(csv.DictReader((reproduced / "table1.csv").open()))
    assert [row["system"] for row in rows] == ["default", "bit", "ptq-int", "ptq-ternary"]
    page = (reproduced / "README.md").read_text()
    assert "| bit |" in page
    assert "not measured yet" in page


def test_the_scores_are_those_of_the_policies_in_the_results(reproduced: Path) -> None:
    results = load_all(reproduced / "results")
    assert set(results) == set(SOME)
    for name, result in results.items():
        assert result.policy is not None
        rewards, _ = run_episodes([policy_from_data(result.policy)], report_seeds(result.heldout["episodes"]))
        assert float(rewards.mean()) == pytest.approx(result.heldout["mean"], rel=1e-12), name
    assert results["ptq-int-round-1"].notes["before"] == dict(results["default-1"].heldout)


def test_what_has_a_result_does_not_run_again(reproduced: Path) -> None:
    before = {path.name: path.read_bytes() for path in (reproduced / "results").iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in (reproduced / "results").iterdir()}
    assert reproduce(reproduced, *SOME) == 0
    assert {path.name: path.stat().st_mtime_ns for path in (reproduced / "results").iterdir()} == times
    # and a run that does gives the same bytes
    (reproduced / "results" / "bit-1.json").unlink()
    assert reproduce(reproduced, *SOME) == 0
    assert (reproduced / "results" / "bit-1.json").read_bytes() == before["bit-1.json"]


def test_killed_it_goes_on_to_the_same_result(reproduced: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    arguments = ["reproduce", "--budget", "smoke", "-o", str(folder), "--workers", "1", "--only", "bit-1"]
    process = subprocess.Popen([sys.executable, "-m", "bitneat", *arguments], start_new_session=True)
    history = folder / "runs" / "bit-1" / "history.csv"
    deadline = time.monotonic() + 120
    while not history.exists() or history.read_text().count("\n") < 2:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (folder / "results" / "bit-1.json").exists()
    assert main(arguments) == 0
    name = Path("results") / "bit-1.json"
    assert (folder / name).read_bytes() == (reproduced / name).read_bytes()


def test_the_list_says_what_is_done(reproduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--budget", "smoke", "-o", str(reproduced), "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "done  bit-1" in lines
    assert "open  wann-1" in lines


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "nothing-*"], "--only nothing-*: matches no job"),
    ],
)
def test_a_choice_that_cannot_run_is_one_line(
    tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "--budget", "smoke", "-o", str(tmp_path / "new"), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_list_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["reproduce", "--list", "-o", str(folder)]) == 0
    assert not folder.exists()
    assert main(["reproduce", "--list", "--budget", "paper", "-o", str(folder)]) == 0
    folder.mkdir()
    (folder / "budget.json").write_text('{"budget": "paper"}')
    assert main(["reproduce", "--list", "--budget", "smoke", "-o", str(folder)]) == 2
    assert "holds results of --budget paper" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["budget.json"]


def test_temporary_files_of_killed_processes_are_taken_away(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    for name in (f".README.md.{2**31 - 1}.0123abcd.tmp", f"results/.bit-1.json.{2**31 - 1}.0123abcd.tmp"):
        (tmp_path / name).touch()
    assert run_all([], tmp_path, 1, lambda job: "", lambda state: None) == {}
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_job_brings_those_that_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "new")
    assert main(["reproduce", "--budget", "smoke", "-o", folder, "--list", "--only", "ptq-int-round-1"]) == 0
    assert capsys.readouterr().out.splitlines() == ["open  default-1", "open  ptq-int-round-1"]
    assert main(["reproduce", "--budget", "smoke", "-o", folder, "--list", "--only", "softmax-1"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 10


def test_budgets_do_not_meet_in_one_folder(reproduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--budget", "hour", "-o", str(reproduced)]) == 2
    assert "holds results of --budget smoke" in capsys.readouterr().err


def test_a_result_that_was_made_with_other_settings_is_named(
    reproduced: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "paper"
    (folder / "results").mkdir(parents=True)
    copy = Path(shutil.copy(reproduced / "results" / "bit-1.json", folder / "results"))
    resealed(copy, "node_add_prob = 0.6", "node_add_prob = 0.5")
    assert reproduce(folder, "bit-1") == 2
    error = capsys.readouterr().err
    assert "bit-1.json: has another configuration; remove it, and it runs again" in error
    assert error.count("\n") == 1


def test_json_has_table_one(reproduced: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.json"
    only = [argument for name in SOME for argument in ("--only", name)]
    assert main(["reproduce", "--budget", "smoke", "-o", str(reproduced), *only, "--json", str(out)]) == 0
    assert [row["system"] for row in json.loads(out.read_text())["table1"]] == [
        "default",
        "bit",
        "ptq-int",
        "ptq-ternary",
    ]
