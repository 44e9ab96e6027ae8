# SPDX-License-Identifier: MIT
"""An environment of one's own: a room that is to stay at 20 degrees, with a heater that is on or off.

Importing the module registers it as Thermostat-v0.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

WANTED = 20.0


class Thermostat(gymnasium.Env[npt.NDArray[np.float32], np.int64]):
    """The observation is (degrees above the wanted temperature, degrees outside / 10), the action 0 (off) or 1 (on).

    A step is five minutes; its reward is 1 less the distance from the wanted temperature in degrees, and at least 0.
    """

    # Finite bounds are where bitneat gets the scale of an input from.
    observation_space = gymnasium.spaces.Box(np.float32([-30.0, -2.0]), np.float32([30.0, 3.0]))
    action_space = gymnasium.spaces.Discrete(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Draw the temperatures; all randomness comes from the seed, or results could not be repeated."""
        super().reset(seed=seed, options=options)
        self._inside, self._outside = self.np_random.uniform(5.0, 30.0), self.np_random.uniform(-15.0, 10.0)
        return self._observation(), {}

    def step(self, action: np.int64) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Heat or not for five minutes."""
        self._inside += 0.02 * (self._outside - self._inside) + 1.2 * int(action)
        return self._observation(), max(0.0, 1.0 - abs(self._inside - WANTED)), False, False, {}

    def _observation(self) -> npt.NDArray[np.float32]:
        return np.array([self._inside - WANTED, self._outside / 10.0], np.float32)


gymnasium.register("Thermostat-v0", entry_point=Thermostat, max_episode_steps=200)
