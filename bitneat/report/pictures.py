# SPDX-License-Identifier: MIT
"""Pictures of an episode, by Gymnasium's own renderer."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, Encoder
from bitneat.errors import BitneatError, MissingExtraError
from bitneat.network import FloatNetwork, Policy, decode
from bitneat.sim.environment import make

Image = npt.NDArray[np.uint8]
"""Of shape (height, width, 3)."""
_DEFAULT_FPS = 30
"""Of an environment that does not say how many steps it has in a second."""


@dataclass(frozen=True)
class Moment:
    """A step of an episode, 0 being the one after reset."""

    step: int
    reward: float
    """The official reward so far."""
    over: bool
    """True of the last one."""
    image: Image | None
    """None of a step that no picture was wanted of."""


@dataclass(frozen=True)
class Episode:
    """Which episode."""

    spec: EnvironmentSpec
    policy: Policy
    action: Action
    seed: int
    max_steps: int | None = None
    """None to go on to the environment's own end."""


def steps_per_second(spec: EnvironmentSpec) -> int:
    """As the environment says.

    Raises:
        BitneatError: if it cannot be made, draws no pictures, or never ends by itself.
    """
    environment = make(spec)
    try:
        if "rgb_array" not in environment.metadata.get("render_modes", ()):
            raise BitneatError(f"environment {spec.id}: draws no pictures: it lacks the render mode rgb_array")
        return int(environment.metadata.get("render_fps") or _DEFAULT_FPS)
    finally:
        environment.close()


def moments(episode: Episode, is_wanted: Callable[[int], bool]) -> Iterator[Moment]:
    """Every step of an episode in turn, with a picture of those that are wanted and of the last.

    Raises:
        BitneatError: if the environment cannot be made or drawn, or an observation holds a NaN.
    """
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # it draws into memory, on machines without a screen too
    spec = episode.spec
    kwargs = {**spec.kwargs, "render_mode": "rgb_array"}
    environment = make(EnvironmentSpec(spec.id, kwargs, spec.imports))
    act = _actor(episode.policy, episode.action)
    try:
        observation, _ = environment.reset(seed=episode.seed)
        step, total, over = 0, 0.0, False
        while True:
            image = _picture(environment, spec) if over or is_wanted(step) else None
            yield Moment(step, total, over, image)
            if over:
                return
            observation, reward, terminated, truncated, _ = environment.step(act(np.reshape(observation, -1)))
            step, total = step + 1, total + float(reward)
            over = bool(terminated or truncated) or step == episode.max_steps
    finally:
        environment.close()


def spread(episode: Episode, count: int) -> list[Moment]:
    """``count`` moments with pictures, evenly spaced from the first step to the last; fewer of an episode with fewer steps."""
    length = sum(1 for _ in moments(episode, lambda step: False))
    wanted = {round(i * (length - 1) / max(count - 1, 1)) for i in range(count)}
    return [moment for moment in moments(episode, wanted.__contains__) if moment.step in wanted]


def _picture(environment: gymnasium.Env[Any, Any], spec: EnvironmentSpec) -> Image:
    try:
        image = np.asarray(environment.render())
    except gymnasium.error.DependencyNotInstalled:
        raise MissingExtraError("render: pygame is not installed; pip install 'bitneat[render]'") from None
    except Exception as error:  # the environment is foreign code
        raise BitneatError(f"environment {spec.id}: cannot be drawn: {type(error).__name__}: {error}") from None
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise BitneatError(
            f"environment {spec.id}: its picture is {image.dtype} of shape {image.shape}, expected RGB bytes"
        )
    return image


def _actor(policy: Policy, action: Action) -> Callable[[Any], Any]:
    if isinstance(policy, FloatNetwork):
        return lambda observation: decode(action, policy.step(observation.tolist()))
    from bitneat.runtime import RuntimeController

    encoder, running = Encoder(policy), RuntimeController(policy)
    running.reset()
    return lambda observation: action.decode(running.step(encoder(observation)), policy.frac_bits)
