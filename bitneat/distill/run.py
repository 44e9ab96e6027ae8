# SPDX-License-Identifier: MIT
"""A run of ``bitneat distill`` on disk: imitation, reinforcement if it is asked for, and the champion.

Importing this needs PyTorch.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from bitneat.baselines import checkpoint
from bitneat.baselines.training import MAX_SEED
from bitneat.champion import Champion, FloatChampion, save_json, save_pickle
from bitneat.controller.packing import pack
from bitneat.distill.imitation import (
    Candidates,
    DistillSettings,
    Imitation,
    RoundRow,
    candidates_from,
    candidates_state,
    remember,
    tried,
)
from bitneat.distill.reinforcement import Reinforcement, ReinforceSettings
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.recheck import Recheck
from bitneat.evolve.search import Candidate, Score
from bitneat.files import make_folder, read_capped, refuse_links, remove_leftovers, write_json
from bitneat.sim.walker.binding import default_threads
from bitneat.sim.walker.vector import step_limit
from bitneat.version import __version__

RUN, CHECKPOINT, REINFORCEMENT = "distill.json", "checkpoint.pt", "reinforcement.pt"
_FORMAT, _VERSION = "bitneat-distill", 1
_FINAL, _REPORT = 200, 100
_EVERY = 15
"""Updates of reinforcement between two evaluations of the controller."""


@dataclass(frozen=True)
class ReinforceRow:
    """Where a reinforcement stands."""

    steps: int
    recent: float | None
    """As of `bitneat.distill.reinforcement.Reinforcement`."""
    mean: float
    """Of the controller on the selection seeds."""
    packed_bytes: int

    @property
    def line(self) -> str:
        """For whoever watches."""
        recent = "-" if self.recent is None else f"{self.recent:.1f}"
        return f"steps {self.steps} recent mean {recent} reward {self.mean:.1f} in {self.packed_bytes} bytes"


def distill(
    teacher: FloatChampion,
    settings: DistillSettings,
    seed: int,
    folder: Path,
    *,
    tell: Callable[[RoundRow | ReinforceRow], None],
    reinforce: ReinforceSettings | None = None,
) -> tuple[Champion, Score]:
    """Train a student, and write the best controller that it was as a champion.

    If the folder holds the same run, it goes on from there.

    Args:
        teacher: for a walker.
        settings: of the imitation.
        seed: of all randomness.
        folder: made if it is not there.
        tell: told after each round, and now and then in the reinforcement.
        reinforce: how to go on afterwards, if at all.

    Returns:
        The champion, and its score on the report seeds.

    Raises:
        BitneatError: if the teacher is not for a walker, or the folder holds something else.
    """
    if not 0 <= seed <= MAX_SEED:
        raise BitneatError(f"seed: expected a whole number in 0..{MAX_SEED}, got {seed}")
    reinforce = reinforce or ReinforceSettings()
    run = {
        "format": _FORMAT,
        "version": _VERSION,
        "teacher": teacher.network.sha256,
        "seed": seed,
        "settings": json.loads(json.dumps(asdict(settings))),
        "reinforce": asdict(reinforce) if reinforce.steps else None,
    }
    _begin(folder, run)
    threads = torch.get_num_threads()
    torch_state, python_state = torch.get_rng_state(), random.getstate()
    torch.set_num_threads(1)
    try:
        imitation = Imitation(teacher, settings, seed)
        evaluator = NativeWalkerEvaluator(imitation.spec, step_limit(imitation.hardcore), default_threads())
        checkpoint.restore(folder / CHECKPOINT, imitation.restore)
        while len(imitation.rows) < settings.rounds:
            row = imitation.advance(evaluator)
            checkpoint.save(folder / CHECKPOINT, imitation.state())
            tell(row)
        candidates = imitation.candidates
        if reinforce.steps:
            candidates = _reinforced(folder / REINFORCEMENT, imitation, reinforce, evaluator, tell)
    finally:
        torch.set_num_threads(threads)
        torch.set_rng_state(torch_state)
        random.setstate(python_state)
    return _finish(folder, imitation, candidates, evaluator, run)


def _reinforced(
    path: Path,
    imitation: Imitation,
    settings: ReinforceSettings,
    evaluator: Evaluator,
    tell: Callable[[ReinforceRow], None],
) -> Candidates:
    candidates = list(imitation.candidates)
    training = Reinforcement(imitation.student, imitation.hardcore, settings, imitation.seed)

    def restore(state: dict[str, Any]) -> None:
        training.restore(state["training"])
        candidates[:] = candidates_from(state["candidates"])

    try:
        checkpoint.restore(path, restore)
        while training.steps < settings.steps:
            for _ in range(_EVERY):
                if training.steps < settings.steps:
                    training.advance()
            controller = training.student.controller()
            row = ReinforceRow(training.steps, training.recent, tried(controller, evaluator), len(pack(controller)))
            remember(candidates, row.mean, controller)
            checkpoint.save(path, {"training": training.state(), "candidates": candidates_state(candidates)})
            tell(row)
    finally:
        training.close()
    return candidates


def _finish(
    folder: Path, imitation: Imitation, candidates: Candidates, evaluator: Evaluator, run: dict[str, Any]
) -> tuple[Champion, Score]:
    controllers = [controller for _, controller in candidates]
    scores = [Score.of(row) for row in evaluator.evaluate(controllers, selection_seeds(_FINAL))]
    best = max(range(len(scores)), key=lambda i: scores[i].mean)
    action, max_steps = imitation.teacher.action, step_limit(imitation.hardcore)
    episodes = evaluator.evaluate([controllers[best]], selection_seeds(1))[0]
    Recheck(imitation.spec, action, max_steps)(Candidate(controllers[best], 0, tuple(e.reward for e in episodes)))
    score = Score.of(evaluator.evaluate([controllers[best]], report_seeds(_REPORT))[0])
    provenance = {
        "tool": f"bitneat {__version__}",
        "distill": {key: run[key] for key in ("teacher", "seed", "settings", "reinforce")},
        "selection": {**scores[best].to_data(), "first_seed": SELECTION_START},
        "held_out": {**score.to_data(), "first_seed": REPORT_START},
        "max_steps": max_steps,
    }
    champion = Champion(controllers[best], action, imitation.spec, provenance)
    save_json(champion, folder / "champion.json")
    save_pickle(champion, folder / "champion.pkl")
    return champion, score


def _begin(folder: Path, run: dict[str, Any]) -> None:
    path = folder / RUN
    if path.exists():
        refuse_links(folder)
        try:
            found = json.loads(read_capped(path, 1 << 20))
        except ValueError:
            raise BitneatError(f"{path}: damaged: no JSON") from None
        if found != run:
            raise BitneatError(f"{folder}: holds another run of distill; give another -o")
        remove_leftovers(folder)
        return
    if (folder / "champion.pkl").exists():
        raise BitneatError(f"{folder / 'champion.pkl'}: exists and would be overwritten; give another -o")
    make_folder(folder)
    refuse_links(folder)
    write_json(path, run)
