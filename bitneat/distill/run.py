# SPDX-License-Identifier: MIT
"""A run of ``bitneat distill`` on disk: imitation, reinforcement if it is asked for, and the champion.

Importing this needs PyTorch.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bitneat.baselines import checkpoint
from bitneat.baselines.evaluation import batched
from bitneat.baselines.training import MAX_SEED
from bitneat.champion import Champion, FloatChampion, save_json, save_pickle
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.distill.folder import at_work
from bitneat.distill.imitation import DistillSettings, Imitation, RoundRow, observed
from bitneat.distill.reinforcement import Reinforcement, ReinforceSettings
from bitneat.distill.student import Student
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.recheck import Recheck
from bitneat.evolve.search import Candidate, Score
from bitneat.sim.bipedal import is_hardcore, is_walker
from bitneat.sim.walker.binding import default_threads
from bitneat.sim.walker.rollout import run_policy
from bitneat.sim.walker.vector import step_limit
from bitneat.version import __version__

IMITATION, REINFORCEMENT = "imitation.pt", "reinforcement.pt"
_FORMAT, _VERSION = "bitneat-distill", 4
_TRIED, _TRIED_LAYER, _FINAL, _REPORT = 32, 64, 200, 100
_ROUNDING_STREAM = 0x2094
_EVERY = 15
"""Updates of reinforcement between two evaluations of the student."""


@dataclass(frozen=True)
class ReinforceRow:
    """Where a reinforcement stands."""

    steps: int
    recent: float | None
    """As of `bitneat.distill.reinforcement.Reinforcement`."""
    mean: float
    """Of the student, whose weights are real numbers, without noise and on the selection seeds."""

    @property
    def line(self) -> str:
        """For whoever watches."""
        recent = "-" if self.recent is None else f"{self.recent:.1f}"
        return f"steps {self.steps} recent mean {recent} reward {self.mean:.1f} with real weights"


@dataclass(frozen=True)
class RoundingRow:
    """One rounding of a student to integers."""

    number: int
    layers: int
    """Of integers, of all."""
    loss: float
    """Mean squared difference of the actions to those before."""
    mean: float
    """Reward on the selection seeds."""
    packed_bytes: int | None
    """None where a layer still has real weights."""

    @property
    def line(self) -> str:
        """For whoever watches."""
        size = f"{self.layers} layers" if self.packed_bytes is None else f"{self.packed_bytes} bytes"
        return f"rounding {self.number} loss {self.loss:.4f} reward {self.mean:.1f} in {size}"


@dataclass(frozen=True)
class _Rounds:
    count: int
    walkers: int
    hardcore: bool
    seed: int


Tell = Callable[[RoundRow | ReinforceRow | RoundingRow], None]


def distill(
    teacher: FloatChampion | Champion,
    settings: DistillSettings,
    seed: int,
    folder: Path,
    *,
    tell: Tell,
    reinforce: ReinforceSettings | None = None,
) -> tuple[Champion, Score]:
    """Train a student, and write the best controller that it was as a champion.

    With reinforcement the student imitates its teacher with real weights, goes on by itself with those, and is rounded layer by
    layer. Without, the student imitates the teacher all along, with integers after the first rounds. A controller that a student
    has become is no teacher: it goes on itself, by its reward alone, and with the layers that it has.

    If the folder holds the same run, it goes on from there.

    Args:
        teacher: for a walker.
        settings: of the imitation.
        seed: of all randomness.
        folder: made if it is not there.
        tell: told after each round, and now and then in the reinforcement.
        reinforce: how to go on by itself, if at all.

    Returns:
        The champion, and its score on the report seeds.

    Raises:
        BitneatError: if the teacher is not for a walker, or a controller that no student has become, or one without reinforcement;
            or if the folder holds something else.
    """
    spec = teacher.environment
    if spec is None or not is_walker(spec):
        raise BitneatError("distill: expected a teacher for BipedalWalker-v3 or BipedalWalkerHardcore-v3")
    if not 0 <= seed <= MAX_SEED:
        raise BitneatError(f"seed: expected a whole number in 0..{MAX_SEED}, got {seed}")
    reinforce = reinforce or ReinforceSettings()
    begun: Student | None = None
    if isinstance(teacher, Champion):
        if not reinforce.steps:
            raise BitneatError("distill: the teacher is a controller already, which can go on with reinforcement alone")
        begun = Student.from_controller(teacher.controller, settings.planes)
        settings = replace(settings, hidden=begun.hidden)
    run = {
        "format": _FORMAT,
        "version": _VERSION,
        "teacher": teacher.controller.sha256 if isinstance(teacher, Champion) else teacher.network.sha256,
        "seed": seed,
        "settings": json.loads(json.dumps(asdict(settings))),
        "reinforce": asdict(reinforce) if reinforce.steps else None,
    }
    with at_work(folder, run):
        hardcore = is_hardcore(spec)
        evaluator = NativeWalkerEvaluator(spec, step_limit(hardcore), default_threads())
        threads = torch.get_num_threads()
        torch_state, python_state = torch.get_rng_state(), random.getstate()
        torch.set_num_threads(1)
        try:
            if begun is not None:
                student = begun
            else:
                assert isinstance(teacher, FloatChampion)
                how = replace(settings, rounds=settings.float_rounds) if reinforce.steps else settings
                imitation = Imitation(batched(teacher.network, exact=False), hardcore, how, seed)
                _imitate(folder / IMITATION, imitation, evaluator, tell)
                student, controllers = imitation.student, [controller for _, controller in imitation.candidates]
            if reinforce.steps:
                rounds = _Rounds(settings.rounds, settings.walkers, hardcore, seed)
                _reinforce(folder / REINFORCEMENT, Reinforcement(student, hardcore, reinforce, seed), rounds, tell)
                controllers = _rounded(student, rounds, evaluator, tell)
        finally:
            torch.set_num_threads(threads)
            torch.set_rng_state(torch_state)
            random.setstate(python_state)
        return _finish(folder, teacher, controllers, evaluator, run)


def _imitate(path: Path, imitation: Imitation, evaluator: Evaluator, tell: Tell) -> None:
    checkpoint.restore(path, imitation.restore)
    while len(imitation.rows) < imitation.settings.rounds:
        row = imitation.advance(evaluator)
        checkpoint.save(path, imitation.state())
        tell(row)


def _reinforce(path: Path, training: Reinforcement, run: _Rounds, tell: Tell) -> None:
    """Train the student, round a layer, train those above, and so on until the last layer alone has real weights."""
    try:
        checkpoint.restore(path, training.restore)
        while True:
            while not training.done:
                for _ in range(_EVERY):
                    if not training.done:
                        training.advance()
                checkpoint.save(path, training.state())
                tell(ReinforceRow(training.steps, training.recent, _walked(training.student, run, _TRIED)))
            if training.settled:
                return
            training.adopt(_with_next_layer_rounded(training.student, run, tell))
            checkpoint.save(path, training.state())
    finally:
        training.close()


def _with_next_layer_rounded(student: Student, run: _Rounds, tell: Tell) -> Student:
    """The best of several roundings of the lowest layer that has real weights."""
    found = []
    for number, (rounded, loss) in enumerate(_roundings(student, student.rounded_layers + 1, run), start=1):
        mean = _walked(rounded, run, _TRIED_LAYER)
        found.append((mean, rounded))
        tell(RoundingRow(number, rounded.rounded_layers, loss, mean, None))
    return max(found, key=lambda each: each[0])[1]


def _rounded(student: Student, run: _Rounds, evaluator: Evaluator, tell: Tell) -> list[Controller]:
    """The controllers that several roundings of a student come to."""
    controllers = []
    for number, (integers, loss) in enumerate(_roundings(student, len(student.layers), run), start=1):
        controllers.append(integers.controller())
        row = evaluator.evaluate(controllers[-1:], selection_seeds(_TRIED))[0]
        mean = math.fsum(each.reward for each in row) / len(row)
        tell(RoundingRow(number, len(student.layers), loss, mean, len(pack(controllers[-1]))))
    return controllers


def _roundings(student: Student, layers: int, run: _Rounds) -> Iterator[tuple[Student, float]]:
    """Students whose lowest layers have integers, each by other episodes and other orders, and what that did to the actions."""
    for number in range(run.count):
        rng = np.random.default_rng([_ROUNDING_STREAM, run.seed, layers, number])
        seeds = [int(s) for s in rng.choice(SELECTION_START, run.walkers, replace=False)]
        observations = observed(student.act, seeds, run.hardcore)
        rounded = student.rounded(observations, rng, layers)
        yield rounded, float(((rounded.act(observations) - student.act(observations)) ** 2).mean())


def _walked(student: Student, run: _Rounds, episodes: int) -> float:
    """Mean reward of a student as it is."""
    limit = step_limit(run.hardcore)
    rewards, _ = run_policy(lambda _, seen: student.act(seen), selection_seeds(episodes), limit, hardcore=run.hardcore)
    return float(rewards.mean())


def _finish(
    folder: Path,
    teacher: FloatChampion | Champion,
    controllers: Sequence[Controller],
    evaluator: Evaluator,
    run: dict[str, Any],
) -> tuple[Champion, Score]:
    spec = teacher.environment
    assert spec is not None
    scores = [Score.of(row) for row in evaluator.evaluate(controllers, selection_seeds(_FINAL))]
    best = max(range(len(scores)), key=lambda i: scores[i].mean)
    action, max_steps = teacher.action, step_limit(is_hardcore(spec))
    episodes = evaluator.evaluate([controllers[best]], selection_seeds(1))[0]
    Recheck(spec, action, max_steps)(Candidate(controllers[best], 0, tuple(e.reward for e in episodes)))
    score = Score.of(evaluator.evaluate([controllers[best]], report_seeds(_REPORT))[0])
    provenance = {
        "tool": f"bitneat {__version__}",
        "distill": {key: run[key] for key in ("teacher", "seed", "settings", "reinforce")},
        "selection": {**scores[best].to_data(), "first_seed": SELECTION_START},
        "held_out": {**score.to_data(), "first_seed": REPORT_START},
        "max_steps": max_steps,
    }
    champion = Champion(controllers[best], action, spec, provenance)
    save_json(champion, folder / "champion.json")
    save_pickle(champion, folder / "champion.pkl")
    return champion, score
