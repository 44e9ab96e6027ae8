# SPDX-License-Identifier: MIT
"""The episodes of augmented random search's candidates, all of an update side by side in the native walker.

sb3-contrib's ARS evaluates its candidates one after the other, or in processes through an object with the methods of its
``AsyncEval``. `Candidates` has those methods, so that the algorithm stays the library's and only the episodes are ours.

As in the original (Mania, Guy and Recht 2018, "Simple random search provides a competitive approach to reinforcement learning",
V2), the statistics that observations are normalised by change between updates, not within: all candidates of one see the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bitneat.evolve.randomness import SELECTION_START
from bitneat.sim.walker.rollout import run_policy
from bitneat.sim.walker.vector import NUM_ACTIONS, NUM_OBSERVATIONS

Floats = npt.NDArray[np.float32]


class Moments(Protocol):
    """Running mean and variance of observations, each (24,): stable-baselines3's ``RunningMeanStd``."""

    mean: npt.NDArray[np.float64]
    var: npt.NDArray[np.float64]

    def update(self, arr: npt.NDArray[Any]) -> None:
        """Take in observations (n, 24)."""


class Candidates:
    """Runs linear policies, and keeps the observations' statistics.

    Args:
        seed: of the episodes' seeds.
        population: candidates in an update.
        moments: what observations are normalised by; updated after each update's episodes with all that were seen.
        epsilon: added to the variance.
        with_bias: whether a candidate's weights, (4, 24) by rows, are followed by 4 biases.
    """

    def __init__(self, seed: int, population: int, moments: Moments, epsilon: float, with_bias: bool = False) -> None:
        self.remotes = range(population)
        """The library counts one step for each of them at a time."""
        self.updates = self.episodes = self.steps = 0
        self.returns: npt.NDArray[np.float64] = np.zeros(0)
        """Of the last update's candidates."""
        self._seed, self._moments, self._epsilon = seed, moments, epsilon
        self._with_bias = with_bias
        self._lengths: npt.NDArray[np.int32] = np.zeros(0, np.int32)

    def send_jobs(self, candidate_weights: Any, pop_size: int) -> None:
        """Run an episode with each row of a tensor (candidates, weights)."""
        table = np.asarray(candidate_weights, np.float32)
        size = NUM_ACTIONS * NUM_OBSERVATIONS
        weights = table[:, :size].reshape(pop_size, NUM_ACTIONS, NUM_OBSERVATIONS)
        bias = table[:, size:] if self._with_bias else np.zeros((pop_size, NUM_ACTIONS), np.float32)
        mean = self._moments.mean.copy()
        deviation = np.sqrt(self._moments.var + self._epsilon)
        seen: list[Floats] = []

        def act(which: npt.NDArray[np.int32], observations: Floats) -> Floats:
            seen.append(observations)
            normal = ((observations - mean) / deviation).astype(np.float32)
            # One input after the other: a matrix product's order, and so its last bits, may depend on where the arrays lie.
            actions = bias[which]
            for source in range(NUM_OBSERVATIONS):
                actions += weights[which, :, source] * normal[:, source, None]
            return actions

        self.returns, self._lengths = run_policy(act, episode_seeds(self._seed, self.updates, pop_size), threads=1)
        self._moments.update(np.concatenate(seen))
        self.updates += 1
        self.episodes += pop_size
        self.steps += int(self._lengths.sum())

    def get_results(self) -> Iterator[tuple[int, tuple[list[float], list[int]]]]:
        """Of each candidate: its index, and its episodes' rewards and lengths."""
        for index, (total, length) in enumerate(zip(self.returns.tolist(), self._lengths.tolist(), strict=True)):
            yield index, ([total], [length])

    def get_obs_rms(self) -> list[Any]:
        """None to merge: the statistics are up to date."""
        return []

    def sync_obs_rms(self, obs_rms: Any) -> None:
        """Nothing to do: there is one copy of the statistics."""

    def close(self) -> None:
        """Nothing to let go of."""


def episode_seeds(seed: int, update: int, count: int) -> list[int]:
    """The seeds of an update's episodes, all in the range of search seeds."""
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([0xA25, seed, update])))
    return [int(value) for value in generator.integers(SELECTION_START, size=count)]
