# SPDX-License-Identifier: MIT
"""`run_policy` against one episode after the other in Gymnasium."""

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest

from bitneat.errors import BitneatError
from bitneat.sim.walker.rollout import run_policy

SEEDS = (3, 11, 40, 5)
GAINS = np.random.default_rng(1).normal(0.0, 1.0, (len(SEEDS), 4, 24)).astype(np.float32)


def swinging(which: npt.NDArray[np.int32], observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """A policy of its own for each walker, element by element so that no library chooses an order."""
    return np.array(
        [
            [np.sin(float((gain * seen).astype(np.float64).sum())) for gain in GAINS[i]]
            for i, seen in zip(which, observations, strict=True)
        ],
        np.float32,
    )


def in_gymnasium(index: int, seed: int, max_steps: int) -> tuple[float, int]:
    env = gymnasium.make("BipedalWalker-v3")
    observation, _ = env.reset(seed=seed)
    total, steps, over = 0.0, 0, False
    while not over and steps < max_steps:
        observation, reward, terminated, truncated, _ = env.step(swinging(np.array([index]), observation[None])[0])
        total, steps, over = total + float(reward), steps + 1, terminated or truncated
    env.close()
    return total, steps


def test_every_walker_has_gymnasiums_reward_and_length_whichever_others_have_ended() -> None:
    rewards, steps = run_policy(swinging, SEEDS, 150, threads=1)
    expected = [in_gymnasium(index, seed, 150) for index, seed in enumerate(SEEDS)]
    assert list(zip(rewards.tolist(), steps.tolist(), strict=True)) == expected
    assert len(set(steps.tolist())) > 1, "all ended together, which tests nothing"


def test_a_policy_is_asked_for_those_alone_that_still_walk() -> None:
    asked: list[list[int]] = []

    def policy(which: npt.NDArray[np.int32], observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        asked.append(which.tolist())
        assert observations.shape == (len(which), 24)
        return swinging(which, observations)

    _, steps = run_policy(policy, SEEDS, 150, threads=1)
    assert asked == [[i for i in range(len(SEEDS)) if steps[i] > step] for step in range(max(steps))]


def test_no_seeds_are_no_episodes() -> None:
    rewards, steps = run_policy(swinging, [])
    assert rewards.shape == steps.shape == (0,)


@pytest.mark.parametrize("actions", [np.zeros((4, 3)), np.zeros(4), np.full((4, 4), np.nan)])
def test_actions_that_are_not_four_numbers_for_each_are_refused(actions: Any) -> None:
    with pytest.raises(BitneatError, match=r"policy: expected actions of shape \(4, 4\) without NaN"):
        run_policy(lambda which, observations: actions, SEEDS, 10)
