# SPDX-License-Identifier: MIT
"""Event files: what TensorBoard's own reader finds in them, and that the run's other files do not know of them."""

from __future__ import annotations

import csv
import errno
import os
import sys
import threading
from pathlib import Path

import pytest

from bitneat.cli.main import main

TINY = """
[evolve]
race_episodes = 1 2
race_fractions = 1 0.3
selection_episodes = 1
final_episodes = 2
report_episodes = 2
finalists = 2
max_steps = 60
[NEAT]
pop_size = 12
"""
COLUMNS = {
    "reward/best": "best",
    "reward/mean": "mean",
    "reward/selection": "selection",
    "population/species": "species",
    "leader/links": "best_links",
    "race/steps": "steps",
}


def read(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """Each tag's (step, value) in order, as TensorBoard reads them."""
    from tensorboard.backend.event_processing.event_accumulator import SCALARS, EventAccumulator

    accumulator = EventAccumulator(str(folder), size_guidance={SCALARS: 0})
    accumulator.Reload()
    tags = accumulator.Tags()["scalars"]
    return {tag: [(event.step, event.value) for event in accumulator.Scalars(tag)] for tag in tags}


def files(run: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(run)): path.read_bytes()
        for path in run.rglob("*")
        if path.is_file() and "tensorboard" not in path.parts
    }


def evolve(*arguments: str) -> int:
    return main(["evolve", "--workers", "1", *arguments])


@pytest.fixture
def new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(tmp_path)
    Path("tiny.ini").write_text(TINY)
    return ["--env", "CartPole-v1", "--config", "tiny.ini", "--generations", "5"]


def test_a_run_is_the_same_to_the_byte_with_it_and_without(new: list[str]) -> None:
    assert evolve(*new, "-o", "without") == 0
    assert evolve(*new, "-o", "with", "--tensorboard") == 0
    assert files(Path("with")) == files(Path("without"))
    assert list(Path("with/tensorboard").iterdir())


def test_the_scalars_are_those_of_the_history(new: list[str]) -> None:
    assert evolve(*new, "-o", "run", "--tensorboard", "elsewhere") == 0
    assert not Path("run/tensorboard").exists()
    scalars = read(Path("elsewhere"))
    rows = list(csv.DictReader(Path("run/history.csv").read_text().splitlines()))
    for tag, column in COLUMNS.items():
        assert [step for step, _ in scalars[tag]] == list(range(5))
        assert [value for _, value in scalars[tag]] == pytest.approx([float(row[column]) for row in rows], rel=1e-6)
    assert all(value > 0 for _, value in scalars["race/steps_per_second"])
    assert all(value > 0 for _, value in scalars["best_candidate/packed_bytes"])


@pytest.mark.parametrize("lost", [False, True])
def test_a_resumed_run_has_each_generation_once(new: list[str], lost: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    from bitneat.evolve.tensorboard import TensorBoardProgress

    tell = TensorBoardProgress.generation

    def stop(self: TensorBoardProgress, row: object, best: object) -> None:
        if row.generation == 2 and lost:  # type: ignore[attr-defined]
            raise KeyboardInterrupt  # saved, and not yet written about
        tell(self, row, best)  # type: ignore[arg-type]
        if row.generation == 2:  # type: ignore[attr-defined]
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(TensorBoardProgress, "generation", stop)
        assert evolve(*new, "-o", "run", "--tensorboard") == 130
    assert evolve("--resume", "run", "--tensorboard") == 0
    scalars = read(Path("run/tensorboard"))
    rows = list(csv.DictReader(Path("run/history.csv").read_text().splitlines()))
    for tag, column in COLUMNS.items():
        assert [step for step, _ in scalars[tag]] == list(range(5)), tag
        assert [value for _, value in scalars[tag]] == pytest.approx([float(row[column]) for row in rows], rel=1e-6)


def test_each_generation_is_on_disk_before_the_next(new: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As a SIGKILL would leave it, which comes without a word."""
    from bitneat.evolve.tensorboard import TensorBoardProgress

    tell = TensorBoardProgress.generation
    seen: list[set[int]] = []

    def look(self: TensorBoardProgress, row: object, best: object) -> None:
        tell(self, row, best)  # type: ignore[arg-type]
        seen.append({len(steps) for steps in read(Path("run/tensorboard")).values()})

    monkeypatch.setattr(TensorBoardProgress, "generation", look)
    assert evolve(*new, "-o", "run", "--tensorboard") == 0
    assert seen == [{1}, {2}, {3}, {4}, {5}]


def test_a_full_disk_is_one_line_and_the_run_goes_on(
    new: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from tensorboardX.record_writer import RecordWriter

    assert evolve(*new, "-o", "without") == 0
    write, written = RecordWriter.write, []

    def full(self: RecordWriter, data: bytes) -> None:
        written.append(data)
        if len(written) > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(self, data)

    monkeypatch.setattr(RecordWriter, "write", full)
    capsys.readouterr()
    ended: list[int] = []
    thread = threading.Thread(target=lambda: ended.append(evolve(*new, "-o", "run", "--tensorboard")), daemon=True)
    thread.start()
    thread.join(60)
    assert ended == [0]
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("bitneat:")]
    assert errors == [
        "bitneat: --tensorboard: run/tensorboard: cannot write: No space left on device; the run goes on without"
    ]
    assert files(Path("run")) == files(Path("without"))


def test_without_tensorboardx_it_says_what_to_install_before_anything_is_made(
    new: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    assert evolve(*new, "-o", "run", "--tensorboard") == 2
    error = capsys.readouterr().err
    assert error == "bitneat: --tensorboard: tensorboardX is not installed; pip install 'bitneat[tensorboard]'\n"
    assert not Path("run").exists()
