# SPDX-License-Identifier: MIT
"""New runs leave alone what is in a folder already: the user's files, other commands' runs, remains of runs."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bitneat.baselines import checkpoint, load_result, train
from bitneat.champion import load
from bitneat.cli.main import main
from bitneat.cli.reproduce import _is_claimed
from bitneat.distill.folder import at_work
from bitneat.errors import BitneatError
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.files import sole_user
from bitneat.folders import BASELINE, DISTILL, EVOLVE, KINDS, LINEAR, POLISH, REPRODUCE, Kind, begun
from bitneat.sim.environment import EpisodeResult
from bitneat.verify.cfile import find
from tests.faults.scenarios import CONFIGURATION, TINY, MadeUp
from tests.faults.warm import tree


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.ini").write_text(CONFIGURATION)
    shutil.copy(TINY, "tiny.pkl")
    for command in ("evolve", "polish", "linear"):
        monkeypatch.setattr(f"bitneat.cli.{command}.evaluator_for", lambda *arguments: (MadeUp(), None))


COMMANDS = {
    "evolve": ["evolve", "--env", "CartPole-v1", "--config", "small.ini"],
    "polish": ["polish", "tiny.pkl", "--generations", "1"],
    "linear": ["linear", "--env", "CartPole-v1", "--pop", "4", "--generations", "1"],
    "reproduce": ["reproduce", "--budget", "smoke"],
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.command)
def test_no_command_begins_a_run_in_the_folder_of_another(
    command: str, kind: Kind, capsys: pytest.CaptureFixture[str]
) -> None:
    if kind.command == command:
        return
    Path("run").mkdir()
    Path("run", kind.states[0]).write_text("{}")
    before = tree(Path("run"))
    assert main([*COMMANDS[command], "-o", "run"]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"bitneat: run: holds a run already: {kind.states[0]} is of bitneat {kind.command}; give another -o\n"
    )
    assert tree(Path("run")) == before


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("evolve", "config.ini"), ("evolve", "history.csv"), ("evolve", "champion.json"), ("evolve", "report.json"),
        ("evolve", "checkpoints/generation-000004.json"), ("polish", "history.csv"), ("polish", "front.csv"),
        ("polish", "champion.json"), ("polish", "front/31.pkl"), ("linear", "champion.pkl"), ("reproduce", "README.md"),
        ("reproduce", "table1.csv"),
    ],
)  # fmt: skip
def test_a_file_that_a_new_run_would_write_or_go_on_from_is_refused_by_its_name(
    command: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path("run", name)
    path.parent.mkdir(parents=True)
    path.write_text("the user's own")
    before = tree(Path("run"))
    assert main([*COMMANDS[command], "-o", "run"]) == 2
    error = capsys.readouterr().err
    assert error == f"bitneat: {path}: exists and would be overwritten; move it elsewhere, or give another -o\n"
    assert tree(Path("run")) == before


@pytest.mark.parametrize("command", ["evolve", "polish", "linear"])
def test_every_file_that_a_run_leaves_is_known_to_be_written(command: str) -> None:
    kind = next(kind for kind in KINDS if kind.command == command)
    front = ["--front"] if command == "polish" else []
    assert main([*COMMANDS[command], *front, "-o", "run"]) == 0
    known = {path for pattern in (*kind.states, *kind.written) for path in Path("run").glob(pattern)}
    assert known == {path for path in Path("run").rglob("*") if path.is_file()}


def test_a_run_in_a_folder_with_other_files_leaves_them(capsys: pytest.CaptureFixture[str]) -> None:
    Path("notes.txt").write_text("mine")
    assert main([*COMMANDS["evolve"], "-o", "."]) == 0
    assert Path("notes.txt").read_text() == "mine"
    assert Path("small.ini").read_text() == CONFIGURATION


def test_the_folder_is_its_beginners_alone_and_whoever_comes_too_late_is_refused(tmp_path: Path) -> None:
    with begun(tmp_path / "a", EVOLVE) as made:
        assert made
        with pytest.raises(BitneatError, match="another process is at work there"), begun(tmp_path / "a", POLISH):
            pytest.fail("there are two")
    with begun(tmp_path / "a", LINEAR) as made:
        assert not made
    with (
        sole_user(tmp_path / "a"),
        pytest.raises(BitneatError, match="another process is at work there"),
        begun(tmp_path / "a", BASELINE),
    ):
        pytest.fail("there are two")


@pytest.mark.parametrize("kind", [POLISH, DISTILL, REPRODUCE], ids=lambda kind: kind.command)
def test_a_run_that_comes_up_between_the_look_and_the_lock_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Kind
) -> None:
    def late(folder: Path) -> bool:
        folder.mkdir()
        (folder / "run.json").write_text("{}")
        return False

    monkeypatch.setattr("bitneat.folders.make_folder", late)
    with pytest.raises(BitneatError, match="holds a run already"), begun(tmp_path / "a", kind):
        pytest.fail("there are two")


def test_a_run_that_fails_early_takes_away_only_what_it_made(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*arguments: object) -> None:
        raise BitneatError("the wheels came off")

    monkeypatch.setattr("bitneat.cli.evolve.evaluator_for", fails)
    Path("run", "checkpoints").mkdir(parents=True)
    Path("run", "notes.txt").write_text("mine")
    Path("run", "checkpoints", "notes.txt").write_text("mine")
    before = tree(Path("run"))
    for _ in range(2):
        assert main([*COMMANDS["evolve"], "-o", "run"]) == 2
        assert capsys.readouterr().err.endswith("bitneat: the wheels came off\n")
        assert tree(Path("run")) == before
    Path("empty").mkdir()
    assert main([*COMMANDS["evolve"], "-o", "empty"]) == 2
    assert Path("empty").is_dir(), "the user made it"
    assert not list(Path("empty").iterdir())
    assert main([*COMMANDS["evolve"], "-o", "new"]) == 2
    assert not Path("new").exists()


def test_of_two_runs_that_begin_at_once_the_first_is_not_harmed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second one looks before the first one writes, or while it writes, or while its first generation runs."""
    at_work: list[str] = []

    def second(*arguments: object) -> None:
        if not at_work:
            at_work.append("once")
            assert main([*COMMANDS["evolve"], "--seed", "9", "-o", "run"]) == 2
            assert "run: " in capsys.readouterr().err

    save = RunFolder.save_settings

    def saved(self: RunFolder, settings: RunSettings) -> None:
        second()
        save(self, settings)

    class Interrupted(MadeUp):
        def episode(self, sha256: str, seed: int) -> EpisodeResult:
            second()
            return super().episode(sha256, seed)

    assert main([*COMMANDS["evolve"], "-o", "alone"]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "save_settings", saved)
        assert main([*COMMANDS["evolve"], "-o", "run"]) == 0
    assert at_work
    assert tree(Path("run")) == tree(Path("alone"))
    at_work.clear()
    shutil.rmtree("run")
    monkeypatch.setattr("bitneat.cli.evolve.evaluator_for", lambda *arguments: (Interrupted(), None))
    assert main([*COMMANDS["evolve"], "-o", "run"]) == 0
    assert at_work
    assert tree(Path("run")) == tree(Path("alone"))


@pytest.mark.parametrize("name", ["imitation.pt", "reinforcement.pt", "champion.json", "run.json"])
def test_a_distillation_does_not_go_on_from_what_another_left(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / name).write_text("of another teacher")
    with pytest.raises(BitneatError, match=name), at_work(folder, {"seed": 1}):
        pytest.fail("it goes on")
    assert [path.name for path in folder.iterdir()] == [name]
    (folder / name).unlink()
    for _ in range(2):
        with at_work(folder, {"seed": 1}):
            (folder / "imitation.pt").touch()
    with pytest.raises(BitneatError, match="holds another run of distill"), at_work(folder, {"seed": 2}):
        pytest.fail("it goes on")
    with at_work(folder, {"seed": 1}), pytest.raises(BitneatError, match="at work"), at_work(folder, {"seed": 1}):
        pytest.fail("there are two")


@pytest.mark.parametrize("name", ["checkpoint.pt", "result.json", "model.zip", "champion.pkl", "distill.json"])
def test_a_training_does_not_go_on_from_what_another_left(tmp_path: Path, name: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / name).write_text("of another training")
    with pytest.raises(BitneatError, match=name):
        train("ars", 100, 0, tmp_path / "run")


def read_nothing(data: object) -> None:
    pytest.fail(f"read {data!r:.80}")


def distillation(folder: Path) -> None:
    with at_work(folder, {}):
        pytest.fail("it begins")


READERS: dict[str, Callable[[Path], object]] = {
    "distill.json": distillation,
    "imitation.pt": lambda folder: checkpoint.restore(folder / "imitation.pt", read_nothing),
    "baseline.json": lambda folder: train("ars", 100, 0, folder),
    "result.json": load_result,
    "budget.json": lambda folder: _is_claimed(folder, "smoke"),
}


@pytest.fixture
def in_time() -> Iterator[None]:
    def late(*arguments: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("in_time")
@pytest.mark.parametrize("name", READERS)
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(BitneatError, match=rf"{name}: cannot read: not a regular file"):
        READERS[name](tmp_path)


@pytest.mark.usefixtures("in_time")
def test_pipes_beside_a_champion_are_not_waited_for_while_its_c_is_sought(tmp_path: Path) -> None:
    champion = load(TINY)
    assert main(["codegen", "tiny.pkl", "-o", "other.c"]) == 0
    sha256 = champion.controller.sha256
    Path("other.c").write_text(Path("other.c").read_text().replace(sha256, sha256[::-1]))
    for name in ("a.c", "a.pkl", "a.json"):
        os.mkfifo(name)
    found = find(champion, Path("t.json"), [tmp_path])
    assert found.matching == ()
    assert found.stale is not None
    assert found.stale.path == Path("other.c")


@pytest.mark.usefixtures("in_time")
def test_a_pipe_in_the_place_of_a_policy_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"hidden": [], "system": "ars"}')
    os.mkfifo(tmp_path / "policy.npz")
    with pytest.raises(BitneatError, match=r"policy\.npz: cannot read: not a regular file"):
        load_result(tmp_path)


@pytest.mark.parametrize("name", ["distill.json", "baseline.json", "result.json", "budget.json"])
@pytest.mark.parametrize(
    "content", [b"[" * 500_000, b"\xff", b"{", b"9" * 10_000], ids=["deep", "no text", "cut", "long"]
)
def test_a_file_that_no_json_can_be_read_from_is_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BitneatError, match=rf"{name}: (damaged|larger than)[^\n]*$"):
        READERS[name](tmp_path)
