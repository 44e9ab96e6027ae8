# SPDX-License-Identifier: MIT
"""Files that are cut off anywhere, or of which any bit is flipped: refused in a line that names the file, or as they were."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from bitneat import champion as champions
from bitneat.cli.main import main
from bitneat.errors import BitneatError
from bitneat.evolve.polish_run import PolishFolder
from bitneat.evolve.run_folder import RunFolder
from bitneat.evolve.search import Search
from bitneat.reproduce import results
from bitneat.reproduce.running import _Growth
from bitneat.sim.environment import inspect
from bitneat.state import StateFile
from tests.faults.scenarios import CONFIGURATION, TINY, MadeUp
from tests.faults.test_faults import SEED
from tests.faults.warm import tree

SAMPLE = 80
"""Of the cuts, and of the flips, of each file; the long test has them all, up to `MOST`."""
MOST = 5_000


@dataclass(frozen=True)
class Kept:
    """A file, and what reading it comes to: equal values are equal content."""

    path: Path
    read: Callable[[], Any]
    or_older: Any = None
    """What is read in its place, if the user is told."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a run, a polishing run and a linear one, each with two checkpoints."""
    top = tmp_path_factory.mktemp("damage")
    (top / "small.ini").write_text(CONFIGURATION)
    shutil.copy(TINY, top / "tiny.pkl")
    with pytest.MonkeyPatch.context() as patch:
        for command in ("evolve", "polish", "linear"):
            patch.setattr(f"bitneat.cli.{command}.evaluator_for", lambda *arguments: (MadeUp(), None))
        evolve = ["evolve", "--env", "CartPole-v1", "--config", str(top / "small.ini"), "--seed", "3"]
        assert main([*evolve, "-o", str(top / "run")]) == 0
        assert main(["polish", str(top / "tiny.pkl"), "--generations", "2", "-o", str(top / "polished")]) == 0
        linear = ["linear", "--env", "CartPole-v1", "--pop", "4", "--generations", "2"]
        assert main([*linear, "-o", str(top / "linear")]) == 0
    return top


def whole_run(path: Path, warnings: list[str]) -> Any:
    """All that a run goes on from."""
    run = RunFolder(path, warnings.append)
    settings = run.settings()
    search = Search(settings.config, settings.environment, inspect(settings.environment), settings.seed)
    run.restore(search, settings.begun_at)
    return json.dumps([settings.to_data(), search.to_data()])


def polished(path: Path, warnings: list[str]) -> Any:
    settings, polish, history = PolishFolder(path, warnings.append).load()
    return json.dumps([settings.to_data(), polish.to_data(), [vars(row) for row in history]])


def linear(path: Path, warnings: list[str]) -> Any:
    return json.dumps(StateFile(path / "linear.json", "bitneat-linear", 2, 1 << 26).load(warnings.append)[1])


def a_result(path: Path) -> results.Result:
    score = {"episodes": 1, "mean": 300.5, "std": 0.0, "min": 300.5, "max": 300.5}
    result = results.Result("bit-1", "table", "bit", 1, "bitneat reproduce", {}, score, None, 1, 2, 3, 4, 5, 6, None)
    result.save(path)
    return result


WHAT = (
    "champion.pkl",
    "champion.json",
    "run.json",
    "config.ini",
    "checkpoint",
    "polish.json",
    "linear.json",
    "result",
    "growth",
)


def kept(name: str, folder: Path, copy: Path, warnings: list[str]) -> Kept:
    """One of the files, in a folder of its own that can be damaged."""
    if name.startswith("champion"):
        path = Path(shutil.copy(folder / "run" / name, copy))
        return Kept(path, lambda: champions.load(path).to_data())
    if name == "result":
        path = copy / "result.json"
        a_result(path)
        return Kept(path, lambda: results.load(path))
    if name == "growth":
        controller = champions.load(TINY).controller
        candidate = type("Leader", (), {"controller": controller})()
        growth = _Growth(copy)
        growth._take(0, candidate)
        return Kept(copy / "growth.json", growth.snapshots)
    if name in ("run.json", "config.ini", "checkpoint"):
        shutil.copytree(folder / "run", copy, dirs_exist_ok=True)
        if name != "checkpoint":
            return Kept(copy / name, lambda: whole_run(copy, warnings))
        newest = sorted((copy / "checkpoints").iterdir())[-1]
        return with_older(newest, lambda: whole_run(copy, warnings), warnings)
    source, read = ("polished", polished) if name == "polish.json" else ("linear", linear)
    shutil.copytree(folder / source, copy, dirs_exist_ok=True)
    return with_older(copy / name, lambda: read(copy, warnings), warnings)


def with_older(path: Path, read: Callable[[], Any], warnings: list[str]) -> Kept:
    content = path.read_bytes()
    path.write_bytes(b"")
    older = read()
    path.write_bytes(content)
    warnings.clear()
    return Kept(path, read, older)


def damaged(content: bytes, sample: int) -> Iterator[tuple[str, bytes]]:
    """Cut off, and with a bit flipped, at random or everywhere; what is always tried are the ends."""
    dice = random.Random(SEED)
    size = len(content)
    lengths = range(size) if size <= sample else [0, 1, size - 2, size - 1, *dice.sample(range(size), sample)]
    for length in lengths:
        yield f"cut off after {length} bytes", content[:length]
    bits = range(8 * size) if 8 * size <= sample else [0, 8 * size - 1, *dice.sample(range(8 * size), sample)]
    for bit in bits:
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        yield f"bit {bit} flipped", bytes(changed)


def judge(file: Kept, warnings: list[str], sample: int) -> tuple[int, list[str]]:
    """How many damages there were, and what was wrong with how they were met."""
    whole = file.read()
    content = file.path.read_bytes()
    tried, wrong, refused = 0, [], 0
    for how, bad in damaged(content, sample):
        tried += 1
        file.path.write_bytes(bad)
        warnings.clear()
        try:
            found = file.read()
        except BitneatError as error:
            refused += 1
            if str(file.path) not in str(error) or "\n" in str(error):
                wrong.append(f"{how}: said {error}")
        except Exception as error:  # a traceback is what must not be
            wrong.append(f"{how}: {type(error).__name__}: {error}")
        else:
            told = len(warnings) == 1 and str(file.path) in warnings[0]
            if found != whole and not (told and found == file.or_older):
                wrong.append(f"{how}: read as something else")
            refused += told
    file.path.write_bytes(content)
    assert file.read() == whole
    print(f"{file.path.name}: {tried} damages, {refused} noticed, the others without a meaning")
    return tried, wrong


@pytest.mark.parametrize("name", WHAT)
def test_damage_is_named_or_means_nothing(folder: Path, tmp_path: Path, budget: int, name: str) -> None:
    warnings: list[str] = []
    file = kept(name, folder, tmp_path, warnings)
    sample = SAMPLE if name in ("champion.pkl", "checkpoint", "run.json") else SAMPLE // 3
    tried, wrong = judge(file, warnings, sample * budget)
    assert tried > sample
    assert not wrong, "\n".join(wrong[:20])


@pytest.mark.long
@pytest.mark.parametrize("name", WHAT)
def test_any_damage_is_named_or_means_nothing(folder: Path, tmp_path: Path, name: str) -> None:
    warnings: list[str] = []
    file = kept(name, folder, tmp_path, warnings)
    _, wrong = judge(file, warnings, MOST)
    assert not wrong, "\n".join(wrong[:20])


@pytest.mark.parametrize("how", ["empty", "half", "flipped", "missing"])
@pytest.mark.parametrize("command", ["evolve", "polish", "linear"])
def test_the_run_goes_on_from_the_checkpoint_before_to_the_same_bytes(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    how: str,
) -> None:
    source = {"evolve": "run", "polish": "polished"}.get(command, command)
    run = tmp_path / source
    shutil.copytree(folder / source, run)
    newest = sorted((run / "checkpoints").iterdir())[-1] if command == "evolve" else run / f"{command}.json"
    content = newest.read_bytes()
    if how == "missing":
        newest.unlink()
    else:
        flipped = content.replace(b'"search":{', b'"search":{ ', 1)
        newest.write_bytes({"empty": b"", "half": content[: len(content) // 2], "flipped": flipped}[how])
    monkeypatch.setattr(f"bitneat.cli.{command}.evaluator_for", lambda *arguments: (MadeUp(), None))
    capsys.readouterr()
    assert main([command, "--resume", str(run)]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("bitneat: ")]
    if command == "evolve" and how == "missing":
        assert not told  # a name that is not there is not known to have been
    else:
        assert len(told) == 1
        assert str(newest) in told[0]
        assert "going on from" in told[0]
    assert newest.read_bytes() == content
    assert tree(run) == tree(folder / source)


@pytest.mark.parametrize("command", ["evolve", "polish", "linear"])
def test_without_a_whole_checkpoint_nothing_is_run(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    source = {"evolve": "run", "polish": "polished"}.get(command, command)
    run = tmp_path / source
    shutil.copytree(folder / source, run)
    states = [*(run / "checkpoints").glob("*")] if command == "evolve" else [*run.glob(f"{command}*.json")]
    assert len(states) == 2
    for state in states:
        state.write_bytes(state.read_bytes()[:-9])
    before = tree(run)
    assert main([command, "--resume", str(run)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert any(str(state) in error for state in states)
    assert tree(run) == before


def test_a_checkpoint_of_another_configuration_does_not_stand_in(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bitneat.cli.evolve.evaluator_for", lambda *arguments: (MadeUp(), None))
    run = tmp_path / "run"
    shutil.copytree(folder / "run", run)
    (tmp_path / "next.ini").write_text(CONFIGURATION.replace("finalists = 2", "finalists = 3"))
    assert main(["evolve", "--resume", str(run), "--config", str(tmp_path / "next.ini")]) == 0
    newest = run / "checkpoints" / "generation-000004.json"
    newest.write_bytes(b"")
    assert main(["evolve", "--resume", str(run)]) == 2  # from generation 3 it would run 4 under the other configuration
    assert f"{newest}: damaged" in capsys.readouterr().err
    newest.unlink()
    assert main(["evolve", "--resume", str(run)]) == 2
    assert "holds no checkpoint of generation 4 or later" in capsys.readouterr().err


def test_files_of_before_there_were_hashes_are_read(folder: Path, tmp_path: Path) -> None:
    warnings: list[str] = []
    shutil.copytree(folder / "run", tmp_path, dirs_exist_ok=True)
    whole = whole_run(tmp_path, warnings)
    for path in (tmp_path / "run.json", *(tmp_path / "checkpoints").iterdir()):
        data = json.loads(path.read_text())
        path.write_text(
            json.dumps({key: value for key, value in data.items() if key not in ("sha256", "config")} | {"version": 1})
        )
    assert whole_run(tmp_path, warnings) == whole
    champion = json.loads((tmp_path / "champion.json").read_text())
    del champion["content_sha256"]
    (tmp_path / "champion.json").write_text(json.dumps(champion))
    assert champions.load(tmp_path / "champion.json") == champions.load(tmp_path / "champion.pkl")
    assert not warnings


def test_an_edited_configuration_is_not_passed_over(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "run", tmp_path, dirs_exist_ok=True)
    config = tmp_path / "config.ini"
    config.write_text(config.read_text().replace("pop_size = 8", "pop_size = 9"))
    with pytest.raises(BitneatError, match=r"config\.ini: damaged or edited: .*delete it .*--config"):
        RunFolder(tmp_path).settings()
