# SPDX-License-Identifier: MIT
"""The closed loop, in lock-step: simulator, reference, and everything that claims to compute the same.

Each observation is encoded once and goes to the reference and to every implementation; the action is decoded from the
reference's outputs, so that one implementation's fault disturbs no other's run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, BoxAction, Controller, DiscreteAction, Encoder, Reference
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.sim.environment import make
from bitneat.verify.implementation import Implementation, ImplementationError

if TYPE_CHECKING:
    from bitneat.controller.coding import Int16Array


@dataclass(frozen=True, slots=True)
class Place:
    """Where something was compared: a step of an episode or, if ``episode`` is None, one of the vectors."""

    step: int
    episode: int | None = None
    seed: int | None = None

    def __str__(self) -> str:
        if self.episode is None:
            return f"vector {self.step}"
        return f"episode {self.episode} (seed {self.seed}), step {self.step}"


@dataclass(frozen=True, slots=True)
class Mismatch:
    """The first difference of an implementation from the reference.

    ``output`` is the index of an output, or ``"decide"``; it and the values are None if the code crashed, and then ``reason``
    says how.
    """

    target: str
    place: Place
    inputs: tuple[int, ...]
    output: int | str | None = None
    expected: int | None = None
    got: int | None = None
    reason: str | None = None

    def __str__(self) -> str:
        if self.reason is not None:
            return f"{self.target}: {self.place}: {self.reason}"
        what = "the decision" if self.output == "decide" else f"output {self.output}"
        return f"{self.target}: {self.place}: {what} is {self.got}, expected {self.expected}"

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {
            "target": self.target,
            "episode": self.place.episode,
            "seed": self.place.seed,
            "step": self.place.step,
            "output": self.output,
            "expected": self.expected,
            "got": self.got,
            "reason": self.reason,
            "inputs": list(self.inputs),
        }


@dataclass
class Lane:
    """One implementation, and how it fared."""

    implementation: Implementation
    max_vectors: int | None = None
    """How many of the vectors it is given; all if None."""
    max_episodes: int | None = None
    """How many episodes it takes part in; all if None."""
    steps: int = 0
    """Steps of episodes that were compared."""
    vectors: int = 0
    """Vectors that were compared."""
    mismatches: int = 0
    first: Mismatch | None = None
    lost: bool = False
    """It crashed; it takes no further part."""


@dataclass(frozen=True, slots=True)
class Episode:
    """What happened in one episode. ``inputs`` and ``outputs`` are kept only if asked for."""

    seed: int
    steps: int
    reward: float
    inputs: npt.NDArray[np.int16] | None = None
    outputs: npt.NDArray[np.int16] | None = None


@dataclass(frozen=True, slots=True)
class InputRange:
    """What one sensor delivered: the extremes of its raw values, and how many were beyond the input's limit."""

    min: float
    max: float
    clipped: int


@dataclass(frozen=True, slots=True)
class LoopResult:
    """All episodes, and what the inputs and outputs did."""

    episodes: tuple[Episode, ...]
    inputs: tuple[InputRange, ...]
    saturated_outputs: int

    @property
    def steps(self) -> int:
        """Of all episodes."""
        return sum(episode.steps for episode in self.episodes)


Progress = Callable[[int, int, Episode], None]
"""Called after each episode with how many are done, how many there will be, and the episode."""


Note = Callable[[str], None]
"""Called with a line about what is done next."""


class Comparison:
    """The reference and everything that is compared with it, stepped together.

    Args:
        controller: the reference computes it, exactly.
        action: the action space; where it is a choice, the choice that an implementation makes is compared too.
        lanes: the implementations; what is found out about each is noted there.
    """

    def __init__(self, controller: Controller, action: Action, lanes: Sequence[Lane]) -> None:
        self.controller = controller
        self.action = action
        self.lanes = lanes
        self._reference = Reference(controller)

    def reset(self) -> None:
        """Forget the past, everywhere. Code that crashes here is found out at its next step."""
        self._reference.reset()
        for lane in self._running():
            with suppress(ImplementationError):
                lane.implementation.reset()

    def step(self, inputs: Int16Array, place: Place) -> Int16Array:
        """One step everywhere; the reference's outputs."""
        outputs = np.array(self._reference.step(inputs.tolist()), dtype=np.int16)
        for lane in self._running():
            if place.episode is not None and lane.max_episodes is not None and place.episode >= lane.max_episodes:
                continue
            try:
                self._compare(lane, inputs, outputs, place)
            except ImplementationError as error:
                lane.lost = True
                self._note(lane, inputs, place, reason=str(error))
        return outputs

    def vectors(self, vectors: npt.NDArray[np.int16], sequence: int, progress: Note | None = None) -> None:
        """Input vectors from anywhere, (count, inputs), each ``sequence`` of them from reset.

        Args:
            vectors: the inputs.
            sequence: steps from reset to reset.
            progress: told what is run next.
        """
        outputs = self._answers(vectors, sequence)
        for lane in self._running():
            if progress is not None:
                progress(lane.implementation.title)
            count = len(vectors) if lane.max_vectors is None else lane.max_vectors
            for start in range(0, min(count, len(vectors)), sequence):
                stop = min(start + sequence, count)
                if not self._compare_many(lane, vectors[start:stop], outputs[start:stop], start):
                    break

    def _answers(self, vectors: npt.NDArray[np.int16], sequence: int) -> npt.NDArray[np.int16]:
        """What the reference answers."""
        answers = []
        for start in range(0, len(vectors), sequence):
            self._reference.reset()
            answers += self._reference.run(vectors[start : start + sequence].tolist())
        return np.array(answers, dtype=np.int16).reshape(len(vectors), -1)

    def _compare_many(
        self, lane: Lane, vectors: npt.NDArray[np.int16], outputs: npt.NDArray[np.int16], start: int
    ) -> bool:
        """Successive steps from reset in one request; whether the code survived."""
        implementation = lane.implementation
        try:
            implementation.reset()
            answers = implementation.run(vectors)
            chooses = isinstance(self.action, DiscreteAction) and implementation.decide(outputs[0]) is not None
            choices = implementation.decisions(outputs)[:, 0] if chooses else None
        except ImplementationError:
            self._find_crash(lane, vectors, outputs, start)
            return False
        for step, index in np.argwhere(answers != outputs).tolist():
            what = {"expected": int(outputs[step, index]), "got": int(answers[step, index])}
            self._note(lane, vectors[step], Place(start + step), output=index, **what)
        if choices is not None:
            assert isinstance(self.action, DiscreteAction)
            for step, (row, got) in enumerate(zip(outputs, choices.tolist(), strict=True)):
                expected = self.action.decode(row, self.controller.frac_bits)
                if got != expected:
                    place = Place(start + step)
                    self._note(lane, vectors[step], place, output="decide", expected=expected, got=got)
        lane.vectors += len(vectors)
        return True

    def _find_crash(
        self, lane: Lane, vectors: npt.NDArray[np.int16], outputs: npt.NDArray[np.int16], start: int
    ) -> None:
        """Take the steps again, one by one, to see which it was."""
        lane.lost = True
        lane.implementation.restart()
        step, reason = 0, "crashed, but not again when the steps were repeated one by one"
        try:
            lane.implementation.reset()
            for step, (inputs, expected) in enumerate(zip(vectors, outputs, strict=True)):
                self._compare(lane, inputs, expected, Place(start + step))
        except ImplementationError as error:
            reason = str(error)
        self._note(lane, vectors[step], Place(start + step), reason=reason)

    def _running(self) -> list[Lane]:
        return [lane for lane in self.lanes if not lane.lost]

    def _compare(self, lane: Lane, inputs: Int16Array, outputs: Int16Array, place: Place) -> None:
        answer = lane.implementation.step(inputs)
        if place.episode is None:
            lane.vectors += 1
        else:
            lane.steps += 1
        for index in np.flatnonzero(answer != outputs).tolist():
            self._note(lane, inputs, place, output=index, expected=int(outputs[index]), got=int(answer[index]))
        if isinstance(self.action, DiscreteAction):
            choice = lane.implementation.decide(outputs)
            expected = self.action.decode(outputs, self.controller.frac_bits)
            if choice is not None and choice != expected:
                self._note(lane, inputs, place, output="decide", expected=expected, got=choice)

    @staticmethod
    def _note(lane: Lane, inputs: Int16Array, place: Place, **what: Any) -> None:
        lane.mismatches += 1
        if lane.first is None:
            lane.first = Mismatch(lane.implementation.title, place, tuple(inputs.tolist()), **what)


def closed_loop(
    comparison: Comparison,
    spec: EnvironmentSpec,
    seeds: Sequence[int],
    *,
    max_steps: int | None = None,
    record: bool = False,
    progress: Progress | None = None,
) -> LoopResult:
    """Run episodes, comparing every output of every step.

    Args:
        comparison: its reference controls the environment.
        spec: the environment, made afresh for each episode.
        seeds: one for each episode.
        max_steps: cut episodes short; None leaves that to the environment.
        record: keep the inputs and outputs of every step.
        progress: told of each episode.

    Raises:
        BitneatError: if the environment cannot be made, or an observation holds a NaN.
    """
    account = _Account(comparison.controller, comparison.action)
    episodes = []
    for number, seed in enumerate(seeds):
        environment = make(spec)
        try:
            runner = _EpisodeRunner(comparison, environment, account, max_steps, record)
            episodes.append(runner.run(number, seed))
        finally:
            environment.close()
        if progress is not None:
            progress(number + 1, len(seeds), episodes[-1])
    return LoopResult(tuple(episodes), account.input_ranges(), account.saturated)


class _Account:
    """What the sensors delivered and how often an output was at its limit."""

    def __init__(self, controller: Controller, action: Action) -> None:
        self.saturated = 0
        count = len(controller.inputs)
        self._low, self._high = np.full(count, math.inf), np.full(count, -math.inf)
        self._clipped = np.zeros(count, dtype=np.int64)
        self._factor = np.array([2.0 ** (controller.frac_bits + entry.scale) for entry in controller.inputs])
        self._limit = np.array([float(entry.limit) for entry in controller.inputs])
        # A Box output at or beyond ±1 has used up its range; a choice among several has no range but the signal's own.
        self._full = controller.one if isinstance(action, BoxAction) else SIGNAL_MAX

    def observation(self, values: npt.NDArray[np.float64]) -> None:
        with np.errstate(over="ignore"):
            self._clipped += np.abs(np.rint(values * self._factor)) > self._limit
        np.minimum(self._low, values, out=self._low)
        np.maximum(self._high, values, out=self._high)

    def outputs(self, outputs: Int16Array) -> None:
        self.saturated += int(np.count_nonzero(np.abs(outputs.astype(np.int32)) >= self._full))

    def input_ranges(self) -> tuple[InputRange, ...]:
        return tuple(
            InputRange(float(low), float(high), int(clipped))
            for low, high, clipped in zip(self._low, self._high, self._clipped, strict=True)
        )


@dataclass(frozen=True, slots=True)
class _EpisodeRunner:
    comparison: Comparison
    environment: Any
    account: _Account
    max_steps: int | None
    record: bool

    def run(self, number: int, seed: int) -> Episode:
        comparison = self.comparison
        encode, frac_bits = Encoder(comparison.controller), comparison.controller.frac_bits
        rows: list[Int16Array] = []
        answers: list[Int16Array] = []
        reward, steps, over = 0.0, 0, False
        comparison.reset()
        observation, _ = self.environment.reset(seed=seed)
        while not over and (self.max_steps is None or steps < self.max_steps):
            flat = np.reshape(observation, -1).astype(np.float64)
            inputs = encode(flat)
            outputs = comparison.step(inputs, Place(steps, number, seed))
            self.account.observation(flat)
            self.account.outputs(outputs)
            if self.record:
                rows.append(inputs)
                answers.append(outputs)
            action = comparison.action.decode(outputs, frac_bits)
            observation, gain, terminated, truncated, _ = self.environment.step(action)
            reward += float(gain)
            steps += 1
            over = bool(terminated or truncated)
        if not self.record:
            return Episode(seed, steps, reward)
        return Episode(seed, steps, reward, np.stack(rows), np.stack(answers))
