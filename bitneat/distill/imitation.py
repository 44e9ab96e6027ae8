# SPDX-License-Identifier: MIT
"""Imitation: a student learns what a float network does where the student itself goes (DAgger: Ross, Gordon and Bagnell 2011).

A round walks episodes, the first with the teacher's actions and the others with the student's; the teacher says what it would have
done in each step of them; and the student learns from all rounds so far. What a round walks depends on the seed, the round and the
student before it, so that a run that is resumed walks the same episodes again instead of keeping millions of observations on disk.

Importing this needs PyTorch.
"""

from __future__ import annotations

import io
import json
import math
import random
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from bitneat.baselines.evaluation import batched
from bitneat.champion import Champion, EnvironmentSpec, FloatChampion, save_json, save_pickle
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.distill.student import Student
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.search import Score
from bitneat.files import make_folder, read_capped, refuse_links, remove_leftovers, write_atomic, write_json
from bitneat.sim.bipedal import is_hardcore, is_walker
from bitneat.sim.walker.rollout import run_policy
from bitneat.sim.walker.vector import step_limit
from bitneat.version import __version__

RUN, CHECKPOINT = "distill.json", "checkpoint.pt"
_FORMAT, _VERSION = "bitneat-distill", 1
_CAP = 1 << 30
_SELECTION, _FINAL, _REPORT = 32, 200, 100
_FINALISTS = 5
_LEAK = 0.01
"""Slope of the loss where an output is clamped, so that it can come back."""
_SCALE_LIMITS = (-1, 3)
_TYPICAL = 0.7
"""What inputs are scaled to deviate by, about."""

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DistillSettings:
    """How to imitate."""

    hidden: tuple[int, ...] = (32, 16)
    planes: int = 2
    """Weights are integers of at most 2^planes - 1 times a power of two; 1 gives -1, 0 and 1."""
    rounds: int = 16
    float_rounds: int = 2
    """The first, in which weights are still real numbers."""
    walkers: int = 64
    """Episodes in a round."""
    noise: float = 0.1
    """Standard deviation of what is added to the actions in them."""
    updates: int = 2000
    """Steps of the optimizer (Adam) in a round."""
    batch: int = 2048
    learning_rate: float = 2e-3
    """At the start; it falls to a tenth of it."""


@dataclass(frozen=True)
class RoundRow:
    """What a round came to."""

    number: int
    loss: float
    """Mean squared difference of the actions, over the last quarter of the round's updates."""
    mean: float | None
    """Reward on the selection seeds; None while weights are real numbers."""
    packed_bytes: int | None


class Imitation:
    """The state of a run.

    Args:
        teacher: for a walker.
        settings: how.
        seed: of all randomness.

    Raises:
        BitneatError: if the teacher is for something else.
    """

    def __init__(self, teacher: FloatChampion, settings: DistillSettings, seed: int) -> None:
        spec = teacher.environment
        if spec is None or not is_walker(spec):
            raise BitneatError("distill: expected a teacher for BipedalWalker-v3 or BipedalWalkerHardcore-v3")
        self.spec: EnvironmentSpec = spec
        self.teacher, self.settings, self.seed = teacher, settings, seed
        self.hardcore = is_hardcore(spec)
        self.rows: list[RoundRow] = []
        self.candidates: list[tuple[float, Controller]] = []
        self._label = batched(teacher.network)
        self._observations: list[Floats] = []
        self._actions: list[Floats] = []
        self._past: list[Any] = []
        self._generator = torch.Generator().manual_seed(seed)
        torch.manual_seed(seed)
        self._collect(None)
        self.student = Student(self._scales(), settings.hidden, len(teacher.network.outputs), settings.planes)
        self._optimizer = torch.optim.Adam(self.student.parameters(), lr=settings.learning_rate)

    def _scales(self) -> list[int]:
        deviations = np.maximum(np.concatenate(self._observations).std(axis=0), 1e-3)
        return [int(s) for s in np.clip(np.round(np.log2(_TYPICAL / deviations)), *_SCALE_LIMITS)]

    def _collect(self, student: Student | None) -> None:
        """Walk a round's episodes: by the teacher if no student is given."""
        number = len(self._observations)
        rng = np.random.default_rng([0xD157, self.seed, number])
        seeds = [int(s) for s in rng.choice(SELECTION_START, self.settings.walkers, replace=False)]
        seen: list[Floats] = []

        def act(_: npt.NDArray[np.int32], observations: Floats) -> Floats:
            seen.append(observations.copy())
            if student is None:
                actions = np.clip(self._label(observations), -1.0, 1.0).astype(np.float32)
            else:
                with torch.no_grad():
                    actions = student(torch.from_numpy(seen[-1])).numpy()
            noisy = actions + self.settings.noise * rng.standard_normal(actions.shape)
            return np.clip(noisy, -1.0, 1.0).astype(np.float32)

        run_policy(act, seeds, step_limit(self.hardcore), hardcore=self.hardcore)
        observations = np.concatenate(seen)
        self._observations.append(observations)
        self._actions.append(np.clip(self._label(observations), -1.0, 1.0).astype(np.float32))

    def advance(self, evaluator: NativeWalkerEvaluator) -> RoundRow:
        """Run one round."""
        settings, number = self.settings, len(self.rows)
        if number:
            self._past.append({name: value.clone() for name, value in self.student.state_dict().items()})
            self.student.quantize(number > settings.float_rounds)
            self._collect(self.student)
        self.student.quantize(number >= settings.float_rounds)
        loss = self._learn(number)
        mean = size = None
        if number >= settings.float_rounds:
            controller = self.student.controller()
            episodes = evaluator.evaluate([controller], selection_seeds(_SELECTION))[0]
            mean, size = math.fsum(e.reward for e in episodes) / len(episodes), len(pack(controller))
            self.candidates.append((mean, controller))
            self.candidates.sort(key=lambda c: (-c[0], c[1].sha256))
            del self.candidates[_FINALISTS:]
        self.rows.append(RoundRow(number + 1, loss, mean, size))
        return self.rows[-1]

    def _learn(self, number: int) -> float:
        settings = self.settings
        observations = torch.from_numpy(np.concatenate(self._observations))
        wanted = torch.from_numpy(np.concatenate(self._actions))
        losses = []
        for update in range(settings.updates):
            part = (number * settings.updates + update) / (settings.rounds * settings.updates)
            for group in self._optimizer.param_groups:
                group["lr"] = settings.learning_rate * (1.0 - 0.9 * part)
            chosen = torch.randint(0, len(observations), (settings.batch,), generator=self._generator)
            raw = self.student.before_clamping(observations[chosen])
            clamped = raw.clamp(-1.0, 1.0)
            loss = ((clamped + _LEAK * (raw - clamped) - wanted[chosen]) ** 2).mean()
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()
            losses.append(loss.item())
        return math.fsum(losses[-(settings.updates // 4 or 1) :]) / (settings.updates // 4 or 1)

    def state(self) -> dict[str, Any]:
        """All that `restore` needs: tensors and plain data."""
        return {
            "student": self.student.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "generator": self._generator.get_state(),
            "past": self._past,
            "rows": [list(vars(row).values()) for row in self.rows],
            "candidates": [[mean, json.dumps(controller.to_data())] for mean, controller in self.candidates],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken; walks the episodes of its rounds again."""
        walker = Student(
            self.student.scales, self.settings.hidden, len(self.teacher.network.outputs), self.settings.planes
        )
        for number, past in enumerate(state["past"], start=1):
            walker.load_state_dict(past)
            walker.quantize(number > self.settings.float_rounds)
            self._collect(walker)
        self._past = list(state["past"])
        self.student.load_state_dict(state["student"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._generator.set_state(state["generator"])
        self.rows = [RoundRow(*row) for row in state["rows"]]
        self.candidates = [(mean, Controller.from_data(json.loads(text))) for mean, text in state["candidates"]]


def distill(
    teacher: FloatChampion,
    settings: DistillSettings,
    seed: int,
    folder: Path,
    tell: Callable[[RoundRow], None],
) -> tuple[Champion, Score]:
    """Train a student, and write the best of its rounds as a champion.

    If the folder holds the same run, it goes on from there.

    Returns:
        The champion, and its score on the report seeds.

    Raises:
        BitneatError: if the teacher is not for a walker, or the folder holds something else.
    """
    run = {
        "format": _FORMAT,
        "version": _VERSION,
        "teacher": teacher.network.sha256,
        "seed": seed,
        "settings": json.loads(json.dumps(asdict(settings))),
    }
    _begin(folder, run)
    threads = torch.get_num_threads()
    torch_state, python_state = torch.get_rng_state(), random.getstate()
    torch.set_num_threads(1)
    try:
        imitation = Imitation(teacher, settings, seed)
        evaluator = NativeWalkerEvaluator(imitation.spec, step_limit(imitation.hardcore), 2)
        _restore(folder / CHECKPOINT, imitation)
        while len(imitation.rows) < settings.rounds:
            row = imitation.advance(evaluator)
            _save(folder / CHECKPOINT, imitation)
            tell(row)
    finally:
        torch.set_num_threads(threads)
        torch.set_rng_state(torch_state)
        random.setstate(python_state)
    return _finish(folder, imitation, evaluator, run)


def _finish(
    folder: Path, imitation: Imitation, evaluator: NativeWalkerEvaluator, run: dict[str, Any]
) -> tuple[Champion, Score]:
    controllers = [controller for _, controller in imitation.candidates]
    scores = [Score.of(row) for row in evaluator.evaluate(controllers, selection_seeds(_FINAL))]
    best = max(range(len(scores)), key=lambda i: scores[i].mean)
    score = Score.of(evaluator.evaluate([controllers[best]], report_seeds(_REPORT))[0])
    provenance = {
        "tool": f"bitneat {__version__}",
        "distill": {key: run[key] for key in ("teacher", "seed", "settings")},
        "selection": {**scores[best].to_data(), "first_seed": SELECTION_START},
        "held_out": {**score.to_data(), "first_seed": REPORT_START},
        "max_steps": step_limit(imitation.hardcore),
    }
    champion = Champion(controllers[best], imitation.teacher.action, imitation.spec, provenance)
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


def _save(path: Path, imitation: Imitation) -> None:
    buffer = io.BytesIO()
    torch.save(imitation.state(), buffer)
    write_atomic(path, buffer.getvalue())


def _restore(path: Path, imitation: Imitation) -> None:
    if not path.exists():
        return
    try:
        content = io.BytesIO(read_capped(path, _CAP))
        with zipfile.ZipFile(content) as archive:  # torch is built to skip the checksums in it
            bad = archive.testzip()
        if bad is not None:
            raise BitneatError(f"{bad!r:.80} has another checksum")
        content.seek(0)
        imitation.restore(torch.load(content, weights_only=True))
    except Exception as error:  # the file may be anyone's
        reason = str(error) if isinstance(error, BitneatError) else type(error).__name__
        raise BitneatError(f"{path}: damaged: {reason}; remove it to begin anew") from None
