# SPDX-License-Identifier: MIT
"""``bitneat distill``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from bitneat.champion import EnvironmentSpec, FloatChampion, save_pickle
from bitneat.cli import main
from bitneat.controller import Action, DiscreteAction
from bitneat.network import FloatNetwork, FloatNode
from bitneat.sim.walker.episodes import ACTION

TINY = Path(__file__).parents[2] / "examples" / "champions" / "tiny.pkl"


@pytest.fixture
def teacher(tmp_path: Path) -> Path:
    nodes = tuple(FloatNode(((i, 0.5), (i + 4, -0.5)), 0.1, 1.0, "clamped") for i in range(4))
    network = FloatNetwork(24, nodes, (24, 25, 26, 27))
    save_pickle(FloatChampion(network, ACTION, EnvironmentSpec("BipedalWalker-v3"), {}), tmp_path / "teacher.pkl")
    return tmp_path / "teacher.pkl"


def test_a_missing_library_is_one_line_and_exit_status_2(
    teacher: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("torch", "bitneat.distill.student", "bitneat.distill.imitation"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["distill", str(teacher), "-o", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.endswith("is not installed; pip install 'bitneat[baselines]'\n")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            [str(TINY)],
            "tiny.pkl: is a controller already, which can go on with --reinforce STEPS; or give a float champion",
        ),
        ([str(TINY), "--reinforce", "9"], "tiny.pkl: is no student's controller: "),
        ([str(TINY), "--reinforce", "9", "--hidden", "5"], "--hidden: "),
        ([str(TINY), "--reinforce", "9", "--updates", "5"], "--updates: "),
        (["nowhere.pkl"], "nowhere.pkl: "),
        ([str(TINY), "--planes", "4"], "--planes: invalid choice: 4"),
        ([str(TINY), "--hidden", "0"], "--hidden: '0' is not a whole number"),
        ([str(TINY), "--rounds", "2"], "--rounds: '2' is not a whole number"),
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
    assert main(["distill", *arguments]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("num_inputs", "environment", "action", "message"),
    [
        (23, "BipedalWalker-v3", ACTION, "has 23 inputs, BipedalWalker-v3 gives 24"),
        (24, "BipedalWalker-v3", DiscreteAction(4), "is for another action space than that of BipedalWalker-v3"),
        (24, "Pendulum-v1", ACTION, "expected a teacher for BipedalWalker-v3 or BipedalWalkerHardcore-v3"),
    ],
)
def test_a_teacher_of_something_else_is_refused_before_a_run_is_begun(
    num_inputs: int,
    environment: str,
    action: Action,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    nodes = tuple(FloatNode(((i, 0.5),), 0.1, 1.0, "clamped") for i in range(4))
    network = FloatNetwork(num_inputs, nodes, tuple(range(num_inputs, num_inputs + 4)))
    path = tmp_path / "teacher.pkl"
    save_pickle(FloatChampion(network, action, EnvironmentSpec(environment), {}), path)
    assert main(["distill", str(path), "-o", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err == f"bitneat: {path}: {message}\n"
    assert not (tmp_path / "run").exists()


def test_links_that_skip_a_layer_are_said_to_be_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)  # it is said before anything is trained
    polished = TINY.with_name("hardcore.pkl")
    assert main(["distill", str(polished), "--reinforce", "9", "-o", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.splitlines()[0] == f"bitneat: {polished}: links that skip a layer are left out: 1"


def test_rounds_are_told_and_the_same_command_has_the_result_again(
    teacher: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch", reason="needs bitneat[baselines]")
    run, out = str(tmp_path / "run"), tmp_path / "out.json"
    command = [
        "distill",
        str(teacher),
        "--hidden",
        "5",
        "--rounds",
        "3",
        "--updates",
        "8",
        "-o",
        run,
        "--json",
        str(out),
    ]
    assert main(command) == 0
    first = capsys.readouterr()
    assert [line.split()[:2] for line in first.err.splitlines()] == [["round", "1"], ["round", "2"], ["round", "3"]]
    data = json.loads(out.read_text())
    assert data["controller"]["ternary"] is True
    assert f"{data['held_out']['mean']:.1f} ± {data['held_out']['std']:.1f}" in first.out
    assert main(command) == 0
    assert capsys.readouterr().err == ""
    assert json.loads(out.read_text()) == data
