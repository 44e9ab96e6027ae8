# SPDX-License-Identifier: MIT
"""Episodes as the page replays them: what the controller read and answered at each step, and where the walker's bodies were.

They are run in Gymnasium under the reference evaluator. Everything is kept as it was *when the observation was taken*: row k has
the inputs of step k, the outputs that they gave, and the bodies before the simulator moved on.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, Controller, Encoder, Reference
from bitneat.errors import BitneatError
from bitneat.sim import bipedal
from bitneat.sim.environment import make

LENGTH_STEPS = 320
"""Positions are kept in 1/320 m: a tenth of a pixel where the page draws a metre as 30, and 102 m fit an int16."""
ANGLE_STEPS = 4096
"""Angles are kept in 1/4096 rad; they fit for one turn, and a hull that has turned further lies on the ground."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """What stands still, or keeps its shape, in a walker's episode; in metres.

    ``shapes`` are the polygons of the bodies about their own origins, in the order of the poses: the hull, then for each leg its
    upper and lower part. ``ground`` is the line of the terrain, ``obstacles`` the polygons on it.
    """

    shapes: tuple[tuple[Point, ...], ...]
    ground: tuple[Point, ...]
    obstacles: tuple[tuple[Point, ...], ...]


@dataclass(frozen=True)
class RecordedEpisode:
    """One episode; the arrays have a row a step.

    ``rewards`` are running totals. ``poses`` are (steps, bodies * 3): x, y in 1/`LENGTH_STEPS` m and the angle in
    1/`ANGLE_STEPS` rad; None where there are no bodies to draw.
    """

    seed: int
    inputs: npt.NDArray[np.int16]
    outputs: npt.NDArray[np.int16]
    rewards: npt.NDArray[np.float32]
    reward: float
    scene: Scene | None = None
    poses: npt.NDArray[np.int16] | None = None

    @property
    def steps(self) -> int:
        """How many steps it took."""
        return len(self.inputs)

    def to_data(self) -> dict[str, Any]:
        """As the page reads it: arrays in base64, little-endian."""
        data: dict[str, Any] = {
            "seed": self.seed,
            "steps": self.steps,
            "reward": self.reward,
            "inputs": encoded(self.inputs, "<i2"),
            "outputs": encoded(self.outputs, "<i2"),
            "rewards": encoded(self.rewards, "<f4"),
        }
        if self.scene is not None and self.poses is not None:
            data |= {
                "poses": encoded(self.poses, "<i2"),
                "shapes": _rounded(self.scene.shapes),
                "ground": _rounded([self.scene.ground])[0],
                "obstacles": _rounded(self.scene.obstacles),
            }
        return data


def encoded(array: npt.NDArray[Any], dtype: str) -> str:
    """The values of an array in base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=dtype).tobytes()).decode("ascii")


def _rounded(polygons: Sequence[Sequence[Point]]) -> list[list[list[float]]]:
    return [[[round(x, 4), round(y, 4)] for x, y in polygon] for polygon in polygons]


def record(
    controller: Controller,
    action: Action,
    spec: EnvironmentSpec,
    seeds: Sequence[int],
    *,
    max_steps: int | None = None,
    progress: Callable[[RecordedEpisode], None] | None = None,
) -> list[RecordedEpisode]:
    """Run episodes, each in an environment of its own.

    Args:
        controller: the reference computes it.
        action: how its outputs become actions.
        spec: the environment.
        seeds: one for each episode.
        max_steps: cut episodes short; None leaves that to the environment.
        progress: told of each episode.

    Raises:
        BitneatError: if the environment cannot be made, or an observation holds a NaN.
    """
    recorder = _Recorder(controller, action, spec, max_steps)
    episodes = []
    for seed in seeds:
        environment = make(spec)
        try:
            episodes.append(recorder.run(environment, seed))
        finally:
            environment.close()
        if progress is not None:
            progress(episodes[-1])
    return episodes


@dataclass(frozen=True, slots=True)
class _Recorder:
    controller: Controller
    action: Action
    spec: EnvironmentSpec
    max_steps: int | None

    def run(self, environment: Any, seed: int) -> RecordedEpisode:
        controller, spec = self.controller, self.spec
        encode, reference = Encoder(controller), Reference(controller)
        observation, _ = environment.reset(seed=seed)
        world = environment.unwrapped if bipedal.is_walker(spec) and _has_bodies(environment.unwrapped) else None
        inputs, outputs, rewards, poses = [], [], [], []
        total, over = 0.0, False
        while not over:
            signals = encode(np.reshape(observation, -1))
            answer = np.array(reference.step(signals.tolist()), dtype=np.int16)
            inputs.append(signals)
            outputs.append(answer)
            if world is not None:
                poses.append(_pose(world))
            observation, reward, terminated, truncated, _ = environment.step(
                self.action.decode(answer, controller.frac_bits)
            )
            total += float(reward)
            rewards.append(total)
            over = bool(terminated or truncated) or len(inputs) == self.max_steps
        if not np.isfinite(total):
            raise BitneatError(f"environment {spec.id}: the rewards of seed {seed} do not add up to a finite number")
        return RecordedEpisode(
            seed=seed,
            inputs=np.stack(inputs),
            outputs=np.stack(outputs),
            rewards=np.array(rewards, dtype=np.float32),
            reward=total,
            scene=None if world is None else _scene(world),
            poses=None if world is None else np.stack(poses),
        )


def _has_bodies(world: Any) -> bool:
    return all(hasattr(world, name) for name in ("hull", "legs", "terrain"))


def _bodies(world: Any) -> list[Any]:
    return [world.hull, *world.legs]


def _pose(world: Any) -> npt.NDArray[np.int16]:
    values = [
        number
        for body in _bodies(world)
        for number in (body.position[0] * LENGTH_STEPS, body.position[1] * LENGTH_STEPS, body.angle * ANGLE_STEPS)
    ]
    return np.clip(np.rint(values), -32767, 32767).astype(np.int16)


def _scene(world: Any) -> Scene:
    shapes = tuple(tuple(body.fixtures[0].shape.vertices) for body in _bodies(world))
    ground: list[Point] = []
    obstacles = []
    for body in world.terrain:
        vertices = [tuple(body.transform * vertex) for vertex in body.fixtures[0].shape.vertices]
        if len(vertices) == 2:
            ground += vertices
        else:
            obstacles.append(tuple(vertices))
    line = tuple(dict.fromkeys((round(x, 4), round(y, 4)) for x, y in sorted(ground)))
    return Scene(shapes, line, tuple(obstacles))
