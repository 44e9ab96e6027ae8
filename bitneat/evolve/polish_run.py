# SPDX-License-Identifier: MIT
"""A polishing run on disk: one checkpoint, the champion, a history, and the front of reward against size.

As in `bitneat.evolve.run_folder`, every file is written whole or not at all, and the result depends on what was asked for alone,
however often the run was stopped.
"""

from __future__ import annotations

import csv
import io
import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from bitneat.champion import Champion, EnvironmentSpec, environment_from_data, save_json, save_pickle
from bitneat.controller import Action, Controller, action_from_data
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.polish import Entry, Goal, Polish, Row
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.search import Candidate, Score
from bitneat.files import make_folder, refuse_links, sole_user, write_atomic
from bitneat.folders import POLISH, begun, refuse_begun
from bitneat.sim.environment import EpisodeResult
from bitneat.state import StateFile
from bitneat.version import __version__

FORMAT = "bitneat-polish"
VERSION = 2
"""Of ``polish.json``; version 1 had no hash, and is read, too."""
REPORT_EPISODES = 100
SELECTION_EPISODES = 200
FINALISTS = 6

_CHECK_EVERY = 10
"""Generations between two checks of the leader, which cost an episode in Gymnasium each."""

_STATE = "polish.json"
_FRONT = "front"
_MAX_STATE_BYTES = 1 << 28


@dataclass(frozen=True)
class PolishSettings:
    """What was asked for."""

    environment: EnvironmentSpec
    action: Action
    start: tuple[Controller, ...]
    goal: Goal
    generations: int
    seed: int
    max_steps: int
    seconds: float | None = None
    trigonometry: str | None = None
    """As in `bitneat.evolve.run_folder.RunSettings`."""

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "environment": self.environment.to_data(),
            "action": self.action.to_data(),
            "start": [controller.to_data() for controller in self.start],
            **asdict(self.goal),
            "generations": self.generations,
            "seed": self.seed,
            "max_steps": self.max_steps,
            "seconds": self.seconds,
            "trigonometry": self.trigonometry,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> PolishSettings:
        """Read what `to_data` wrote.

        Raises:
            BitneatError: if a value cannot be. Whatever else is wrong raises whatever it may.
        """
        settings = cls(
            environment_from_data(data["environment"]),
            action_from_data(data["action"]),
            tuple(Controller.from_data(controller) for controller in data["start"]),
            # The last two are newer than version 2 of the file, and stand for nothing where they are missing.
            Goal(data["objective"], data["floor"], data.get("max_bytes"), data.get("risk", 0.0)),
            data["generations"],
            data["seed"],
            data["max_steps"],
            data["seconds"],
            data["trigonometry"],
        )
        numbers = (settings.generations, settings.seed, settings.max_steps)
        if any(type(number) is not int or number < 0 for number in numbers) or not settings.start:
            raise BitneatError("settings: expected whole numbers and a controller to start from")
        seconds = settings.seconds
        if seconds is not None and not (type(seconds) in (int, float) and 0 < seconds < math.inf):
            raise BitneatError("settings: expected seconds above 0, or null")
        if settings.trigonometry is not None and not isinstance(settings.trigonometry, str):
            raise BitneatError("settings: trigonometry: expected text, or null")
        return settings


class PolishFolder:
    """The files of a polishing run.

    Args:
        path: of the folder.
        warn: told of a damaged checkpoint that the one before stands in for.
    """

    def __init__(self, path: Path, warn: Callable[[str], None] = warnings.warn) -> None:
        self.path = path
        self._warn = warn
        self._state = StateFile(path / _STATE, FORMAT, VERSION, _MAX_STATE_BYTES)

    @property
    def champion_pickle(self) -> Path:
        """``champion.pkl``."""
        return self.path / "champion.pkl"

    @property
    def is_begun(self) -> bool:
        """Whether there is a checkpoint, whole or not."""
        return self._state.exists()

    def create(self) -> None:
        """Make the folder.

        Raises:
            BitneatError: if there is a run already, or a file that this one would write: a champion may be the very one that it
                starts from; or the folder cannot be made.
        """
        with begun(self.path, POLISH):
            pass

    def save(self, settings: PolishSettings, polish: Polish, history: Sequence[Row]) -> None:
        """Write the checkpoint, and what people read."""
        self._state.save(
            {
                "settings": settings.to_data(),
                "search": polish.to_data(),
                "history": [list(vars(row).values()) for row in history],
            }
        )
        self.save_tables(polish, history)

    def save_tables(self, polish: Polish, history: Sequence[Row]) -> None:
        """Write ``history.csv`` and ``front.csv``."""
        write_atomic(
            self.path / "history.csv", _csv([f.name for f in fields(Row)], (vars(r).values() for r in history))
        )
        front = (
            (e.size, e.controller.num_links, len(e.controller.nodes), e.mean, e.worst, e.episodes, e.controller.sha256)
            for e in polish.front()
        )
        columns = ["packed_bytes", "links", "nodes", "mean", "worst", "episodes", "sha256"]
        write_atomic(self.path / "front.csv", _csv(columns, front))

    def load(self) -> tuple[PolishSettings, Polish, list[Row]]:
        """What was asked for, and where it stands.

        Raises:
            BitneatError: if the folder holds no polishing run, or a damaged one.
        """
        if not self._state.exists():
            raise BitneatError(f"--resume {self.path}: holds no polishing run: {_STATE} is missing")
        refuse_links(self.path)
        path, data = self._state.load(self._warn)
        try:
            settings = PolishSettings.from_data(data["settings"])
            polish = Polish(settings.start, settings.goal, settings.seed)
            polish.restore(data["search"])
            history = [Row(*values) for values in data["history"]]
        except Exception as error:  # the file may be anyone's
            text = str(error) if isinstance(error, BitneatError) else type(error).__name__
            raise BitneatError(f"{path}: damaged: {' '.join(text.split())[:200]}") from None
        return settings, polish, history

    def save_champion(self, champion: Champion) -> None:
        """Write ``champion.pkl`` and ``champion.json``."""
        save_json(champion, self.path / "champion.json")
        save_pickle(champion, self.champion_pickle)

    def save_front(self, champions: Mapping[int, Champion]) -> None:
        """Write ``front/BYTES.pkl`` for each, and remove those of before."""
        folder = self.path / _FRONT
        make_folder(folder)
        refuse_links(folder)
        for size, champion in champions.items():
            save_pickle(champion, folder / f"{size}.pkl")
        for path in folder.glob("*.pkl"):
            if path.stem not in map(str, champions):
                path.unlink()


def carry_on(
    folder: PolishFolder,
    settings: PolishSettings,
    polish: Polish,
    history: list[Row],
    evaluator: Evaluator,
    *,
    tell: Callable[[Row], None],
    check: Callable[[Candidate], None] | None = None,
    front: bool = False,
) -> tuple[Champion, Score, bool]:
    """Take a run to its end; returns champion, its score on the report seeds, and whether all generations were run.

    ``front`` asks for the controllers that no smaller one equals as champions, too, each scored on the report seeds. ``check`` is
    called with the leader now and then, and with the champion before it is saved, as by `bitneat.evolve.run.carry_on`.
    """
    began = time.monotonic()
    with sole_user(folder.path, _FRONT):
        if not history:
            refuse_begun(folder.path, POLISH)  # since the folder was made another process may have been there
        else:
            folder.save_tables(polish, history)  # the run may have died between a checkpoint and its tables
        out_of_time = False
        leader = None
        while polish.generation < settings.generations and not out_of_time:
            row = polish.advance(evaluator)
            before, leader = leader, polish.ranking()[0].controller
            if check is not None and polish.generation % _CHECK_EVERY == 0:
                episodes = evaluator.evaluate([leader], selection_seeds(1))[0]
                check(Candidate(leader, polish.generation, tuple(e.reward for e in episodes)))
            history.append(row)
            folder.save(settings, polish, history)
            if leader != before:
                folder.save_champion(_champion(settings, polish, leader, None, None))
            tell(row)
            out_of_time = settings.seconds is not None and time.monotonic() - began > settings.seconds
        entry, episodes = _choose(polish, evaluator)
        selection = Score.of(episodes)
        if check is not None:
            check(Candidate(entry.controller, polish.generation, tuple(e.reward for e in episodes)))
        score = Score.of(evaluator.evaluate([entry.controller], report_seeds(REPORT_EPISODES))[0])
        champion = _champion(settings, polish, entry.controller, selection, score)
        folder.save_champion(champion)
        if front:
            entries = polish.front()
            scores = [
                Score.of(row)
                for row in evaluator.evaluate([e.controller for e in entries], report_seeds(REPORT_EPISODES))
            ]
            folder.save_front(
                {
                    e.size: _champion(settings, polish, e.controller, None, s)
                    for e, s in zip(entries, scores, strict=True)
                }
            )
        return champion, score, polish.generation >= settings.generations


def _champion(
    settings: PolishSettings, polish: Polish, controller: Controller, selection: Score | None, score: Score | None
) -> Champion:
    """A champion, or the leader so far, which has no scores. A time limit that cut nothing off is as none."""
    if polish.generation >= settings.generations:
        settings = replace(settings, seconds=None)
    provenance = {
        "tool": f"bitneat {__version__}",
        "polish": {key: value for key, value in settings.to_data().items() if key not in ("environment", "action")},
        "generations": polish.generation,
        "selection": None if selection is None else {**selection.to_data(), "first_seed": SELECTION_START},
        "held_out": None if score is None else {**score.to_data(), "first_seed": REPORT_START},
        "reproducible": settings.seconds is None,
        "max_steps": settings.max_steps,
    }
    return Champion(controller, settings.action, settings.environment, provenance)


def _choose(polish: Polish, evaluator: Evaluator) -> tuple[Entry, list[EpisodeResult]]:
    """The best of the ranking's first on the selection seeds; none of more bytes than wanted, unless there is no other.

    For size it is the smallest whose mean less two standard errors is at or above the floor. That is no bound where falls are
    rare: 200 episodes of a controller that falls in one of 200 hold no fall with probability 0.995^200 = 0.37, and how much the
    others deviate says nothing of what a fall costs.
    """
    goal = polish.goal
    ranking = polish.ranking()
    finalists = [entry for entry in ranking[:FINALISTS] if not goal.excess(entry.size)] or ranking[:FINALISTS]
    results = evaluator.evaluate([e.controller for e in finalists], selection_seeds(SELECTION_EPISODES))
    scores = [Score.of(row) for row in results]

    def rank(index: int) -> tuple[bool, float, float]:
        score = scores[index]
        value = score.mean - goal.risk * score.std
        if goal.objective == "size":
            above = value - 2 * score.std / math.sqrt(score.episodes) >= goal.floor
            return not above, finalists[index].size if above else 0, -value
        return False, -value, finalists[index].size

    best = min(range(len(finalists)), key=rank)
    return finalists[best], results[best]


def _csv(columns: Sequence[str], rows: Any) -> bytes:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue().encode()
