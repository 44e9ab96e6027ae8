# SPDX-License-Identifier: MIT
"""The native walkers as a vector environment of stable-baselines3, which must be installed to import this."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from bitneat.sim.bipedal import FALL_REWARD
from bitneat.sim.walker.vector import WalkerVectorEnv, step_limit

_MANY = 64
"""Walkers from which on more than one thread is worth its while."""


class WalkerVecEnv(VecEnv):
    """BipedalWalker-v3, ``num_envs`` times; few of them in one thread, many in as many as there are cores.

    An episode's end is as in the library's own: the observation is the next episode's first, the last one is the info's
    ``terminal_observation``, ``TimeLimit.truncated`` tells an end by the time limit alone,
    and ``episode`` has its reward and length.

    Args:
        num_envs: how many.
        table: if given, (actions, 4), an action is the index of a row.
        max_episode_steps: the time limit; if not given, the environment's own.
        hardcore: BipedalWalkerHardcore-v3.
        fall_value: as of `bitneat.sim.environment.Shaping`; the info's ``episode`` has the official reward all the same.
        stall_steps: as of `bitneat.sim.environment.Shaping`, but an episode that stops so counts as a fall: a walker that stands
            before an obstacle is no better off than one that falls over it, and learns nothing there for long.
        stall_gain: as of `bitneat.sim.environment.Shaping`.
    """

    def __init__(
        self,
        num_envs: int,
        table: npt.NDArray[np.float32] | None = None,
        max_episode_steps: int | None = None,
        hardcore: bool = False,
        *,
        fall_value: float = FALL_REWARD,
        stall_steps: int = 0,
        stall_gain: float = 0.0,
    ) -> None:
        self._fall_value, self._stall_steps, self._stall_gain = fall_value, stall_steps, stall_gain
        self._envs = WalkerVectorEnv(
            num_envs,
            hardcore,
            max_episode_steps=max_episode_steps or step_limit(hardcore),
            autoreset_mode=AutoresetMode.SAME_STEP,
            threads=None if num_envs >= _MANY else 1,
        )
        self._table = table
        self._actions: npt.NDArray[Any] = np.zeros((num_envs, 4), np.float32)
        self._rewards = np.zeros(num_envs, np.float64)
        self._lengths = np.zeros(num_envs, np.int64)
        self._largest = np.zeros(num_envs, np.float64)
        self._standing = np.zeros(num_envs, np.int64)
        self.episodes = 0
        """Episodes that ended."""
        space = self._envs.single_action_space if table is None else Discrete(len(table))
        super().__init__(num_envs, self._envs.single_observation_space, space)

    def reset(self) -> npt.NDArray[np.float32]:
        """Begin an episode in each environment, with the seeds that `VecEnv.seed` left, if it did."""
        observations, _ = self._envs.reset(seed=list(self._seeds))
        self._reset_seeds()
        self._begin(np.ones(self.num_envs, np.bool_))
        return observations

    def _begin(self, which: npt.NDArray[np.bool_]) -> None:
        for counts in (self._rewards, self._lengths, self._largest, self._standing):
            counts[which] = 0

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions if self._table is None else self._table[actions]

    def step_wait(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[Any]]:
        """Take the step: observations, rewards, which episodes ended, and infos."""
        observations, rewards, terminated, truncated, ends = self._envs.step(self._actions)
        ended = terminated | truncated
        self._rewards += rewards
        self._lengths += 1
        stalled = self._stalled() & ~ended
        last = observations
        if stalled.any():
            observations, _ = self._envs.reset(options={"reset_mask": stalled})
        done = ended | stalled
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(done).tolist():
            infos[index] = {
                "terminal_observation": last[index] if stalled[index] else ends["final_obs"][index],
                "TimeLimit.truncated": bool(truncated[index] and not terminated[index]),
                "episode": {"r": float(self._rewards[index]), "l": int(self._lengths[index])},
            }
        self.episodes += int(done.sum())
        self._begin(done)
        counted = np.where((rewards == FALL_REWARD) | stalled, self._fall_value, rewards)
        return observations, counted.astype(np.float32), done, infos

    def _stalled(self) -> npt.NDArray[np.bool_]:
        """Which walkers have stood for too long."""
        risen = self._rewards > self._largest + self._stall_gain
        self._largest[risen] = self._rewards[risen]
        self._standing[:] = np.where(risen, 0, self._standing + 1)
        return self._standing >= (self._stall_steps or np.inf)

    def close(self) -> None:
        """Free the walkers."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of each environment.

        Raises:
            AttributeError: if they have none of this name.
        """
        if attr_name != "render_mode":
            raise AttributeError(f"walkers have no attribute {attr_name!r}")
        return [None for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Refused: there is nothing to set."""
        raise AttributeError(f"of walkers {attr_name!r} cannot be set")

    def env_method(
        self, method_name: str, *args: Any, indices: int | Iterable[int] | None = None, **kwargs: Any
    ) -> list[Any]:
        """Refused: there is nothing to call."""
        raise AttributeError(f"walkers have no method {method_name!r}")

    def env_is_wrapped(self, wrapper_class: Any, indices: int | Iterable[int] | None = None) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]
