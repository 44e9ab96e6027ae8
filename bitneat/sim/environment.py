# SPDX-License-Identifier: MIT
"""Gymnasium environments, and episodes of a controller in them.

An episode always runs in a *fresh* environment. Box2D keeps its broad phase from one reset to the next, so that the same seed
gives other rewards after other episodes (35 of 40 seeds of BipedalWalker-v3 differ); without a fresh environment no result
could be independent of how episodes are spread over workers.
"""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, BoxAction, Controller, DiscreteAction, Input, Signal
from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, Policy
from bitneat.network import decode as decode_real
from bitneat.sim import bipedal

__all__ = [
    "EnvironmentInfo",
    "EnvironmentSpec",
    "EpisodeResult",
    "EpisodeRunner",
    "Shaping",
    "StepController",
    "allow_imports",
    "allowed_imports",
    "decode_table",
    "default_inputs",
    "inspect",
    "make",
    "one_limit",
    "reward_threshold",
    "used_inputs",
]

Int16Array = npt.NDArray[np.int16]


class UnfitEnvironmentError(BitneatError):
    """An environment is unknown, cannot be made, or has spaces that a controller cannot serve."""


class StepController(Protocol):
    """Anything that computes what a controller computes."""

    def reset(self) -> None:
        """Forget the past."""

    def step(self, inputs: Any) -> Any:
        """One control step: (num_inputs,) signals to (num_outputs,) signals; a float network's are floats."""


@dataclass(frozen=True)
class EnvironmentInfo:
    """What a controller needs to know of an environment: flat bounds of the observation, the action, the time limit."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    action: Action
    max_steps: int | None

    @property
    def num_inputs(self) -> int:
        """Components of the flattened observation."""
        return len(self.low)


@dataclass(frozen=True)
class Shaping:
    """How the search's reward differs from the official one. The defaults change nothing.

    A terminal step whose reward is exactly ``fall_reward`` is a fall and counts ``fall_value`` instead. Ending in any other
    way adds ``finish_bonus`` times the part of the time limit that was left. An episode stops after ``max_steps`` steps, or
    when for ``stall_steps`` steps the total has not risen by ``stall_gain``; a 0 turns either off.
    """

    fall_reward: float = math.nan
    fall_value: float = 0.0
    finish_bonus: float = 0.0
    max_steps: int = 0
    stall_steps: int = 0
    stall_gain: float = 0.0


@dataclass(frozen=True)
class EpisodeResult:
    """One episode: the official reward, the search's reward, and how it ended."""

    reward: float
    shaped: float
    steps: int
    terminated: bool
    stalled: bool


_allowed_imports: set[str] = set()


def allow_imports(modules: Iterable[str]) -> None:
    """Let environments import these modules, which the user has named: importing runs code.

    A specification comes from a file, perhaps a stranger's, so its own word that a module is needed is not enough.

    Raises:
        BitneatError: if one is no name of a module.
    """
    for module in modules:
        if not all(part.isidentifier() for part in module.split(".")):
            raise UnfitEnvironmentError(f"--import {module!r}: expected the name of a module")
        _allowed_imports.add(module)


def allowed_imports() -> tuple[str, ...]:
    """The modules allowed so far, for worker processes."""
    return tuple(sorted(_allowed_imports))


def make(spec: EnvironmentSpec) -> gymnasium.Env[Any, Any]:
    """A new environment, without Gymnasium's passive checker, which alters no result.

    Raises:
        BitneatError: if the id is unknown or would import a module, a module was not allowed, an argument is wrong, or a
            dependency is missing.
    """
    _import_modules(spec)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return gymnasium.make(spec.id, disable_env_checker=True, **spec.kwargs)
    except gymnasium.error.DependencyNotInstalled as error:
        raise UnfitEnvironmentError(f"environment {spec.id}: a dependency is missing: {_one_line(error)}") from None
    except (gymnasium.error.Error, ImportError, TypeError, ValueError, AssertionError) as error:
        raise UnfitEnvironmentError(f"environment {spec.id}: {_one_line(error)}") from None
    except (Exception, SystemExit) as error:  # the environment is foreign code
        raise UnfitEnvironmentError(f"environment {spec.id}: cannot be made: {_named(error)}") from None


def reward_threshold(spec: EnvironmentSpec) -> float | None:
    """The mean reward at which the environment counts as solved, by its registration; None if that says nothing."""
    registered = gymnasium.registry.get(spec.id)
    threshold = None if registered is None else registered.reward_threshold
    return None if threshold is None else float(threshold)


def _import_modules(spec: EnvironmentSpec) -> None:
    if ":" in spec.id:
        raise UnfitEnvironmentError(
            f"environment {spec.id}: an id with ':' imports a module; name the module with --import, and the id alone"
        )
    for module in spec.imports:
        if module not in _allowed_imports:
            raise UnfitEnvironmentError(
                f"environment {spec.id}: needs --import {module} (it imports a module, which can run any code;"
                " name it if you trust it)"
            )
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise UnfitEnvironmentError(f"--import {module}: {_one_line(error)}") from None
        except (Exception, SystemExit) as error:  # the module is foreign code
            raise UnfitEnvironmentError(f"--import {module}: {_named(error)}") from None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _named(error: BaseException) -> str:
    return ": ".join(filter(None, (type(error).__name__, " ".join(str(error).split()))))


def inspect(spec: EnvironmentSpec) -> EnvironmentInfo:
    """Make the environment once and read its spaces; a Box of several axes counts as one of its components in a row.

    Raises:
        BitneatError: if the observation is not a Box of numbers or is an image (bytes in several axes), or the action is
            neither a bounded Box nor a Discrete.
    """
    environment = make(spec)
    try:
        low, high = _observation_bounds(spec, environment.observation_space)
        action = _action(spec, environment.action_space)
        limit = environment.spec.max_episode_steps if environment.spec is not None else None
        environment.close()
        return EnvironmentInfo(low, high, action, limit)
    except BitneatError:
        raise
    except (Exception, SystemExit) as error:  # the environment is foreign code
        raise UnfitEnvironmentError(f"environment {spec.id}: cannot be inspected: {_named(error)}") from None


def _observation_bounds(spec: EnvironmentSpec, space: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    where = f"environment {spec.id}: its observation is"
    if not isinstance(space, gymnasium.spaces.Box):
        raise UnfitEnvironmentError(f"{where} a {type(space).__name__} space, expected a Box")
    if space.dtype is not None and space.dtype == np.uint8 and len(space.shape) > 1:
        raise UnfitEnvironmentError(f"{where} an image of shape {space.shape}, expected a Box of numbers")
    if space.dtype is None or space.dtype.kind not in "fiub":
        raise UnfitEnvironmentError(f"{where} a Box of {space.dtype}, expected numbers")
    if math.prod(space.shape) < 1:
        raise UnfitEnvironmentError(f"{where} an empty Box")
    return (
        tuple(float(v) for v in space.low.reshape(-1)),
        tuple(float(v) for v in space.high.reshape(-1)),
    )


def _action(spec: EnvironmentSpec, space: Any) -> Action:
    where = f"environment {spec.id}: its action is"
    if isinstance(space, gymnasium.spaces.Discrete):
        if not -(2**31) < space.start < 2**31 - space.n:
            raise UnfitEnvironmentError(f"{where} a Discrete space whose start {space.start} does not fit 32 bits")
        return DiscreteAction(int(space.n), int(space.start))
    if not isinstance(space, gymnasium.spaces.Box):
        raise UnfitEnvironmentError(f"{where} a {type(space).__name__} space, expected a bounded Box or Discrete")
    if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        raise UnfitEnvironmentError(f"{where} an unbounded Box, expected finite bounds")
    return BoxAction(
        tuple(float(v) for v in space.low.reshape(-1)),
        tuple(float(v) for v in space.high.reshape(-1)),
        tuple(int(n) for n in space.shape),
        np.dtype(space.dtype).name,
    )


def default_inputs(info: EnvironmentInfo, frac_bits: int, scales: tuple[int, ...] | None = None) -> tuple[Input, ...]:
    """Scales and limits from the declared bounds of the observation.

    Without given ``scales``, an input whose bound is below one half is scaled up to between a half and one, and one whose bound
    exceeds the range of a signal is scaled down to fit. An input with an infinite bound keeps the limit 32767.
    """
    inputs = []
    for index, (low, high) in enumerate(zip(info.low, info.high, strict=True)):
        bound = max(abs(low), abs(high))
        scale = _scale_for(bound, frac_bits) if scales is None else scales[index]
        limit = 32767
        if math.isfinite(bound):
            limit = int(min(max(math.ceil(math.ldexp(bound, frac_bits + scale)), 1), 32767))
        inputs.append(Input(scale, limit))
    return tuple(inputs)


def one_limit(inputs: Iterable[Input]) -> tuple[Input, ...]:
    """The inputs with one limit for all, of the form 2^k - 1 and at least the largest of theirs: it packs into a few bits."""
    inputs = tuple(inputs)
    limit = (1 << max(entry.limit for entry in inputs).bit_length()) - 1
    return tuple(Input(entry.scale, limit) for entry in inputs)


def _scale_for(bound: float, frac_bits: int) -> int:
    # Bounds near the largest float stand for "any number": they say nothing of the values to expect.
    if not 0.0 < bound < 1e30:
        return 0
    exponent = math.ceil(math.log2(bound))  # bound <= 2^exponent
    if exponent < 0:
        return min(-exponent, 15)
    return max(min(0, 15 - frac_bits - exponent), -16)


class EpisodeRunner:
    """Runs episodes of one controller; the codecs' tables are built once.

    Args:
        spec: the environment.
        controller: whose encoder and decoder to use; or a float network, which sees observations as they are.
        action: the action space.
        policy: computes the controller's steps; its outputs are those of ``controller``.
        simulator: "gymnasium", or "auto" to take a faster equal of the environment where there is one.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        controller: Policy,
        action: Action,
        policy: StepController,
        simulator: str = "gymnasium",
    ) -> None:
        self._spec = spec
        self._lean = None
        if simulator == "auto" and bipedal.serves(spec):
            self._lean = bipedal.make(spec, used_inputs(controller))
        self._policy = policy
        if isinstance(controller, FloatNetwork):
            self._act = _real_actor(action, policy)
        else:
            self._act = _actor(controller, action, policy)

    def __call__(self, seed: int, max_steps: int, shaping: Shaping | None = None) -> EpisodeResult:
        """One episode in a fresh environment; stops at the environment's end or after ``max_steps`` steps.

        ``max_steps`` must not exceed the environment's own time limit, which its faster equals do not know.

        Raises:
            BitneatError: if an observation holds a NaN or the rewards do not add up to a finite number.
        """
        environment = make(self._spec) if self._lean is None else self._lean
        try:
            with np.errstate(over="ignore"):
                return self._run(environment, seed, max_steps, shaping or Shaping())
        finally:
            environment.close()

    def _run(self, environment: gymnasium.Env[Any, Any], seed: int, max_steps: int, shaping: Shaping) -> EpisodeResult:
        environment_step, act = environment.step, self._act
        max_steps = min(max_steps, shaping.max_steps or max_steps)
        stall_steps = shaping.stall_steps or max_steps
        total = best = last = 0.0
        best_step = steps = 0
        terminated = truncated = stalled = False
        self._policy.reset()
        observation, _ = environment.reset(seed=seed)
        flat = np.ndim(observation) != 1
        while not (terminated or truncated) and steps < max_steps:
            if flat:
                observation = np.reshape(observation, -1)
            action = act(observation)
            if action is None:
                raise UnfitEnvironmentError(
                    f"environment {self._spec.id}: observation {steps} of seed {seed} holds a NaN"
                )
            observation, reward, terminated, truncated, _ = environment_step(action)
            last = float(reward)
            total += last
            steps += 1
            if total > best + shaping.stall_gain:
                best, best_step = total, steps
            elif steps - best_step >= stall_steps:
                stalled = True
                break
        if not math.isfinite(total):  # once it is not, no further reward can mend it
            raise UnfitEnvironmentError(
                f"environment {self._spec.id}: a reward of seed {seed} is {last}, or their sum too large"
            )
        shaped = total
        if terminated and last == shaping.fall_reward:
            shaped += shaping.fall_value - last
        elif terminated:
            shaped += shaping.finish_bonus * (1.0 - steps / max_steps)
        return EpisodeResult(total, shaped, steps, bool(terminated), stalled)


def _actor(controller: Controller, action: Action, policy: StepController) -> Any:
    """From an observation to the action; None if the observation holds a NaN."""
    factor = np.array([2.0 ** (controller.frac_bits + i.scale) for i in controller.inputs])
    limit = np.array([float(i.limit) for i in controller.inputs])
    negative_limit = -limit
    encoded = np.empty(factor.shape)
    signals = np.empty(factor.shape, dtype=np.int16)
    decode, step = _decoder(action, controller.frac_bits), policy.step

    def act(observation: Any) -> Any:
        # The encoder of docs/semantics.md without its temporaries; tests hold the two together.
        np.multiply(observation, factor, out=encoded)
        np.rint(encoded, out=encoded)
        np.minimum(encoded, limit, out=encoded)
        np.maximum(encoded, negative_limit, out=encoded)
        if math.isnan(encoded.dot(encoded)):
            return None
        signals[:] = encoded
        return decode(step(signals))

    return act


def _real_actor(action: Action, policy: StepController) -> Any:
    """As `_actor`, for a float network."""

    def act(observation: Any) -> Any:
        values = np.asarray(observation, np.float64).tolist()
        if any(math.isnan(value) for value in values):
            return None
        return decode_real(action, policy.step(values))

    return act


def used_inputs(controller: Policy) -> list[int]:
    """The inputs that the controller or network reads."""
    if isinstance(controller, FloatNetwork):
        return controller.used_inputs()
    sources = {link.source for node in controller.nodes for link in node.links}
    sources |= {output.index for output in controller.outputs if isinstance(output, Signal)}
    return sorted(source for source in sources if source < len(controller.inputs))


def _decoder(action: Action, frac_bits: int) -> Any:
    """`Action.decode` as a table: outputs beyond ±One decode as ±One does, so 2^(F+1)+1 rows hold every action."""
    if isinstance(action, DiscreteAction):
        start = action.start
        return lambda outputs: start + int(np.argmax(outputs))
    one, count = 1 << frac_bits, action.num_outputs
    table = decode_table(action, frac_bits)
    middle = np.arange(count, dtype=np.intp) * (2 * one + 1) + one
    shape = None if action.shape == (count,) else action.shape

    def decode(outputs: Int16Array) -> npt.NDArray[Any]:
        picked: npt.NDArray[Any] = table[np.minimum(np.maximum(outputs, -one), one) + middle]
        return picked if shape is None else picked.reshape(shape)

    return decode


@lru_cache(maxsize=4)
def decode_table(action: BoxAction, frac_bits: int) -> npt.NDArray[Any]:
    """The components of the action for every output -One..One, one component after the other."""
    one = 1 << frac_bits
    rows = [
        action.decode(np.full(action.num_outputs, y, dtype=np.int16), frac_bits).reshape(-1)
        for y in range(-one, one + 1)
    ]
    return np.ascontiguousarray(np.stack(rows).T).reshape(-1)
