# SPDX-License-Identifier: MIT
"""BipedalWalker with the same physics and rewards to the bit, and less Python around them.

Gymnasium's ``step`` spends more than half of its time on `numpy.clip` of single numbers and on ten lidar rays. Here the rays that
the controller does not read are not cast, and the arithmetic is done on whole arrays, in the same order and precision. The
class is used only where Gymnasium's own ``step`` and ``reset`` are, to the letter, those it was written for and tested
against; with any other Gymnasium the plain environment runs.
"""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec

FIRST_RAY = 14
"""Index of the first of the ten lidar components of an observation."""
NUM_RAYS = 10
IDS = ("BipedalWalker-v3", "BipedalWalkerHardcore-v3")
"""Gymnasium's names for the walker on even and on uneven ground."""

FALL_REWARD = -100.0
"""Of a step that ends in a fall, and of no other."""

_ENTRY_POINT = "gymnasium.envs.box2d.bipedal_walker:BipedalWalker"
_KNOWN_SOURCES = {
    "__init__": {"c347686ebdb705248fb644e1f695f9b0041f6b4854660a1f6483b476cf773341"},
    "reset": {"d1317a6a31bbf81eb38f180d962e57631181b22b01db1aeff7cd79a8ec63b7e2"},
    "step": {"9c295793b2135f22fb05c73517753a841c43428715e9493ad698d2c860c49c63"},
}
"""SHA-256 of the source of each method that this module replaces or relies on: Gymnasium 1.4."""


def is_walker(spec: EnvironmentSpec) -> bool:
    """True iff it is one of `IDS`, with no other argument than ``hardcore``."""
    return spec.id in IDS and all(name == "hardcore" and isinstance(value, bool) for name, value in spec.kwargs.items())


def is_hardcore(spec: EnvironmentSpec) -> bool:
    """True iff the ground of this walker has ladders, stumps and pitfalls."""
    return bool(spec.kwargs.get("hardcore", spec.id == "BipedalWalkerHardcore-v3"))


def serves(spec: EnvironmentSpec) -> bool:
    """True iff an environment can be replaced by `LeanWalker` without changing a bit."""
    if not is_walker(spec):
        return False
    try:
        from gymnasium.envs.box2d.bipedal_walker import BipedalWalker
        from gymnasium.envs.registration import registry
    except Exception:  # a missing Box2D is reported where the environment is made
        return False
    # A module that --import named may have put another environment under the id.
    registered = registry.get(spec.id)
    if registered is None or registered.entry_point != _ENTRY_POINT or registered.additional_wrappers:
        return False
    return all(_digest(getattr(BipedalWalker, name)) in known for name, known in _KNOWN_SOURCES.items())


def make(spec: EnvironmentSpec, used_inputs: Sequence[int]) -> Any:
    """A `LeanWalker` without wrappers: the caller keeps the time limit."""
    return _lean_walker()(is_hardcore(spec), [i - FIRST_RAY for i in used_inputs if i >= FIRST_RAY])


@cache
def _digest(function: Any) -> str:
    return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()


@cache
def _lean_walker() -> Any:
    """The class, made when it is first needed, since Box2D is heavy and may be missing."""
    import Box2D
    from gymnasium.envs.box2d import bipedal_walker as original

    reach = [
        (math.sin(1.5 * i / 10.0) * original.LIDAR_RANGE, math.cos(1.5 * i / 10.0) * original.LIDAR_RANGE)
        for i in range(NUM_RAYS)
    ]
    full_speed = np.array([original.SPEED_HIP, original.SPEED_KNEE] * 2, dtype=np.float32)
    full_torque = np.float32(original.MOTORS_TORQUE)
    # A Python float times a float32 is a float32 product of the rounded float.
    energy = np.float32(0.00035 * original.MOTORS_TORQUE)
    goal = (original.TERRAIN_LENGTH - original.TERRAIN_GRASS) * original.TERRAIN_STEP

    class LeanWalker(original.BipedalWalker):
        """See the module. ``rays`` are the lidar rays that are cast; the others read 1, as if nothing were in reach."""

        def __init__(self, hardcore: bool, rays: Sequence[int]) -> None:
            super().__init__(hardcore=hardcore)
            self.rays = tuple(rays)

        def reset(
            self, *, seed: int | None = None, options: dict[str, Any] | None = None
        ) -> tuple[Any, dict[str, Any]]:
            # A new world instead of a new environment: nothing else outlives an episode.
            self.world = Box2D.b2World()
            self.terrain = []
            self.hull = None
            return super().reset(seed=seed, options=options)  # type: ignore[no-any-return]

        def step(self, action: npt.NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            if self.prev_shaping is None:  # the step inside reset, with integers as action
                return super().step(action)  # type: ignore[no-any-return]
            hip0, knee0, hip1, knee1 = joints = self.joints
            effort = np.minimum(np.abs(action), np.float32(1.0))
            speeds = (full_speed * np.sign(action)).tolist()
            for joint, speed, torque in zip(joints, speeds, (full_torque * effort).tolist(), strict=True):
                joint.motorSpeed = speed
                joint.maxMotorTorque = torque
            world, hull, legs = self.world, self.hull, self.legs
            world.Step(1.0 / original.FPS, 6 * 30, 2 * 30)
            position, velocity, angle = hull.position, hull.linearVelocity, hull.angle
            x, y = position
            fractions = [1.0] * NUM_RAYS
            for ray in self.rays:
                lidar = self.lidar[ray]
                lidar.fraction = 1.0
                across, down = reach[ray]
                world.RayCast(lidar, position, (x + across, y - down))
                fractions[ray] = lidar.fraction
            state = [
                angle,
                2.0 * hull.angularVelocity / original.FPS,
                0.3 * velocity.x * (original.VIEWPORT_W / original.SCALE) / original.FPS,
                0.3 * velocity.y * (original.VIEWPORT_H / original.SCALE) / original.FPS,
                hip0.angle,
                hip0.speed / original.SPEED_HIP,
                knee0.angle + 1.0,
                knee0.speed / original.SPEED_KNEE,
                1.0 if legs[1].ground_contact else 0.0,
                hip1.angle,
                hip1.speed / original.SPEED_HIP,
                knee1.angle + 1.0,
                knee1.speed / original.SPEED_KNEE,
                1.0 if legs[3].ground_contact else 0.0,
                *fractions,
            ]
            shaping = 130 * x / original.SCALE
            shaping -= 5.0 * abs(angle)
            if self.game_over or x < 0:
                reward, terminated = FALL_REWARD, True
            else:
                rounded = np.float32(shaping - self.prev_shaping)
                for cost in energy * effort:
                    rounded = rounded - cost
                reward, terminated = float(rounded), x > goal
            self.prev_shaping = shaping
            return np.array(state, dtype=np.float32), reward, terminated, False, {}

    return LeanWalker
