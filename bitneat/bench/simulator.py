# SPDX-License-Identifier: MIT
"""The native walker against Gymnasium and, where it is installed, EnvPool: one controller that walks, and what a step costs."""

from __future__ import annotations

import importlib
import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bitneat.bench.measurement import Measurement
from bitneat.bench.walking import SEEDS, BatchPolicy, fifty_links
from bitneat.champion import EnvironmentSpec
from bitneat.controller import Controller
from bitneat.evolve.pool import WorkerPool
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import EpisodeRunner, make
from bitneat.sim.walker.binding import LANE_WIDTHS, lane_width
from bitneat.sim.walker.episodes import ACTION, run_episodes
from bitneat.sim.walker.vector import WalkerVectorEnv

Goal: TypeAlias = tuple[int, int]
"""What to aim at, and what there must be at the very least."""

STEPS_GOALS: Mapping[int, Goal] = {16: (100_000, 60_000), 8: (35_000, 35_000)}
"""Steps a second on one core, by lanes."""
GYMNASIUM_GOAL: Goal = (20, 12)
ENVPOOL_GOAL: Goal = (8, 8)
"""Times as fast, with 16 lanes."""

EPISODE_STEPS = 1600
"""Of every episode; all else that a turn does is in proportion. A turn takes about half a second to a second."""

_SPEC = EnvironmentSpec("BipedalWalker-v3")
_EPISODES_A_LANE = 3
_SCALAR_EPISODES = 4
_RECORDED_EPISODES = 3
_ENVPOOL_WALKERS = 16
"""A thread: where EnvPool was fastest, of 4 to 256."""
_ENVPOOL_STEPS = 0.4  # of an episode's, in a turn
_VECTOR_WALKERS = 1024
_VECTOR_STEPS = 0.04
_INSTRUCTIONS = {16: "AVX-512", 8: "AVX2", 4: "128-bit vectors", 1: "scalar"}

Recording: TypeAlias = tuple[int, npt.NDArray[np.float32]]
"""A seed, and the action of each step of its episode."""

Side: TypeAlias = Callable[[], float]
"""Does its work once and returns its steps a second."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The steps a second of every side in every turn. A figure is a median, a ratio the median of the ratios in a turn."""

    links: int
    lanes: int
    cores: int
    envpool: str
    """Which EnvPool, or why there are no figures of it."""
    rates: Mapping[str, Sequence[float]]

    def rate(self, side: str) -> float | None:
        """The median, or None if this side was not measured."""
        return statistics.median(self.rates[side]) if side in self.rates else None

    def ratio(self, ours: str, baseline: str) -> float | None:
        """How many times as fast the one is as the other, or None if one of them was not measured."""
        if ours not in self.rates or baseline not in self.rates:
            return None
        return statistics.median(own / other for own, other in zip(self.rates[ours], self.rates[baseline], strict=True))

    @property
    def heading(self) -> str:
        """What the figures depend on."""
        lanes = f"{_counted(self.lanes, 'lane')} ({_INSTRUCTIONS[self.lanes]})"
        return f"native walker: {lanes}, {_counted(self.cores, 'core')}; a controller of {self.links} links"

    @property
    def notes(self) -> list[str]:
        """What the table cannot say."""
        if "envpool" in self.rates:
            return []
        return [f"EnvPool was not measured: {self.envpool}; pip install 'bitneat[bench]' installs it."]

    def to_data(self) -> dict[str, Any]:
        """The figures as plain data; None for what was not measured."""
        envpool = {"one_core": self.rate("envpool"), "all_cores": self.rate("envpool, all cores")}
        return {
            "links": self.links,
            "lanes": self.lanes,
            "cores": self.cores,
            "steps_per_second": {
                "bitneat": {
                    "one_core": self.rate("bitneat"),
                    "all_cores": self.rate("bitneat, all cores"),
                    "by_lanes": {str(width): self.rate(_lanes_side(width, self.lanes)) for width in LANE_WIDTHS},
                    "vector_env_one_core": self.rate("vector"),
                    "vector_env_all_cores": self.rate("vector, all cores"),
                },
                "gymnasium": {
                    "one_core": self.rate("gymnasium"),
                    "one_core_with_controller": self.rate("gymnasium with the controller"),
                    "all_cores": self.rate("gymnasium, all cores"),
                },
                "envpool": envpool if "envpool" in self.rates else None,
            },
            "gymnasium_ratio": self.ratio("bitneat", "gymnasium"),
            "gymnasium_ratio_with_controller": self.ratio("bitneat", "gymnasium with the controller"),
            "gymnasium_ratio_all_cores": self.ratio("bitneat, all cores", "gymnasium, all cores"),
            "envpool_ratio": self.ratio("bitneat", "envpool"),
            "envpool_ratio_all_cores": self.ratio("bitneat, all cores", "envpool, all cores"),
        }

    def measurements(self) -> list[Measurement]:
        """The lines of the table; what was not measured has none."""
        one, every = "native walker, 1 core", f"native walker, {_counted(self.cores, 'core')}"
        vector = f"WalkerVectorEnv, {_VECTOR_WALKERS} walkers"
        bare = "bare Gymnasium loop, no policy"
        loops = f"{_counted(self.cores, 'bare Gymnasium loop')} in processes, no policy"
        wide = self.lanes == 16
        lines = [
            *self._steps(f"{one}, {self.lanes} lanes", "bitneat", bare, STEPS_GOALS.get(self.lanes)),
            *self._ratio("the same", "bitneat", bare, "gymnasium", GYMNASIUM_GOAL if wide else None),
            *self._ratio("the same", "bitneat", "Gymnasium, same controller", "gymnasium with the controller"),
            *self._ratio("the same", "bitneat", "EnvPool, 1 thread", "envpool", ENVPOOL_GOAL if wide else None),
        ]
        for width in reversed(LANE_WIDTHS):
            if width < self.lanes:
                what, side = f"{one}, {_counted(width, 'lane')}", _lanes_side(width, self.lanes)
                lines += self._steps(what, side, bare, STEPS_GOALS.get(width))
        threads = f"EnvPool, {_counted(self.cores, 'thread')}"
        return [
            *lines,
            *self._ratio(f"{every}, {self.lanes} lanes", "bitneat, all cores", loops, "gymnasium, all cores"),
            *self._ratio("the same", "bitneat, all cores", threads, "envpool, all cores"),
            *self._ratio(f"{vector}, 1 core", "vector", bare, "gymnasium"),
            *self._ratio(
                f"{vector}, {_counted(self.cores, 'core')}", "vector, all cores", loops, "gymnasium, all cores"
            ),
        ]

    def _steps(self, what: str, side: str, compared_with: str, goal: Goal | None) -> Iterator[Measurement]:
        """A line whose figure is the steps a second, beside those of a bare Gymnasium loop."""
        rate, other = self.rate(side), self.rate("gymnasium")
        if rate is not None and other is not None:
            yield _line(what, compared_with, (rate, other), (rate, "steps/s a core"), goal)

    def _ratio(
        self, what: str, side: str, compared_with: str, baseline: str, goal: Goal | None = None
    ) -> Iterator[Measurement]:
        """A line whose figure is the ratio."""
        rate, other, ratio = self.rate(side), self.rate(baseline), self.ratio(side, baseline)
        if rate is not None and other is not None and ratio is not None:
            yield _line(what, compared_with, (rate, other), (ratio, "times as fast"), goal)


def compare(repetitions: int) -> Comparison:
    """Measure all sides in turns, each turn one of each; a first turn, which compiles, loads and records, does not count.

    Neighbours in time are those whose ratio is asked for.
    """
    controller = fifty_links()
    lanes = lane_width(None)
    cores = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 256)
    recordings = record(controller, SEEDS[:_RECORDED_EPISODES], EPISODE_STEPS)
    native = partial(native_rate, controller)
    with ExitStack() as stack:
        sides: dict[str, Side] = {
            "gymnasium with the controller": partial(_loop_rate, controller, SEEDS[:_RECORDED_EPISODES]),
            "gymnasium": partial(bare_rate, recordings),
            "bitneat": partial(native, lanes, 1),
        }
        envpool, version = _envpool()
        if envpool is not None:
            sides["envpool"] = _envpool_side(stack, envpool, controller, 1)
        for width in LANE_WIDTHS:
            if width < lanes:
                sides[_lanes_side(width, lanes)] = partial(native, width, 1)
        sides["vector"] = _vector_side(stack, controller, 1)
        sides["vector, all cores"] = _vector_side(stack, controller, cores)
        pool = stack.enter_context(closing(WorkerPool(partial(bare_work, recordings), cores)))
        sides["gymnasium, all cores"] = partial(_pool_rate, pool, cores)
        sides["bitneat, all cores"] = partial(native, lanes, cores)
        if envpool is not None:
            sides["envpool, all cores"] = _envpool_side(stack, envpool, controller, cores)
        rates = _in_turns(sides, repetitions)
    return Comparison(controller.num_links, lanes, cores, version, rates)


def _in_turns(sides: Mapping[str, Side], repetitions: int) -> dict[str, list[float]]:
    rates: dict[str, list[float]] = {name: [] for name in sides}
    for turn in range(repetitions + 1):
        for name, side in sides.items():
            rate = side()
            if turn > 0:
                rates[name].append(rate)
    return rates


def native_rate(controller: Controller, lanes: int, threads: int) -> float:
    """The native walker's steps a second, from a call to its results: seeding, grounds and starts count."""
    episodes = threads * (_EPISODES_A_LANE * lanes if lanes > 1 else _SCALAR_EPISODES)
    seeds = list(islice(cycle(SEEDS), episodes))
    start = time.perf_counter()
    _, steps = run_episodes([controller], seeds, EPISODE_STEPS, lanes=lanes, threads=threads)
    return float(steps.sum() / (time.perf_counter() - start))


class _Noting:
    """A policy that does what another does, and notes its outputs."""

    def __init__(self, controller: Controller) -> None:
        self._policy = RuntimeController(controller)
        self.outputs: list[npt.NDArray[np.int16]] = []

    def reset(self) -> None:
        self._policy.reset()
        self.outputs = []

    def step(self, inputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
        self.outputs.append(self._policy.step(inputs))
        return self.outputs[-1]


def record(controller: Controller, seeds: Sequence[int], max_steps: int) -> list[Recording]:
    """What the controller does in an episode of each seed."""
    policy = _Noting(controller)
    runner = EpisodeRunner(_SPEC, controller, ACTION, policy)
    recordings = []
    for seed in seeds:
        runner(seed, max_steps)
        actions = np.array([ACTION.decode(outputs, controller.frac_bits) for outputs in policy.outputs])
        recordings.append((seed, actions))
    return recordings


def bare_work(recordings: Sequence[Recording], _: object = None) -> tuple[int, float]:
    """Do in Gymnasium what was recorded; the steps and the seconds that the environment took, its start included.

    Each episode has a new environment, since a used one would leave the recorded path; to make it does not count.
    """
    steps, seconds = 0, 0.0
    for seed, actions in recordings:
        environment = make(_SPEC)
        rows = list(actions)
        step = environment.step
        start = time.perf_counter()
        environment.reset(seed=seed)
        for row in rows:
            step(row)
        seconds += time.perf_counter() - start
        steps += len(rows)
        environment.close()
    return steps, seconds


def bare_rate(recordings: Sequence[Recording]) -> float:
    """Gymnasium's steps a second with nothing else in the loop."""
    steps, seconds = bare_work(recordings)
    return steps / seconds


def _loop_rate(controller: Controller, seeds: Sequence[int]) -> float:
    runner = EpisodeRunner(_SPEC, controller, ACTION, RuntimeController(controller), "gymnasium")
    start = time.perf_counter()
    steps = sum(runner(seed, EPISODE_STEPS).steps for seed in seeds)
    return steps / (time.perf_counter() - start)


def _pool_rate(pool: WorkerPool, workers: int) -> float:
    """All workers at once; the slowest one's time counts, without what it takes to talk to them."""
    done = list(pool.map([None] * workers))
    steps = sum(steps for steps, _ in done)
    return float(steps / max(seconds for _, seconds in done))


class _Batch:
    """A vector environment under the controller. Only the time inside ``step`` counts, so the policy's does not."""

    def __init__(self, environment: Any, controller: Controller, walkers: int, steps: int, seed: int | None) -> None:
        self._environment = environment
        self._policy = BatchPolicy(controller)
        self._walkers = walkers
        self._steps = steps
        self._observations, _ = environment.reset() if seed is None else environment.reset(seed=seed)

    def __call__(self) -> float:
        """The steps a second of the next steps; episodes go on from turn to turn, and a reset counts as a step."""
        seconds = 0.0
        for _ in range(self._steps):
            actions = self._policy(self._observations)
            start = time.perf_counter()
            self._observations, *_ = self._environment.step(actions)
            seconds += time.perf_counter() - start
        return self._steps * self._walkers / seconds


def _vector_side(stack: ExitStack, controller: Controller, threads: int) -> Side:
    environment = stack.enter_context(closing(WalkerVectorEnv(_VECTOR_WALKERS, threads=threads)))
    return _Batch(environment, controller, _VECTOR_WALKERS, _part(_VECTOR_STEPS) * threads, 0)


def _envpool_side(stack: ExitStack, envpool: Any, controller: Controller, threads: int) -> Side:
    walkers = _ENVPOOL_WALKERS * threads
    environment = envpool.make_gymnasium(_SPEC.id, num_envs=walkers, num_threads=threads, seed=0)
    stack.enter_context(closing(environment))
    return _Batch(environment, controller, walkers, _part(_ENVPOOL_STEPS), None)


def _part(of_an_episode: float) -> int:
    return max(1, round(of_an_episode * EPISODE_STEPS))


def _envpool() -> tuple[Any, str]:
    """The module and its version, or None and why."""
    try:
        module = importlib.import_module("envpool")
        return module, f"EnvPool {module.__version__}"
    except ModuleNotFoundError:
        return None, "it is not installed"
    except Exception as error:  # it is foreign code, and none of its faults shall keep the others from being measured
        return None, f"it cannot be imported ({type(error).__name__}: {' '.join(str(error).split())})"


def _lanes_side(width: int, widest: int) -> str:
    return "bitneat" if width == widest else f"bitneat, {width} lanes"


def _line(
    what: str, compared_with: str, rates: tuple[float, float], result: tuple[float, str], goal: Goal | None
) -> Measurement:
    said, met = "", None
    if goal is not None:
        aim, floor = goal
        said = f">= {aim}" if aim == floor else f">= {aim}, at least {floor}"
        met = result[0] >= aim
    return Measurement(what, rates[0], compared_with, rates[1], "steps/s", *result, said, met)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
