# SPDX-License-Identifier: MIT
"""The comparison and the loop, judged with implementations of known faults and an environment that can be reckoned by hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, BoxAction, Controller, DiscreteAction, Input, Link, Node, Reference, Signal
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.loop import Comparison, Episode, Lane, Mismatch, Place, closed_loop

Vectors = npt.NDArray[np.int16]

# The first output is the sum of x0 and x1, the second is x1 less the first output of the step before.
CONTROLLER = Controller(
    (Input(0, 1000), Input(0, 1000)),
    (
        Node((Link(0), Link(1)), activation="identity"),
        Node((Link(1), Link(2, 1, sign=-1)), activation="identity"),
    ),
    (Signal(2), Signal(3)),
    8,
)
BOX = BoxAction((-1.0, -1.0), (1.0, 1.0), (2,), "float32")
CHOICE = DiscreteAction(2, 5)
VECTORS = np.arange(40, dtype=np.int16).reshape(20, 2) * 7 % 90


@dataclass
class Fake:
    """The reference with faults: in output 1 at some calls, in the choice of some outputs; it dies at one of its calls."""

    wrong_at: frozenset[int] = frozenset()
    dies_at: int | None = None
    dies_again: bool = True
    chooses: bool = True
    wrong_choice: int | None = None
    decide_dies: bool = False
    reset_dies: bool = False
    title: str = "fake"
    calls: int = 0
    resets: int = 0
    restarts: int = 0
    log: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.reference = Reference(CONTROLLER)

    def reset(self) -> None:
        self.resets += 1
        self.log.append("reset")
        self.reference.reset()
        if self.reset_dies:
            raise ImplementationError("crashed at its reset")

    def step(self, inputs: Vectors) -> Vectors:
        self.log.append("step")
        outputs = np.array(self.reference.step(inputs.tolist()), np.int16)
        if self.calls == self.dies_at and (self.dies_again or not self.restarts):
            raise ImplementationError("crashed (SIGSEGV)")
        if self.calls in self.wrong_at:
            outputs[1] += 3
        self.calls += 1
        return outputs

    def run(self, inputs: Vectors) -> Vectors:
        return np.array([self.step(row) for row in inputs])

    def decide(self, outputs: Vectors) -> int | None:
        return int(self.decisions(outputs.reshape(1, -1))[0, 0]) if self.chooses else None

    def decisions(self, outputs: Vectors) -> npt.NDArray[np.int32]:
        assert self.chooses
        if self.decide_dies:
            raise ImplementationError("crashed in its choice")
        right = np.array([CHOICE.decode(row, 8) for row in outputs], np.int32)
        if self.wrong_choice is not None:
            right[outputs[:, 0] == self.wrong_choice] = 9
        return right.reshape(-1, 1)

    def restart(self) -> None:
        self.restarts += 1
        self.calls = 0

    def close(self) -> None:
        pass


def compared(fake: Fake, action: Action = BOX, sequence: int = 5, **limits: int) -> Lane:
    """The lane after all vectors, each few of them from reset."""
    lane = Lane(fake, **limits)
    Comparison(CONTROLLER, action, [lane]).vectors(VECTORS, sequence)
    return lane


def expected(step: int, sequence: int = 5) -> list[int]:
    """What is right at a vector, reckoned by hand."""
    x0, x1 = VECTORS[step].tolist()
    before = 0 if step % sequence == 0 else int(VECTORS[step - 1].sum())
    return [x0 + x1, x1 - before]


@pytest.mark.parametrize("action", [BOX, CHOICE])
@pytest.mark.parametrize("chooses", [False, True])
def test_what_is_right_is_compared_and_nothing_is_found(action: Action, chooses: bool) -> None:
    fake = Fake(chooses=chooses)
    lane = compared(fake, action)
    assert (lane.vectors, lane.steps, lane.mismatches, lane.first, lane.lost) == (20, 0, 0, None, False)
    assert (fake.calls, fake.resets) == (20, 4)


def test_vectors_are_taken_from_reset_to_reset_up_to_the_lanes_own_number() -> None:
    fake = Fake()
    lane = compared(fake, max_vectors=12)
    assert lane.vectors == fake.calls == 12
    assert fake.log == [*(["reset", *["step"] * 5] * 2), "reset", "step", "step"]
    assert compared(Fake(), max_vectors=30).vectors == 20


def test_each_wrong_output_is_counted_and_the_first_is_named() -> None:
    lane = compared(Fake(wrong_at=frozenset({7, 8, 13})))
    assert (lane.vectors, lane.mismatches, lane.lost) == (20, 3, False)
    right = expected(7)[1]
    assert lane.first == Mismatch("fake", Place(7), tuple(VECTORS[7].tolist()), 1, right, right + 3)
    assert str(lane.first) == f"fake: vector 7: output 1 is {right + 3}, expected {right}"


def test_each_wrong_choice_is_counted_and_the_first_is_named() -> None:
    wrong = expected(6)[0]
    same = [step for step in range(20) if expected(step)[0] == wrong]
    lane = compared(Fake(wrong_choice=wrong), CHOICE)
    assert (lane.vectors, lane.mismatches) == (20, len(same))
    right = 5 + int(expected(6)[1] > wrong)
    assert lane.first == Mismatch("fake", Place(same[0]), tuple(VECTORS[6].tolist()), "decide", right, 9)
    assert str(lane.first) == f"fake: vector 6: the decision is 9, expected {right}"


def test_of_what_chooses_among_nothing_no_choice_is_asked() -> None:
    assert compared(Fake(decide_dies=True)).mismatches == 0


def test_a_crash_is_found_by_its_step_and_ends_the_lane() -> None:
    fake = Fake(dies_at=7)
    fake.restart = lambda: setattr(fake, "calls", 5)  # type: ignore[method-assign]  # of the second sequence
    lane = compared(fake)
    assert lane.lost
    assert lane.mismatches == 1
    assert lane.first == Mismatch("fake", Place(7), tuple(VECTORS[7].tolist()), reason="crashed (SIGSEGV)")
    assert str(lane.first) == "fake: vector 7: crashed (SIGSEGV)"
    assert lane.vectors == 7  # the sequence before it, and those that were repeated
    assert fake.resets == 3


def test_a_crash_that_does_not_come_again_is_one_all_the_same() -> None:
    fake = Fake(dies_at=2, dies_again=False)
    lane = compared(fake)
    assert lane.lost
    assert fake.restarts == 1
    assert lane.first is not None
    assert (lane.first.place.step, lane.mismatches) == (4, 1)
    assert lane.first.reason == "crashed, but not again when the steps were repeated one by one"


def test_a_choice_that_crashes_is_a_finding() -> None:
    lane = compared(Fake(decide_dies=True), CHOICE)
    assert lane.lost
    assert str(lane.first) == "fake: vector 0: crashed in its choice"


def test_the_others_go_on_where_one_is_lost() -> None:
    lanes = [Lane(Fake(dies_at=0)), Lane(Fake())]
    told: list[str] = []
    comparison = Comparison(CONTROLLER, BOX, lanes)
    comparison.vectors(VECTORS, 5, told.append)
    assert [lane.lost for lane in lanes] == [True, False]
    assert told == ["fake", "fake"]
    comparison.vectors(VECTORS, 5, told.append)
    assert lanes[1].vectors == 40
    assert told == ["fake"] * 3


class Ramp(gymnasium.Env[Any, Any]):
    """Observations (k, -2 k) / 256 at the k-th step, k from the seed; ten steps; the reward is the seed and the action's sum."""

    opened = 0
    closed = 0

    def __init__(self) -> None:
        self.observation_space = gymnasium.spaces.Box(-100.0, 100.0, (2,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        Ramp.opened += 1

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        assert seed is not None
        self.seed, self.k = seed, seed
        return self._observed(), {}

    def step(self, action: Any) -> Any:
        self.k += 1
        over = self.k == self.seed + 10
        return self._observed(), self.seed + float(np.sum(action)), over and self.seed == 200, over, {}

    def _observed(self) -> Any:
        return np.array([self.k / 256, -2 * self.k / 256], np.float32)

    def close(self) -> None:
        Ramp.closed += 1


@pytest.fixture
def ramp() -> Iterator[EnvironmentSpec]:
    gymnasium.register("Ramp-v0", entry_point=Ramp)
    Ramp.opened = Ramp.closed = 0
    yield EnvironmentSpec("Ramp-v0")
    del gymnasium.registry["Ramp-v0"]


def reckoned(seed: int, steps: int = 10) -> tuple[list[list[int]], list[list[int]], float]:
    """Inputs, outputs and reward of an episode of the ramp, by hand."""
    inputs = [[min(k, 1000), max(-2 * k, -1000)] for k in range(seed, seed + steps)]
    sums = [x0 + x1 for x0, x1 in inputs]
    outputs = [[sums[i], inputs[i][1] - (sums[i - 1] if i else 0)] for i in range(steps)]
    reward = sum(seed + sum(max(-1.0, min(1.0, y / 256)) for y in row) for row in outputs)
    return inputs, outputs, reward


def test_episodes_are_the_references(ramp: EnvironmentSpec) -> None:
    lane, told = Lane(Fake()), []
    comparison = Comparison(CONTROLLER, BOX, [lane])
    result = closed_loop(
        comparison, ramp, [3, 200], record=True, progress=lambda *state: told.append((*state[:2], state[2].seed))
    )
    assert (lane.steps, lane.vectors, lane.mismatches) == (20, 0, 0)
    assert told == [(1, 2, 3), (2, 2, 200)]
    assert Ramp.opened == Ramp.closed == 2
    assert result.steps == 20
    for episode, seed in zip(result.episodes, (3, 200), strict=True):
        inputs, outputs, reward = reckoned(seed)
        assert episode.inputs is not None
        assert episode.outputs is not None
        assert episode.inputs.tolist() == inputs
        assert episode.outputs.tolist() == outputs
        assert episode.reward == pytest.approx(reward, abs=1e-4)
        assert (episode.seed, episode.steps) == (seed, 10)


def test_what_sensors_deliver_and_outputs_use_up_is_counted(ramp: EnvironmentSpec) -> None:
    result = closed_loop(Comparison(CONTROLLER, BOX, []), ramp, [3, 495])
    outputs = [row for seed in (3, 495) for row in reckoned(seed)[1]]
    full = sum(abs(y) >= 256 for row in outputs for y in row)
    assert result.saturated_outputs == full
    assert 0 < full < 40
    first, second = result.inputs
    assert (first.min, first.max, first.clipped) == (3 / 256, 504 / 256, 0)
    assert (second.min, second.max, second.clipped) == (-1008 / 256, -6 / 256, 4)  # beyond 1000 / 256 from k = 501 on
    assert result.episodes == (Episode(3, 10, result.episodes[0].reward), Episode(495, 10, result.episodes[1].reward))


def test_an_output_of_one_is_used_up_and_one_below_is_not(ramp: EnvironmentSpec) -> None:
    # Output 0 is -k: -255 and -256; output 1 is -2 k less -(k - 1).
    result = closed_loop(Comparison(CONTROLLER, BOX, []), ramp, [255], max_steps=2)
    assert [row[0] for row in reckoned(255, 2)[1]] == [-255, -256]
    assert result.saturated_outputs == 1 + sum(abs(row[1]) >= 256 for row in reckoned(255, 2)[1])


def test_episodes_can_be_cut_short(ramp: EnvironmentSpec) -> None:
    result = closed_loop(Comparison(CONTROLLER, BOX, []), ramp, [3], max_steps=4)
    assert [(episode.steps, episode.inputs) for episode in result.episodes] == [(4, None)]
    assert result.episodes[0].reward == pytest.approx(reckoned(3, 4)[2], abs=1e-4)


def test_a_lane_takes_part_in_as_many_episodes_as_it_is_given(ramp: EnvironmentSpec) -> None:
    lanes = [Lane(Fake(), max_episodes=1), Lane(Fake())]
    closed_loop(Comparison(CONTROLLER, BOX, lanes), ramp, [1, 2])
    assert [lane.steps for lane in lanes] == [10, 20]


def test_a_mismatch_of_an_episode_names_it_with_its_seed(ramp: EnvironmentSpec) -> None:
    lane = Lane(Fake(wrong_at=frozenset({13})))
    closed_loop(Comparison(CONTROLLER, BOX, [lane]), ramp, [1, 90])
    inputs, outputs, _ = reckoned(90)
    place = Place(3, 1, 90)
    assert lane.first == Mismatch("fake", place, tuple(inputs[3]), 1, outputs[3][1], outputs[3][1] + 3)
    assert str(lane.first).startswith("fake: episode 1 (seed 90), step 3: output 1 is ")
    assert lane.first is not None
    assert lane.first.to_data() == {
        "target": "fake",
        "episode": 1,
        "seed": 90,
        "step": 3,
        "output": 1,
        "expected": outputs[3][1],
        "got": outputs[3][1] + 3,
        "reason": None,
        "inputs": inputs[3],
    }


@pytest.mark.parametrize("chooses", [False, True])
def test_a_choice_in_an_episode_is_compared_where_the_code_makes_one(ramp: EnvironmentSpec, chooses: bool) -> None:
    outputs = reckoned(90)[1]
    lane = Lane(Fake(chooses=chooses, wrong_choice=outputs[2][0]))
    comparison = Comparison(CONTROLLER, CHOICE, [lane])
    for step, row in enumerate(reckoned(90)[0]):
        assert comparison.step(np.array(row, np.int16), Place(step, 0, 90)).tolist() == outputs[step]
    assert lane.mismatches == int(chooses)
    if chooses:
        right = 5 + int(outputs[2][1] > outputs[2][0])
        assert lane.first == Mismatch("fake", Place(2, 0, 90), tuple(reckoned(90)[0][2]), "decide", right, 9)


def test_a_crash_at_a_reset_is_found_at_the_next_step(ramp: EnvironmentSpec) -> None:
    lane = Lane(Fake(reset_dies=True, dies_at=0))
    result = closed_loop(Comparison(CONTROLLER, BOX, [lane]), ramp, [1])
    assert lane.lost
    assert str(lane.first) == "fake: episode 0 (seed 1), step 0: crashed (SIGSEGV)"
    assert result.steps == 10
