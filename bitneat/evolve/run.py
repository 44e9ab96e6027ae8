# SPDX-License-Identifier: MIT
"""A run on disk: its folder, checkpoints, and the loop that carries a search to its end.

Every file is written whole or not at all. What a resumed run needs is in ``run.json`` (what was asked for) and in the last
checkpoint (where the search stood); both are plain JSON, so that a run folder from a stranger can execute nothing.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import platform
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any

from bitneat.champion import (
    AnyChampion,
    Champion,
    EnvironmentSpec,
    FloatChampion,
    environment_from_data,
    save_json,
    save_pickle,
)
from bitneat.controller import Controller
from bitneat.errors import BitneatError
from bitneat.evolve.config import Config, parse
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.progress import Progress
from bitneat.evolve.randomness import REPORT_START, SELECTION_START
from bitneat.evolve.search import Candidate, Generation, Score, Search
from bitneat.files import read_capped, write_atomic, write_json
from bitneat.network import FloatNetwork
from bitneat.sim.environment import EnvironmentInfo
from bitneat.version import __version__

FORMAT = "bitneat-run"
CHECKPOINT_FORMAT = "bitneat-checkpoint"
VERSION = 1
CHECKPOINTS_KEPT = 2
MAX_SEED = 1 << 4096
MAX_CHECKPOINT_BYTES = 1 << 30

_TRIGONOMETRY = re.compile(r"[0-9a-f]{16}")
_CHECKPOINT_NAME = re.compile(r"generation-(\d{6,})\.json")


@dataclass(frozen=True)
class Stage:
    """A configuration that a run had before it was given another."""

    generations: int
    """Generations completed when the next configuration took over."""
    config: str

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {"generations": self.generations, "config": self.config}


@dataclass(frozen=True)
class RunSettings:
    """What was asked for: everything that decides the result, and the time limit, which may cut it short."""

    environment: EnvironmentSpec
    config: Config
    seed: int
    seconds: float | None = None
    earlier: tuple[Stage, ...] = ()
    trigonometry: str | None = None
    """Hash of the C library's functions that walkers depend on, where the run began; see `bitneat.sim.walker.trigonometry`."""
    start: tuple[Controller, ...] = ()
    """What the first population is made of; see `bitneat.evolve.starting`."""

    def to_data(self) -> dict[str, Any]:
        """As plain data; the configuration has its own file."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "environment": self.environment.to_data(),
            "seed": self.seed,
            "seconds": self.seconds,
            "earlier": [stage.to_data() for stage in self.earlier],
            "trigonometry": self.trigonometry,
            **({"start": [controller.to_data() for controller in self.start]} if self.start else {}),
        }


class RunFolder:
    """The files of a run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def champion_pickle(self) -> Path:
        """``champion.pkl``."""
        return self.path / "champion.pkl"

    def create(self, settings: RunSettings) -> None:
        """Make the folder and write what was asked for.

        Raises:
            BitneatError: if there is a run already, or the folder cannot be written.
        """
        if (self.path / "run.json").exists():
            raise BitneatError(
                f"{self.path}: holds a run already; continue it with --resume {self.path}, or give another -o"
            )
        try:
            (self.path / "checkpoints").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BitneatError(f"{self.path}: cannot be made: {error.strerror or error}") from None
        self.save_settings(settings)

    def discard(self) -> None:
        """Take away a run that no generation was completed of, so that it can be tried again."""
        for name in ("run.json", "config.ini", "history.csv"):
            (self.path / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # whatever else is in there is not ours
            (self.path / "checkpoints").rmdir()
            self.path.rmdir()

    def save_settings(self, settings: RunSettings) -> None:
        """Write the configuration and ``run.json``, which comes last and makes the folder a run."""
        write_atomic(self.path / "config.ini", settings.config.text.encode())
        write_json(self.path / "run.json", settings.to_data())

    def settings(self) -> RunSettings:
        """What was asked for.

        Raises:
            BitneatError: if the folder holds no run, or a damaged one.
        """
        if not (self.path / "run.json").exists():
            raise BitneatError(f"--resume {self.path}: holds no run: run.json is missing")
        data = _json(self.path / "run.json", FORMAT)
        config = parse(
            read_capped(self.path / "config.ini", 1 << 20).decode("utf-8", "replace"), str(self.path / "config.ini")
        )
        try:
            spec = environment_from_data(data["environment"])
            seed, seconds = data["seed"], data["seconds"]
            trigonometry = data.get("trigonometry")  # runs of before it was recorded lack the key
            start = tuple(Controller.from_data(entry) for entry in data.get("start", ()))
            earlier = tuple(Stage(_count(stage["generations"]), str(stage["config"])) for stage in data["earlier"])
            if type(seed) is not int or not 0 <= seed < MAX_SEED:
                raise BitneatError("seed: expected an integer from 0")
            if seconds is not None and not (type(seconds) in (int, float) and 0 < seconds < math.inf):
                raise BitneatError("seconds: expected a number above 0, or null")
            if trigonometry is not None and not (
                isinstance(trigonometry, str) and _TRIGONOMETRY.fullmatch(trigonometry)
            ):
                raise BitneatError("trigonometry: expected 16 hexadecimal digits, or null")
        except Exception as error:  # the file may be anyone's
            raise BitneatError(f"{self.path / 'run.json'}: damaged: {_reason(error)}") from None
        return RunSettings(spec, config, seed, seconds, earlier, trigonometry, start)

    def generations(self) -> int:
        """Generations completed, according to the last checkpoint."""
        checkpoints = self._checkpoints()
        return checkpoints[-1][0] if checkpoints else 0

    def save_checkpoint(self, search: Search) -> None:
        """Write the checkpoint of the generations completed, then drop all but the last two."""
        state = {"format": CHECKPOINT_FORMAT, "version": VERSION, "bitneat": __version__, "search": search.to_data()}
        text = json.dumps(state, separators=(",", ":"), allow_nan=True)
        folder = self.path / "checkpoints"
        write_atomic(folder / f"generation-{search.generation:06d}.json", text.encode())
        for _, old in self._checkpoints()[:-CHECKPOINTS_KEPT]:
            old.unlink(missing_ok=True)

    def restore(self, search: Search) -> None:
        """Bring the search to the last checkpoint; without one it starts at the beginning.

        Raises:
            BitneatError: if the checkpoint is damaged or from a newer bitneat.
        """
        checkpoints = self._checkpoints()
        if not checkpoints:
            return
        path = checkpoints[-1][1]
        data = _json(path, CHECKPOINT_FORMAT)
        try:
            search.restore(data["search"])
        except Exception as error:  # the file may be anyone's
            raise BitneatError(f"{path}: damaged: {_reason(error)}") from None
        if search.generation != checkpoints[-1][0]:
            raise BitneatError(f"{path}: damaged: holds generation {search.generation}")

    def save_history(self, search: Search) -> None:
        """Write ``history.csv``, a row a generation."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([field.name for field in fields(Generation)])
        writer.writerows(vars(row).values() for row in search.history)
        write_atomic(self.path / "history.csv", out.getvalue().encode())

    def save_champion(self, champion: AnyChampion) -> None:
        """Write ``champion.pkl`` and ``champion.json``."""
        save_json(champion, self.path / "champion.json")
        save_pickle(champion, self.champion_pickle)

    def _checkpoints(self) -> list[tuple[int, Path]]:
        folder = self.path / "checkpoints"
        if not folder.is_dir():
            return []
        found = [(match, entry) for entry in folder.iterdir() if (match := _CHECKPOINT_NAME.fullmatch(entry.name))]
        return sorted((int(match[1]), entry) for match, entry in found)


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    champion: AnyChampion
    score: Score
    candidate: Candidate
    finished: bool
    """False if the time limit cut it short."""


def carry_on(
    folder: RunFolder,
    settings: RunSettings,
    info: EnvironmentInfo,
    evaluator: Evaluator,
    progress: Progress,
    *,
    check: Callable[[Candidate], None] | None = None,
) -> Outcome:
    """Take a run from its last checkpoint, or from the start, to its end.

    The champion and the score depend on the settings alone, whatever the evaluator's workers and however often the run was
    stopped, unless a time limit cuts it short.

    ``check`` is called with each candidate that takes the lead, and with the champion, before anything of its generation is
    saved; what it raises ends the run, which can then be resumed from the generation before.
    """
    started = time.monotonic()
    search = searching(folder, settings, info)
    folder.restore(search)
    folder.save_history(search)  # the run may have died between a checkpoint and its history
    generations = settings.config["evolve"]["generations"]
    progress.start(search, generations, settings.seconds)
    best: Candidate | None = None
    out_of_time = False
    while not search.finished and not out_of_time:
        row = search.advance(evaluator)
        leads = search.candidates[0] is not best
        best = search.candidates[0]
        if leads and check is not None:
            check(best)
        folder.save_checkpoint(search)
        folder.save_history(search)
        if leads:
            folder.save_champion(_champion(settings, info, search, best, None))
        progress.generation(row, best)
        out_of_time = settings.seconds is not None and time.monotonic() - started > settings.seconds
    if not search.candidates:
        raise BitneatError("no champion: the run has 0 generations")
    progress.choosing()
    candidate = search.finalists(evaluator)[0]
    if check is not None:
        check(candidate)
    score = search.report(evaluator, candidate.controller)
    champion = _champion(settings, info, search, candidate, score)
    folder.save_champion(champion)
    write_json(folder.path / "report.json", dict(champion.provenance))
    return Outcome(champion, score, candidate, finished=search.finished)


def searching(folder: RunFolder, settings: RunSettings, info: EnvironmentInfo) -> Search:
    """The search of a run before its last checkpoint is restored; with a checkpoint it does not matter what it started from."""
    start = () if folder.generations() else settings.start
    return Search(settings.config, settings.environment, info, settings.seed, start)


def _champion(
    settings: RunSettings, info: EnvironmentInfo, search: Search, candidate: Candidate, score: Score | None
) -> AnyChampion:
    """Nothing in a champion depends on clock, machine, folder or workers."""
    selection = Score(
        len(candidate.rewards), candidate.mean, _std(candidate.rewards), min(candidate.rewards), max(candidate.rewards)
    )
    provenance = {
        "tool": f"bitneat {__version__}",
        "packages": _packages(),
        "config": settings.config.text,
        "earlier": [stage.to_data() for stage in settings.earlier],
        "seed": settings.seed,
        **({"start": [controller.sha256 for controller in settings.start]} if settings.start else {}),
        "generation": candidate.generation,
        "generations": search.generation,
        "steps": search.total_steps,
        "selection": {**selection.to_data(), "first_seed": SELECTION_START},
        "held_out": None if score is None else {**score.to_data(), "first_seed": REPORT_START},
        "reproducible": settings.seconds is None,
        "max_steps": search.max_steps,
    }
    policy = candidate.controller
    if isinstance(policy, FloatNetwork):
        return FloatChampion(policy, info.action, settings.environment, provenance)
    return Champion(policy, info.action, settings.environment, provenance)


def _std(values: tuple[float, ...]) -> float:
    import statistics

    return statistics.pstdev(values)


def _packages() -> dict[str, str]:
    versions = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in ("neat-python", "gymnasium", "numpy", "box2d", "box2d-py"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 1 << 53:
        raise BitneatError("earlier: expected a number of generations")
    return value


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())[:200]
    return text if isinstance(error, BitneatError) else f"{type(error).__name__}: {text}"


def _json(path: Path, expected_format: str) -> Mapping[str, Any]:
    try:
        data = json.loads(read_capped(path, MAX_CHECKPOINT_BYTES))
    except (ValueError, RecursionError):  # among them numbers of too many digits
        raise BitneatError(f"{path}: damaged: not JSON") from None
    if not isinstance(data, dict) or data.get("format") != expected_format:
        raise BitneatError(f"{path}: expected 'format': {expected_format!r}")
    if data.get("version") != VERSION:
        raise BitneatError(f"{path}: version {data.get('version')!r:.40}: this bitneat reads {VERSION}")
    return data
