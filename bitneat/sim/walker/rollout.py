# SPDX-License-Identifier: MIT
"""One episode each of many walkers under any policy written in Python; walkers whose episode has ended take no time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from bitneat.errors import BitneatError
from bitneat.sim.walker.vector import STEP_LIMIT, WalkerVectorEnv

Policy = Callable[[npt.NDArray[np.int32], npt.NDArray[np.float32]], npt.NDArray[np.float32]]
"""Indices of walkers, shape (n,), and what they observe, (n, 24), to actions (n, 4)."""


def run_policy(
    policy: Policy,
    seeds: Sequence[int],
    max_steps: int = STEP_LIMIT,
    *,
    hardcore: bool = False,
    lanes: int | None = None,
    threads: int | None = None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """Run an episode on every seed, side by side, each until it terminates or has had ``max_steps`` steps.

    Args:
        policy: called once a step with those walkers that still walk, in the order of their seeds.
        seeds: as of Gymnasium's ``reset(seed=…)``.
        max_steps: the time limit.
        hardcore: with ladders, stumps and pitfalls.
        lanes: walkers side by side in a thread; see `WalkerVectorEnv`.
        threads: one a core if not given.

    Returns:
        The official rewards, summed in float64 in the order of the steps, and the steps taken; both (seeds,).

    Raises:
        BitneatError: if an argument is out of range, or an action is not four numbers for each walker or is NaN.
    """
    rewards = np.zeros(len(seeds), np.float64)
    steps = np.zeros(len(seeds), np.int32)
    if len(seeds) == 0:
        return rewards, steps
    envs = WalkerVectorEnv(len(seeds), hardcore, max_episode_steps=max_steps, lanes=lanes, threads=threads)
    try:
        envs.reset(seed=list(seeds))
        walking = np.arange(len(seeds), dtype=np.int32)
        while len(walking) > 0:
            actions = np.ascontiguousarray(policy(walking, envs.observed(walking)), np.float32)
            if actions.shape != (len(walking), 4) or np.isnan(actions).any():
                raise BitneatError(f"policy: expected actions of shape ({len(walking)}, 4) without NaN")
            gained, terminated = envs.advance(walking, actions)
            rewards[walking] += gained
            steps[walking] += 1
            walking = walking[~terminated & (steps[walking] < max_steps)]
    finally:
        envs.close()
    return rewards, steps
