# SPDX-License-Identifier: MIT
"""What a Ray cluster costs: the same episodes on this machine's threads and through Ray on as many cores, in turns.

    python -m benchmarks.cluster --workers 2 --rounds 5

Both sides run the same controllers on the same seeds in the native walker, and must give the same episodes. The difference in
time, by task, is what Ray adds: scheduling, sending, waiting. docs/scaling.md reckons with it.
"""

from __future__ import annotations

import argparse
import random
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bitneat
from bitneat.champion import EnvironmentSpec
from bitneat.controller import Controller
from bitneat.evolve import cluster
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.files import write_json
from bitneat.sim.environment import inspect

WALKER = EnvironmentSpec("BipedalWalker-v3")
STEPS = 400
"""Of an episode at most, about as many as early episodes have."""
CHAMPION = Path(__file__).parents[1] / "examples" / "champions" / "walker.pkl"


@dataclass(frozen=True)
class Row:
    """A number of episodes in one call, on both sides."""

    episodes: int
    tasks: int
    steps: int
    local_seconds: float
    ray_seconds: float

    @property
    def overhead(self) -> float:
        """Milliseconds that Ray adds to each task, as seen by a core that is never idle."""
        return 1000 * (self.ray_seconds - self.local_seconds) / self.tasks


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2, help="cores of either side (default 2)")
    parser.add_argument("--rounds", type=int, default=5, help="each side runs so often; medians are shown (default 5)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to FILE, too")
    args = parser.parse_args()
    action = inspect(WALKER).action
    local = NativeWalkerEvaluator(WALKER, STEPS, args.workers)
    started = time.perf_counter()
    ray = cluster.RayEvaluator(WALKER, action, STEPS, simulator="native", workers=args.workers)
    ray.evaluate(_population(args.workers * 16, 0), [0])  # workers start with the first tasks
    print(f"a cluster of {args.workers} cores on this machine starts in {time.perf_counter() - started:.1f} s")
    rows = [_compare(local, ray, count, args) for count in (100, 400, 1600)]
    print(f"{'episodes':>8} {'tasks':>6} {'steps':>9} {'threads s':>10} {'Ray s':>8} {'ratio':>6} {'ms a task':>10}")
    for row in rows:
        print(
            f"{row.episodes:>8} {row.tasks:>6} {row.steps:>9,} {row.local_seconds:>10.3f} {row.ray_seconds:>8.3f}"
            f" {row.local_seconds / row.ray_seconds:>6.2f} {row.overhead:>10.2f}"
        )
    print(f"empty tasks: {_empty_tasks(ray):,.0f} a second from one process")
    ray.close()
    if args.json is not None:
        write_json(args.json, [vars(row) | {"overhead_ms": row.overhead} for row in rows])


def _compare(local: Evaluator, ray: Evaluator, count: int, args: argparse.Namespace) -> Row:
    seeds = [3, 4]
    times: dict[str, list[float]] = {"local": [], "ray": []}
    steps = 0
    for turn in range(args.rounds):
        population = _population(count // len(seeds), turn)
        answers = []
        for name, evaluator in (("local", local), ("ray", ray)):
            began = time.perf_counter()
            answers.append(evaluator.evaluate(population, seeds))
            times[name].append(time.perf_counter() - began)
        if answers[0] != answers[1]:
            raise SystemExit("the episodes differ")
        steps = sum(episode.steps for row in answers[0] for episode in row)
    tasks = len(list(cluster.chunks(count // len(seeds), len(seeds), args.workers, cluster.LEAST_EPISODES["native"])))
    return Row(count, tasks, steps, statistics.median(times["local"]), statistics.median(times["ray"]))


def _population(count: int, seed: int) -> list[Controller]:
    """Variants of a walker that differ in one input's limit, so that no two are equal."""
    champion = bitneat.load(CHAMPION).controller
    rng = random.Random(seed)
    return [_variant(champion, rng) for _ in range(count)]


def _variant(controller: Controller, rng: random.Random) -> Controller:
    data = controller.to_data()
    entry = rng.choice(data["inputs"])
    entry["limit"] = max(1, entry["limit"] - rng.randint(1, 60))
    return Controller.from_data(data)


def _empty_tasks(evaluator: Any, count: int = 2000) -> float:
    ray = evaluator._ray
    nothing: Callable[[], None] = lambda: None  # noqa: E731
    task = ray.remote(num_cpus=1)(nothing)
    ray.get([task.remote() for _ in range(50)])
    began = time.perf_counter()
    ray.get([task.remote() for _ in range(count)])
    return count / (time.perf_counter() - began)


if __name__ == "__main__":
    main()
