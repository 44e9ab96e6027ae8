# SPDX-License-Identifier: MIT
"""Imitation: a student learns what another network does where the student itself goes (DAgger: Ross, Gordon and Bagnell 2011).

A round walks episodes, the first with the teacher's actions and the others with the student's; the teacher says what it would have
done in each step of them; and the student learns from all rounds so far. What a round walks depends on the seed, the round and the
student before it, so that a run that is resumed walks the same episodes again instead of keeping millions of observations on disk.

Importing this needs PyTorch.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.distill.student import Student
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.randomness import SELECTION_START, selection_seeds
from bitneat.sim.walker.rollout import run_policy
from bitneat.sim.walker.vector import step_limit

_ACTIONS = 4
_SELECTION = 32
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

    hidden: tuple[int, ...] = (20, 14)
    planes: int = 3
    """Weights are integers of at most 2^planes - 1 times a power of two; 1 gives -1, 0 and 1."""
    rounds: int = 16
    float_rounds: int = 2
    """The first, in which weights are still real numbers."""
    walkers: int = 64
    """Episodes in a round."""
    noise: float = 0.1
    """Standard deviation of what is added to the actions in them."""
    updates: int = 3000
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

    @property
    def line(self) -> str:
        """For whoever watches."""
        result = "" if self.mean is None else f" reward {self.mean:.1f} in {self.packed_bytes} bytes"
        return f"round {self.number} loss {self.loss:.4f}{result}"


Label = Callable[[Floats], npt.NDArray[Any]]
"""What a teacher does: observations (n, 24) to actions (n, 4)."""


def observed(act: Callable[[Floats], Floats], seeds: Sequence[int], hardcore: bool) -> Floats:
    """What a policy, observations (n, 24) to actions (n, 4), sees in an episode on each seed: (steps of all, 24)."""
    seen: list[Floats] = []

    def noted(_: npt.NDArray[np.int32], observations: Floats) -> Floats:
        seen.append(observations.copy())
        return act(observations)

    run_policy(noted, seeds, step_limit(hardcore), hardcore=hardcore)
    return np.concatenate(seen)


class Imitation:
    """The state of a run.

    Args:
        label: the teacher.
        hardcore: whether it walks in BipedalWalkerHardcore-v3.
        settings: how.
        seed: of all randomness.
    """

    def __init__(self, label: Label, hardcore: bool, settings: DistillSettings, seed: int) -> None:
        self.hardcore, self.settings, self.seed = hardcore, settings, seed
        self.rows: list[RoundRow] = []
        self.candidates: list[tuple[float, Controller]] = []
        """The best so far with their means on the selection seeds, the first the best."""
        self._label = label
        self._observations: list[Floats] = []
        self._actions: list[Floats] = []
        self._past: list[Any] = []
        self._generator = torch.Generator().manual_seed(seed)
        torch.manual_seed(seed)
        self._collect(None)
        self._begin_with(Student(self._scales(), settings.hidden, _ACTIONS, settings.planes))

    def _student(self, state: dict[str, Any]) -> Student:
        return Student.from_state(state, self.settings.hidden, _ACTIONS, self.settings.planes)

    def _begin_with(self, student: Student) -> None:
        self.student = student
        self._optimizer = torch.optim.Adam(student.parameters(), lr=self.settings.learning_rate)

    def _scales(self) -> list[int]:
        deviations = np.maximum(np.concatenate(self._observations).std(axis=0), 1e-3)
        return [int(s) for s in np.clip(np.round(np.log2(_TYPICAL / deviations)), *_SCALE_LIMITS)]

    def _collect(self, student: Student | None) -> None:
        """Walk a round's episodes: by the teacher if no student is given."""
        number = len(self._observations)
        rng = np.random.default_rng([0xD157, self.seed, number])
        seeds = [int(s) for s in rng.choice(SELECTION_START, self.settings.walkers, replace=False)]

        def act(observations: Floats) -> Floats:
            actions = self._labels(observations) if student is None else student.act(observations)
            noisy = actions + self.settings.noise * rng.standard_normal(actions.shape)
            return np.clip(noisy, -1.0, 1.0).astype(np.float32)

        observations = observed(act, seeds, self.hardcore)
        self._observations.append(observations)
        self._actions.append(self._labels(observations))

    def _labels(self, observations: Floats) -> Floats:
        return np.clip(self._label(observations), -1.0, 1.0).astype(np.float32)

    def advance(self, evaluator: Evaluator) -> RoundRow:
        """Run one round."""
        settings, number = self.settings, len(self.rows)
        if number:
            self._past.append(self.student.state())
            self.student.quantize(number > settings.float_rounds)
            self._collect(self.student)
        if number == settings.float_rounds:
            self._begin_with(self.student.balanced())
        self.student.quantize(number >= settings.float_rounds)
        loss = self._learn(number)
        mean = size = None
        if number >= settings.float_rounds:
            controller = self.student.controller()
            episodes = evaluator.evaluate([controller], selection_seeds(_SELECTION))[0]
            mean, size = math.fsum(each.reward for each in episodes) / len(episodes), len(pack(controller))
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
            "student": self.student.state(),
            "optimizer": self._optimizer.state_dict(),
            "generator": self._generator.get_state(),
            "past": self._past,
            "rows": [list(vars(row).values()) for row in self.rows],
            "candidates": [[mean, json.dumps(controller.to_data())] for mean, controller in self.candidates],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken; walks the episodes of its rounds again."""
        for number, past in enumerate(state["past"], start=1):
            walker = self._student(past)
            walker.quantize(number > self.settings.float_rounds)
            self._collect(walker)
        self._past = list(state["past"])
        self._begin_with(self._student(state["student"]))
        self._optimizer.load_state_dict(state["optimizer"])
        self._generator.set_state(state["generator"])
        self.rows = [RoundRow(*row) for row in state["rows"]]
        self.candidates = [(mean, Controller.from_data(json.loads(text))) for mean, text in state["candidates"]]
