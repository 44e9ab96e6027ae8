# SPDX-License-Identifier: MIT
"""The native walkers as a vector environment of stable-baselines3, which must be installed to import this."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from bitneat.sim.walker.vector import WalkerVectorEnv, step_limit

FALL = -100.0
"""The reward of a step that ends in a fall, and of no other step."""
_MANY = 64
"""Walkers from which on more than one thread is worth its while."""


@dataclass(frozen=True)
class Training:
    """What is otherwise in episodes that train a walker than in those that score it."""

    fall: float = FALL
    """The reward of a fall."""
    stall_steps: int | None = None
    """An episode ends, with the reward of a fall, if so many steps have brought no `stall_gain`; None lets it go on.

    A walker that stands before an obstacle is no worse off than one that falls over it then, and learns nothing there for long.
    """
    stall_gain: float = 3.0
    """Of the sum of its rewards over the largest that it had; a whole course is worth 300."""


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
        training: other rewards and ends, of which the info's ``episode`` tells the official reward.
    """

    def __init__(
        self,
        num_envs: int,
        table: npt.NDArray[np.float32] | None = None,
        max_episode_steps: int | None = None,
        hardcore: bool = False,
        training: Training | None = None,
    ) -> None:
        self._training = training or Training()
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
        counted = np.where((rewards == FALL) | stalled, self._training.fall, rewards)
        return observations, counted.astype(np.float32), done, infos

    def _stalled(self) -> npt.NDArray[np.bool_]:
        """Which walkers have stood for too long."""
        risen = self._rewards > self._largest + self._training.stall_gain
        self._largest[risen] = self._rewards[risen]
        self._standing[:] = np.where(risen, 0, self._standing + 1)
        steps = self._training.stall_steps
        return self._standing >= steps if steps else np.zeros(self.num_envs, np.bool_)

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
