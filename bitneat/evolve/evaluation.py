# SPDX-License-Identifier: MIT
"""The one function that the search sees: controllers and seeds in, episodes out.

Every evaluator gives the same results for the same controllers and seeds, whatever its number of workers.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any, Protocol

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action
from bitneat.errors import BitneatError
from bitneat.evolve.pool import WorkerPool
from bitneat.network import FloatNetwork, Policy
from bitneat.runtime import RuntimeController
from bitneat.sim import bipedal
from bitneat.sim.environment import EpisodeResult, EpisodeRunner, Shaping, allow_imports, allowed_imports
from bitneat.sim.walker.binding import MAX_THREADS
from bitneat.sim.walker.episodes import evaluate as evaluate_natively


class Evaluator(Protocol):
    """Runs every controller on every seed."""

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        """The episodes, by controller and then by seed."""

    def close(self) -> None:
        """Let go of processes; the evaluator is of no use afterwards."""


class GymnasiumEvaluator:
    """Any Gymnasium environment, in this process or spread over ``workers`` processes.

    Args:
        spec: the environment.
        action: its action space.
        max_steps: the time limit of an episode.
        workers: 1 runs in this process.
        simulator: as of `EpisodeRunner`; it changes no result.
    """

    def __init__(
        self, spec: EnvironmentSpec, action: Action, max_steps: int, workers: int, simulator: str = "auto"
    ) -> None:
        self.spec, self.action, self.max_steps = spec, action, max_steps
        self._jobs = EpisodeJobs(spec, action, max_steps, simulator)
        self._pool = WorkerPool(self._jobs, workers) if workers > 1 else None
        # Short episodes go out by the handful, since each message costs as much as dozens of their steps.
        self._seeds_a_job = 1 if max_steps > 600 else 4

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        """The episodes, by controller and then by seed."""
        jobs = []
        owners = []
        for index, controller in enumerate(controllers):
            blob = pickle.dumps(controller)
            for start in range(0, len(seeds), self._seeds_a_job):
                jobs.append((blob, tuple(seeds[start : start + self._seeds_a_job]), shaping))
                owners.append(index)
        results: list[list[EpisodeResult]] = [[] for _ in controllers]
        done = map(self._jobs, jobs) if self._pool is None else self._pool.map(jobs)
        for owner, episodes in zip(owners, done, strict=True):
            results[owner].extend(episodes)
        return results

    def close(self) -> None:
        """Stop the processes."""
        if self._pool is not None:
            self._pool.close()


class NativeWalkerEvaluator:
    """BipedalWalker in C, which gives Gymnasium's results to the bit; see `bitneat.sim.walker.original.obstacle`.

    Args:
        spec: the environment, which must have no obstacle.
        max_steps: the time limit of an episode.
        workers: threads.
    """

    def __init__(self, spec: EnvironmentSpec, max_steps: int, workers: int) -> None:
        self.spec, self.max_steps = spec, max_steps
        self._hardcore = bipedal.is_hardcore(spec)
        self._threads = min(workers, MAX_THREADS)

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        """The episodes, by controller and then by seed."""
        return evaluate_natively(
            controllers, seeds, self.max_steps, shaping, hardcore=self._hardcore, threads=self._threads
        )

    def close(self) -> None:
        """Nothing to do: threads end with each call."""


class EpisodeJobs:
    """What a worker does: run one controller on some seeds."""

    def __init__(self, spec: EnvironmentSpec, action: Action, max_steps: int, simulator: str) -> None:
        self._spec = spec
        self._simulator = simulator
        self._action = action
        self._max_steps = max_steps
        self._last: tuple[bytes, EpisodeRunner] | None = None
        self._allowed = allowed_imports()

    def __call__(self, job: tuple[bytes, tuple[int, ...], Shaping | None]) -> list[EpisodeResult]:
        """The episodes of one job; the job comes from our own process, never from a file."""
        blob, seeds, shaping = job
        run = self._runner(blob)
        try:
            return [run(seed, self._max_steps, shaping) for seed in seeds]
        except BitneatError:
            raise
        except (Exception, SystemExit) as error:  # the environment is foreign code
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise BitneatError(f"environment {self._spec.id}: an episode failed: {reason}") from error

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # A worker starts afresh: what the user allowed goes with the jobs.
        self.__dict__.update(state)
        allow_imports(self._allowed)

    def _runner(self, blob: bytes) -> EpisodeRunner:
        if self._last is None or self._last[0] != blob:
            controller: Policy = pickle.loads(blob)
            policy = controller if isinstance(controller, FloatNetwork) else RuntimeController(controller)
            self._last = (blob, EpisodeRunner(self._spec, controller, self._action, policy, self._simulator))
        return self._last[1]
