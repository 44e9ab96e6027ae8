# SPDX-License-Identifier: MIT
"""Many walkers as one Gymnasium vector environment, for any library that trains on those."""

from __future__ import annotations

import copy
import math
import operator
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from bitneat.errors import BitneatError
from bitneat.sim.walker.binding import (
    LANE_WIDTHS,
    MAX_THREADS,
    default_threads,
    ffi,
    lane_width,
    library,
    random_state,
    whole_number,
)

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int32]

NUM_OBSERVATIONS, NUM_ACTIONS = 24, 4
STEP_LIMIT = 1600
HARDCORE_STEP_LIMIT = 2000
"""BipedalWalker-v3's, and BipedalWalkerHardcore-v3's."""
ALIGNMENT = 64
"""Of the environments' memory, in bytes: a cache line."""

# The angles, speeds and contacts of both legs, after the hull's angle and three speeds; then the lidar.
_LEG = [math.pi, 5.0, math.pi, 5.0, 5.0]
_LEG_LOW = [-math.pi, -5.0, -math.pi, -5.0, -0.0]
_HIGH = [math.pi, 5.0, 5.0, 5.0, *_LEG, *_LEG, *[1.0] * 10]
_LOW = [-math.pi, -5.0, -5.0, -5.0, *_LEG_LOW, *_LEG_LOW, *[-1.0] * 10]


def step_limit(hardcore: bool) -> int:
    """The time limit of an episode, in steps, as Gymnasium has registered it."""
    return HARDCORE_STEP_LIMIT if hardcore else STEP_LIMIT


class WalkerVectorEnv(VectorEnv[Floats, Floats, npt.NDArray[Any]]):
    """BipedalWalker-v3, ``num_envs`` times, stepped together by the native simulator.

    What it returns is, to the bit, what `gymnasium.vector.SyncVectorEnv` of ``gymnasium.make("BipedalWalker-v3")`` returns for the
    same seeds and float32 actions, with one difference, which is meant: here every episode starts in a fresh Box2D world.
    Gymnasium's own object keeps the state of Box2D's broad phase when it is reset, so that from its second episode on it may
    differ from a new object with the same random numbers; a new one never differs from this class.

    ``gymnasium.make_vec(envs.spec, num_envs=…)`` makes another one like ``envs``; nothing is registered.
    """

    def __init__(
        self,
        num_envs: int,
        hardcore: bool = False,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        lanes: int | None = None,
        threads: int | None = None,
    ) -> None:
        """Make the environments; `reset` must come before the first `step`.

        Args:
            num_envs: how many.
            hardcore: with ladders, stumps and pitfalls.
            max_episode_steps: after how many steps an episode is truncated. If not given 1600, as of BipedalWalker-v3 with and
                without ``hardcore``; Gymnasium's BipedalWalkerHardcore-v3 is ``hardcore=True, max_episode_steps=2000``.
            autoreset_mode: what happens after an episode's end, as in `gymnasium.vector.SyncVectorEnv`. NEXT_STEP: the next step
                ignores the environment's action, and is its reset. SAME_STEP: it is reset at once, and the last observation is
                in ``infos["final_obs"]``. DISABLED: call ``reset(options={"reset_mask": …})`` before the next step.
            lanes: walkers side by side in a thread, 1, 4, 8 or 16; if not given, no more than the machine has instructions for
                and no more than there are walkers. It changes no bit, nor do ``threads``.
            threads: one a core if not given.

        Raises:
            BitneatError: if an argument is out of range, or there is no C compiler.
        """
        self.num_envs = whole_number("num_envs", num_envs)
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise BitneatError(f"autoreset_mode: expected one of {modes}, got {autoreset_mode!r}") from None
        self.metadata = {"render_modes": [], "render_fps": 50, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = Box(np.array(_LOW, np.float32), np.array(_HIGH, np.float32))
        self.single_action_space = Box(np.float32(-1.0), np.float32(1.0), (NUM_ACTIONS,))
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.spec = copy.deepcopy(gymnasium.spec("BipedalWalker-v3"))
        self.spec.vector_entry_point = f"{type(self).__module__}:{type(self).__name__}"
        if hardcore:
            self.spec.kwargs["hardcore"] = True
        self._limit = STEP_LIMIT if max_episode_steps is None else whole_number("max_episode_steps", max_episode_steps)
        self.spec.max_episode_steps = self._limit
        self._threads = default_threads() if threads is None else whole_number("threads", threads, MAX_THREADS)
        self._lanes = lane_width(lanes)
        if lanes is None:
            self._lanes = min(self._lanes, next((w for w in LANE_WIDTHS if w >= self.num_envs), self._lanes))

        size = library().simulator_environment_size() * self.num_envs
        self._memory: npt.NDArray[np.uint8] | None = np.zeros(size + ALIGNMENT, np.uint8)
        start = -self._memory.ctypes.data % ALIGNMENT
        self._environments = ffi().from_buffer(self._memory[start : start + size])
        self._every = np.arange(self.num_envs, dtype=np.int32)
        self._observations = np.zeros((self.num_envs, NUM_OBSERVATIONS), np.float32)
        self._elapsed = np.zeros(self.num_envs, np.int32)
        self._started = np.zeros(self.num_envs, np.bool_)
        self._ended = np.zeros(self.num_envs, np.bool_)
        self._hardcore = [bool(hardcore)] * self.num_envs
        self._seeds = [0] * self.num_envs
        for index in range(self.num_envs):
            self._seed(index, None)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Floats, dict[str, Any]]:
        """Start an episode in every environment, or in those that ``options["reset_mask"]`` names.

        Args:
            seed: one for each environment; of a single number ``s``, environment ``i`` takes ``s + i``. An environment whose seed
                is None goes on with its own random numbers, which nobody can foresee if it never had a seed.
            options: ``reset_mask`` may be an array of bools, one for each environment. All else is ignored, as Gymnasium's
                BipedalWalker does.

        Returns:
            The observations of all environments, the latest of those that were not reset, and no infos.

        Raises:
            BitneatError: if a seed or the mask is not as described, or the environments are closed.
        """
        self._check_open()
        seeds = _seeds(seed, self.num_envs)
        which = self._every
        if options is not None and "reset_mask" in options:
            which = _chosen(options["reset_mask"], self.num_envs)
        for index in which.tolist():
            if seeds[index] is not None:
                self._seed(index, seeds[index])
        self._start(which)
        return self._observations.copy(), {}

    def step(self, actions: npt.ArrayLike) -> tuple[Floats, Doubles, Bools, Bools, dict[str, Any]]:
        """Take a step in every environment.

        Args:
            actions: four numbers for each environment, taken as float32. Those beyond -1 and 1, infinities too, count as these.

        Returns:
            The observations, rewards, terminations and truncations, in arrays of the caller's own, and the infos.

        Raises:
            BitneatError: if the actions are of another shape or an environment would take a NaN, or if an environment was not
                reset, or not since its episode's end if ``autoreset_mode`` is DISABLED. Then no environment has moved.
        """
        self._check_open()
        table = _action_table(actions, self.num_envs)
        if not self._started.all():
            raise BitneatError(f"step: reset environment {int(self._started.argmin())} first")
        restarting = self._ended
        if self.autoreset_mode is AutoresetMode.DISABLED and restarting.any():
            raise BitneatError(f"step: the episode of environment {int(restarting.argmax())} has ended; reset it first")
        which = self._every
        if restarting.any():
            which = np.flatnonzero(~restarting).astype(np.int32)
            table = table[which]
        bad = np.isnan(table).any(axis=1)
        if bad.any():
            raise BitneatError(f"actions: expected numbers, got a NaN for environment {which[bad.argmax()]}")

        rewards = np.zeros(self.num_envs, np.float64)
        terminated = np.zeros(self.num_envs, np.bool_)
        truncated = np.zeros(self.num_envs, np.bool_)
        if len(which) > 0:
            rewards[which], terminated[which] = self.advance(which, table)
            truncated[which] = self._elapsed[which] >= self._limit
        if len(which) < self.num_envs:
            self._start(np.flatnonzero(restarting).astype(np.int32))
        self._ended = terminated | truncated
        infos: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            ended = np.flatnonzero(self._ended).astype(np.int32)
            final = np.full(self.num_envs, None, dtype=object)
            for index in ended.tolist():
                final[index] = self._observations[index].copy()
            infos = {"final_obs": final, "_final_obs": self._ended.copy()}
            infos |= {"final_info": {}, "_final_info": self._ended.copy()}
            self._start(ended)
        return self._observations.copy(), rewards, terminated, truncated, infos

    def observed(self, which: Indices) -> Floats:
        """The latest observations of some environments, (which, 24)."""
        return self._observations[which]

    def advance(self, which: Indices, actions: Floats) -> tuple[Doubles, Bools]:
        """Take a step in some environments only, whose episodes must not have ended; no reset, no time limit, no check.

        Args:
            which: their indices, ascending, of shape (n,).
            actions: contiguous, of shape (n, 4), without NaN.

        Returns:
            Rewards and terminations, both (n,); see `observed` for the observations.

        Raises:
            BitneatError: if a body touches more shapes than there is room for.
        """
        count = len(which)
        observations = np.empty((count, NUM_OBSERVATIONS), np.float32)
        rewards = np.empty(count, np.float64)
        terminated = np.empty(count, np.uint8)
        done = library().simulator_step(
            self._environments,
            ffi().from_buffer("int32_t[]", which),
            count,
            ffi().from_buffer("float[]", actions),
            ffi().from_buffer("float[]", observations),
            ffi().from_buffer("double[]", rewards),
            ffi().from_buffer("uint8_t[]", terminated),
            self._lanes,
            self._threads,
        )
        if not done:
            self._started[:] = False
            raise BitneatError(
                "native walker: a body touches more shapes than there is room for, or memory ran out;"
                " reset all environments"
            )
        self._observations[which] = observations
        self._elapsed[which] += 1
        return rewards, terminated.astype(np.bool_)

    @property  # type: ignore[misc]  # Gymnasium's can be set
    def np_random(self) -> Any:
        """Each environment's random numbers, as generators of their own: to draw from them changes no environment."""
        return self.get_attr("np_random")

    @property
    def np_random_seed(self) -> Any:
        """The seed that each environment's random numbers started from."""
        return self.get_attr("np_random_seed")

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each environment.

        Raises:
            BitneatError: if they have none of this name.
        """
        if name == "hardcore":
            return tuple(self._hardcore)
        if name == "np_random_seed":
            return tuple(self._seeds)
        if name == "np_random":
            self._check_open()
            return tuple(_generator(self._random_state(index)) for index in range(self.num_envs))
        shared = {
            "action_space": self.single_action_space,
            "observation_space": self.single_observation_space,
            "render_mode": self.render_mode,
            "spec": self.spec,
        }
        if name not in shared:
            known = ", ".join(sorted([*shared, "hardcore", "np_random", "np_random_seed"]))
            raise BitneatError(f"walkers have no attribute {name!r}; known: {known}")
        return (shared[name],) * self.num_envs

    def set_attr(self, name: str, values: Any) -> None:
        """Set ``hardcore`` of each environment, to one value or to a list of one each; it counts from its next reset.

        Raises:
            BitneatError: for another name, or a list of another length.
        """
        self._check_open()
        if name != "hardcore":
            raise BitneatError(f"of walkers nothing but 'hardcore' can be set, got {name!r}")
        each = values if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise BitneatError(f"{name}: expected {self.num_envs} values, got {len(each)}")
        self._hardcore = [bool(value) for value in each]
        for index, value in enumerate(self._hardcore):
            library().simulator_seed(self._environments, index, self._random_state(index), value)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """As `get_attr`, since walkers have no methods to call.

        Raises:
            BitneatError: if they have no attribute of this name, or there are arguments.
        """
        if args or kwargs:
            raise BitneatError(f"walkers have no method {name!r}")
        return self.get_attr(name)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the environments' memory."""
        self._environments = None
        self._memory = None

    def _check_open(self) -> None:
        if self.closed:
            raise BitneatError("the walkers are closed")

    def _seed(self, index: int, seed: int | None) -> None:
        generator, self._seeds[index] = seeding.np_random(seed)
        library().simulator_seed(self._environments, index, random_state(generator), self._hardcore[index])

    def _random_state(self, index: int) -> Any:
        state = ffi().new("struct pcg64 *")
        library().simulator_random_state(self._environments, index, state)
        return state

    def _start(self, which: Indices) -> None:
        observations = np.empty((len(which), NUM_OBSERVATIONS), np.float32)
        done = library().simulator_reset(
            self._environments,
            ffi().from_buffer("int32_t[]", which),
            len(which),
            ffi().from_buffer("float[]", observations),
            self._lanes,
            self._threads,
        )
        if not done:
            self._started[:] = False
            raise BitneatError("native walker: out of memory; reset all environments")
        self._observations[which] = observations
        self._elapsed[which] = 0
        self._started[which] = True
        self._ended[which] = False


def _seeds(seed: Any, num_envs: int) -> list[int | None]:
    """A seed for each environment."""
    if seed is None:
        return [None] * num_envs
    try:
        first = operator.index(seed)
    except TypeError:
        pass
    else:
        seed = [first + index for index in range(num_envs)]
    try:
        seeds = [None if entry is None else operator.index(entry) for entry in seed]
    except TypeError:
        raise BitneatError(f"seed: expected a number, None, or a list of these, got {seed!r}") from None
    if len(seeds) != num_envs:
        raise BitneatError(f"seed: expected {num_envs}, one for each environment, got {len(seeds)}")
    for index, entry in enumerate(seeds):
        if entry is not None and entry < 0:
            raise BitneatError(f"seed of environment {index}: expected a number of at least 0, got {entry}")
    return seeds


def _chosen(mask: Any, num_envs: int) -> Indices:
    """The environments that a reset mask names."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (num_envs,):
        got = f"an array of {mask.dtype} of shape {mask.shape}" if isinstance(mask, np.ndarray) else repr(mask)
        raise BitneatError(f"reset_mask: expected a NumPy array of bool of shape ({num_envs},), got {got}")
    if not mask.any():
        raise BitneatError("reset_mask: expected at least one environment to reset, got none")
    return np.flatnonzero(mask).astype(np.int32)


def _action_table(actions: Any, num_envs: int) -> Floats:
    """The actions as C takes them."""
    try:
        table = np.asarray(actions)
    except (TypeError, ValueError, RuntimeError):
        table = np.empty((), object)
    if table.shape == (num_envs, NUM_ACTIONS) and table.dtype.kind in "biuf":
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes an infinity, which is clipped
            return np.ascontiguousarray(table, np.float32)
    try:
        rows = list(actions)
    except TypeError:
        rows = []
    for index, row in enumerate(rows[:num_envs]):
        try:
            values = np.asarray(row)
        except (TypeError, ValueError, RuntimeError):
            values = np.empty((), object)
        if values.shape != (NUM_ACTIONS,) or values.dtype.kind not in "biuf":
            raise BitneatError(
                f"actions: expected {NUM_ACTIONS} numbers for environment {index}, got {_described(values)}"
            )
    if len(rows) < num_envs:
        raise BitneatError(
            f"actions: expected {num_envs} of {NUM_ACTIONS} numbers, got none for environment {len(rows)}"
        )
    raise BitneatError(f"actions: expected {num_envs}, got one for environment {num_envs}, which there is not")


def _described(values: npt.NDArray[Any]) -> str:
    return f"{values.dtype} of shape {values.shape}"


def _generator(state: Any) -> np.random.Generator:
    """A NumPy generator with the state of a ``struct pcg64``."""
    bits = np.random.PCG64()
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": _joined(state.state), "inc": _joined(state.increment)},
        "has_uint32": state.has_uint32,
        "uinteger": state.uinteger,
    }
    return np.random.Generator(bits)


def _joined(words: Any) -> int:
    return int(words[0]) << 64 | int(words[1])
