# SPDX-License-Identifier: MIT
"""Environments with unusual spaces, for tests."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

_PLAIN = spaces.Box(-1.0, 1.0, (2,), np.float32)
_SPACES: dict[str, tuple[Any, Any]] = {
    "Dict": (spaces.Dict({"a": _PLAIN}), _PLAIN),
    "Image": (spaces.Box(0, 255, (8, 8, 3), np.uint8), _PLAIN),
    "Unbounded": (_PLAIN, spaces.Box(-np.inf, np.inf, (2,), np.float32)),
    "MultiBinary": (_PLAIN, spaces.MultiBinary(3)),
    "Matrix": (spaces.Box(-3, 3, (2, 3), np.float64), spaces.Box(-2.0, 2.0, (2, 2), np.float64)),
    "Started": (spaces.Box(-9, 9, (2,), np.int32), spaces.Discrete(3, start=5)),
    "Wide": (spaces.Box(-1000.0, 1000.0, (1,), np.float32), _PLAIN),
    "NaN": (_PLAIN, _PLAIN),
    "Missing": (_PLAIN, _PLAIN),
    "Endless": (_PLAIN, _PLAIN),
    "Failing": (_PLAIN, _PLAIN),
    "Broken": (_PLAIN, _PLAIN),
    "Quitting": (_PLAIN, _PLAIN),
    "NaNReward": (_PLAIN, _PLAIN),
    "InfReward": (_PLAIN, _PLAIN),
    "Far": (_PLAIN, spaces.Discrete(3, start=2**40)),
    "Huge": (spaces.Box(-1.0, 1.0, (130, 130), np.float32), _PLAIN),
}


class Strange(gymnasium.Env[Any, Any]):
    """Observations are constant, but for NaN, whose third is one; actions must be in their space."""

    def __init__(self, kind: str) -> None:
        if kind == "Missing":
            raise gymnasium.error.DependencyNotInstalled("pip install\nsomething")
        if kind == "Broken":
            raise KeyError("no\nwheels")
        if kind == "Quitting":
            raise SystemExit(0)
        self.observation_space, self.action_space = _SPACES[kind]
        self._kind = kind
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._steps = 0
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action), action
        self._steps += 1
        if self._kind == "Failing":
            raise RuntimeError("the wheels\ncame off")
        reward = {"NaNReward": np.nan, "InfReward": np.inf}.get(self._kind, 1.0)
        return self._observation(), reward, False, False, {}

    def _observation(self) -> Any:
        value = np.ones(self.observation_space.shape, self.observation_space.dtype)
        return value * np.nan if self._kind == "NaN" and self._steps == 2 else value


def register() -> None:
    """Make the environments known as bitneat/KIND-v0."""
    for kind in _SPACES:
        name = f"bitneat/{kind}-v0"
        if name not in gymnasium.registry:
            limit = None if kind == "Endless" else 50
            gymnasium.register(name, entry_point=Strange, max_episode_steps=limit, kwargs={"kind": kind})


register()
