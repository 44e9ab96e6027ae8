# SPDX-License-Identifier: MIT
"""The candidates' episodes against Gymnasium; the statistics against NumPy over all that was observed. No library is needed."""

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from bitneat.baselines.candidates import Candidates, episode_seeds
from bitneat.evolve.randomness import SELECTION_START


class Recorded:
    """Moments that keep what they are given."""

    def __init__(self, mean: npt.NDArray[np.float64], var: npt.NDArray[np.float64]) -> None:
        self.mean, self.var = mean, var
        self.updates: list[npt.NDArray[Any]] = []

    def update(self, arr: npt.NDArray[Any]) -> None:
        self.updates.append(arr)


WEIGHTS = np.random.default_rng(5).normal(0.0, 0.5, (4, 100)).astype(np.float32)
MEAN = np.random.default_rng(6).normal(0.0, 0.1, 24)
VARIANCE = np.random.default_rng(7).uniform(0.5, 2.0, 24)


def in_gymnasium(row: npt.NDArray[np.float32], seed: int) -> tuple[float, list[npt.NDArray[np.float32]]]:
    """A candidate's episode: reward, and observations that it acted on."""
    env = gymnasium.make("BipedalWalker-v3")
    observation, _ = env.reset(seed=seed)
    seen = []
    total, over = 0.0, False
    while not over:
        seen.append(observation)
        normal = ((observation - MEAN) / np.sqrt(VARIANCE + 1e-8)).astype(np.float32)
        action = row[96:].copy()
        for source in range(24):
            action += row[:96].reshape(4, 24)[:, source] * normal[source]
        observation, reward, terminated, truncated, _ = env.step(action)
        total, over = total + float(reward), terminated or truncated
    env.close()
    return total, seen


def test_each_candidate_walks_gymnasiums_episode_and_all_observations_are_counted_once() -> None:
    moments = Recorded(MEAN, VARIANCE)
    candidates = Candidates(1, 4, moments, 1e-8, with_bias=True)
    candidates.send_jobs(WEIGHTS, 4)
    expected = [in_gymnasium(row, seed) for row, seed in zip(WEIGHTS, episode_seeds(1, 0, 4), strict=True)]
    assert list(candidates.get_results()) == [(i, ([r], [len(seen)])) for i, (r, seen) in enumerate(expected)]
    assert candidates.steps == sum(len(seen) for _, seen in expected)
    assert (candidates.episodes, candidates.updates, len(moments.updates)) == (4, 1, 1)
    ours = np.array(sorted(map(tuple, moments.updates[0].tolist())))
    np.testing.assert_array_equal(ours, np.array(sorted(tuple(o.tolist()) for _, seen in expected for o in seen)))


def test_the_next_update_is_normalised_by_the_statistics_as_the_last_one_left_them() -> None:
    class Moving(Recorded):
        def update(self, arr: npt.NDArray[Any]) -> None:
            super().update(arr)
            self.mean += 1.0

    fixed, moving = Recorded(MEAN.copy(), VARIANCE), Moving(MEAN.copy(), VARIANCE)
    for moments in (fixed, moving):
        candidates = Candidates(1, 4, moments, 1e-8, with_bias=True)
        candidates.send_jobs(WEIGHTS, 4)
        candidates.send_jobs(WEIGHTS, 4)
    np.testing.assert_array_equal(fixed.updates[0], moving.updates[0])
    assert not np.array_equal(fixed.updates[1], moving.updates[1])


def test_a_policy_without_bias_has_none() -> None:
    without, zero = Recorded(MEAN, VARIANCE), Recorded(MEAN, VARIANCE)
    Candidates(2, 4, without, 1e-8).send_jobs(WEIGHTS[:, :96], 4)
    table = np.concatenate([WEIGHTS[:, :96], np.zeros((4, 4), np.float32)], axis=1)
    Candidates(2, 4, zero, 1e-8, with_bias=True).send_jobs(table, 4)
    np.testing.assert_array_equal(without.updates[0], zero.updates[0])


def test_every_update_has_other_seeds_and_none_that_policies_are_scored_on() -> None:
    drawn = [seed for update in range(50) for seed in episode_seeds(3, update, 128)]
    assert all(0 <= seed < SELECTION_START for seed in drawn)
    assert len(set(drawn)) > 0.999 * len(drawn)
    assert episode_seeds(3, 7, 5) == episode_seeds(3, 7, 5) != episode_seeds(4, 7, 5)
