# SPDX-License-Identifier: MIT
"""A run: the loop that carries a search from its last checkpoint, or from the start, to its champion."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import dataclass

from bitneat.champion import AnyChampion, Champion, FloatChampion
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.progress import Progress
from bitneat.evolve.randomness import REPORT_START, SELECTION_START
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.evolve.search import Candidate, Score, Search
from bitneat.files import write_json
from bitneat.network import FloatNetwork
from bitneat.sim.environment import EnvironmentInfo
from bitneat.version import __version__, installed_version


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
    with folder.alone():
        search = searching(folder, settings, info)
        folder.restore(search, settings.begun_at)
        folder.mend(settings, search)
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
    start = () if folder.generations(settings.begun_at) else settings.start
    return Search(settings.config, settings.environment, info, settings.seed, start)


def _champion(
    settings: RunSettings, info: EnvironmentInfo, search: Search, candidate: Candidate, score: Score | None
) -> AnyChampion:
    """Nothing in a champion depends on clock, machine, folder or workers."""
    selection = Score.over(candidate.rewards)
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
        # A limit that cut nothing off is as none; of a leader on the way nobody knows yet.
        "reproducible": settings.seconds is None or search.finished,
        "max_steps": search.max_steps,
    }
    policy = candidate.controller
    if isinstance(policy, FloatNetwork):
        return FloatChampion(policy, info.action, settings.environment, provenance)
    return Champion(policy, info.action, settings.environment, provenance)


def _packages() -> dict[str, str]:
    names = ("neat-python", "gymnasium", "numpy", "box2d", "box2d-py")
    found = {name: version for name in names if (version := installed_version(name)) is not None}
    return {"python": ".".join(platform.python_version_tuple()[:2]), **found}
