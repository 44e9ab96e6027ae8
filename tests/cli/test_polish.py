# SPDX-License-Identifier: MIT
"""``bitneat polish`` as a user meets it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.cli.main import main
from bitneat.controller import DiscreteAction
from bitneat.files import sole_user
from tests.cli.interrupts import check_interrupted

EXAMPLE = Path(__file__).parents[2] / "examples" / "champions" / "acrobot.json"


def test_a_champion_gets_smaller_and_the_result_does_not_depend_on_workers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["polish", str(EXAMPLE), "--for", "size", "--floor", "-90", "--generations", "1"]
    for workers, limit in ((1, []), (2, ["--time", "10000"])):
        out, written = str(tmp_path / f"{workers}"), str(tmp_path / f"{workers}.json")
        assert main([*common, *limit, "--workers", str(workers), "-o", out, "--json", written]) == 0
    printed = capsys.readouterr()
    assert "held-out episodes" in printed.out
    assert "smallest above the floor" in printed.err
    summary = json.loads((tmp_path / "1.json").read_text())
    assert summary["controller"]["ternary"]
    assert summary["controller"]["packed_bytes"] < 22
    assert summary["held_out"]["episodes"] == 100
    champion = champions.load(tmp_path / "1/champion.pkl")
    assert champion.controller.sha256 == summary["controller"]["sha256"]
    assert champion.provenance["polish"]["objective"] == "size"
    with sole_user(tmp_path / "1"):
        assert main(["polish", "--resume", str(tmp_path / "1"), "--generations", "2"]) == 2
    assert capsys.readouterr().err.endswith("another process is at work there; expected a run that none continues\n")
    whole = (tmp_path / "1/champion.pkl").read_bytes()
    assert (tmp_path / "2/champion.pkl").read_bytes() == whole  # the limit cut nothing off
    assert main(["polish", "--resume", str(tmp_path / "1"), "--time", "1e-9"]) == 0
    assert "cannot be reproduced" not in capsys.readouterr().err
    assert (tmp_path / "1/champion.pkl").read_bytes() == whole
    assert main(["polish", "--resume", str(tmp_path / "1"), "--generations", "3", "--time", "1e-9"]) == 0
    assert "--time cut the run short, which cannot be reproduced" in capsys.readouterr().err
    assert champions.load(tmp_path / "1/champion.pkl").provenance["reproducible"] is False


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected a CHAMPION to start from"),
        (["nowhere.pkl"], "nowhere.pkl: cannot read"),
        ([str(EXAMPLE), "--floor", "nan"], "--floor nan: expected a finite reward"),
        ([str(EXAMPLE), "--time", "0"], "--time 0.0: expected a number of seconds above 0, or none"),
        ([str(EXAMPLE), "--time", "soon"], "argument --time: 'soon' is not a number of seconds, or none"),
        ([str(EXAMPLE), "--risk", "-1"], "--risk -1.0: expected a number of at least 0"),
        ([str(EXAMPLE), "--max-bytes", "0"], "--max-bytes"),
        (["--resume", "nowhere", "--risk", "0.5"], "--risk: not with --resume"),
        (["--resume", "nowhere"], "nowhere: holds no polishing run"),
        (["--resume", "nowhere", "--seed", "1"], "--seed: not with --resume"),
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
    assert main(["polish", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_champion_for_another_action_space_is_refused_before_a_run_is_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    champion = champions.load(EXAMPLE)
    champions.save_json(replace(champion, action=DiscreteAction(3, start=1)), tmp_path / "other.json")
    assert main(["polish", str(tmp_path / "other.json"), "--generations", "1", "-o", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err == "bitneat: Acrobot-v1: the champions are for another action space than its own\n"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("generations", [0, 1])
def test_an_interrupt_says_how_to_go_on_or_that_nothing_is_kept_though_a_second_one_comes_while_it_closes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], generations: int
) -> None:
    check_interrupted("polish", [str(EXAMPLE)], tmp_path / "run", generations, capsys)
