# SPDX-License-Identifier: MIT
"""How long `bitneat evolve` without arguments takes to a controller of 300 on BipedalWalker-v3, by seed of the search.

    python -m benchmarks.solve                       # seeds 1 to 5, two threads; goes on where it was stopped
    python -m benchmarks.solve --seeds 7 8 --threads 4

A leader with a mean of at least 300 on the selection seeds is tried on 100 episodes, and if it has 300 there on 1,000 more; every
try has episodes of its own. The run counts as solved when a leader has 300 in both, and a last 1,000 episodes, on which nothing was
decided, say what it is worth. Times are of this machine, wall clock, trials included, with whatever else it does; steps are not.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.pages import replaced
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.evolve.config import load
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.search import Candidate, Score, Search
from bitneat.files import write_atomic, write_json
from bitneat.network import Policy
from bitneat.reproduce.running import WALKER
from bitneat.sim.environment import inspect

SOLVED = 300.0
TRIED, CONFIRMED = 100, 1000
FIRST = 10_000
"""Of the report seeds those before are others' to score on."""
LIMIT = 30 * 60.0
PAGE = Path(__file__).resolve().parents[1] / "docs" / "search.md"
FILE = Path(__file__).resolve().parents[1] / "docs" / "search" / "solve.json"


class Trials:
    """Episodes for one leader after the other; no two have one in common."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self._used = FIRST
        self.count = 0

    def score(self, controller: Policy, episodes: int) -> Score:
        """The score over so many episodes that nobody has seen."""
        seeds = report_seeds(self._used + episodes)[self._used :]
        self._used += episodes
        return Score.of(self._evaluator.evaluate([controller], seeds)[0])

    def passed(self, controller: Policy) -> bool:
        """Whether a leader has 300 in both trials."""
        self.count += 1
        return all(self.score(controller, episodes).mean >= SOLVED for episodes in (TRIED, CONFIRMED))


def solve(seed: int, threads: int, limit: float) -> dict[str, Any]:
    """One search until it is solved, or the time or its generations are up."""
    search = Search(load("bipedalwalker"), WALKER, inspect(WALKER), seed, ())
    evaluator = NativeWalkerEvaluator(WALKER, search.max_steps, threads)
    trials = Trials(evaluator)
    began = time.monotonic()
    tried: Candidate | None = None
    solved = False
    while not solved and not search.finished and time.monotonic() - began < limit:
        search.advance(evaluator)
        leader = search.candidates[0]
        if leader.mean >= SOLVED and leader is not tried:
            tried = leader
            solved = trials.passed(leader.controller)
    seconds = time.monotonic() - began
    controller = search.candidates[0].controller
    assert isinstance(controller, Controller)
    return {
        "seed": seed,
        "threads": threads,
        "solved": solved and seconds < limit,
        "seconds": round(seconds, 1),
        "steps": search.total_steps,
        "generations": search.generation,
        "trials": trials.count,
        "selection": search.candidates[0].mean,
        "score": trials.score(controller, CONFIRMED).to_data(),
        "packed_bytes": len(pack(controller)),
    }


def table(runs: Sequence[Mapping[str, Any]]) -> str:
    """A row for each run, and the median of the times; a run that was not solved took the longest."""
    lines = [
        "| seed | minutes to 300 | steps of races | generations | leaders tried | mean of 1,000 other episodes | bytes |",
        "|---|---|---|---|---|---|---|",
    ]
    for run in runs:
        minutes = f"{run['seconds'] / 60:.1f}" if run["solved"] else f"not in {run['seconds'] / 60:.1f}"
        lines.append(
            f"| {run['seed']} | {minutes} | {run['steps'] / 1e6:.0f} M | {run['generations']} | {run['trials']} |"
            f" {run['score']['mean']:.1f} ± {run['score']['std']:.1f} | {run['packed_bytes']} |"
        )
    times = sorted(run["seconds"] if run["solved"] else math.inf for run in runs)
    middle = statistics.median_high(times)
    said = "none: too few runs were solved" if middle == math.inf else f"{middle / 60:.1f} minutes"
    threads = " or ".join(str(number) for number in sorted({run["threads"] for run in runs}))
    return "\n".join([*lines, "", f"Median of the {len(runs)} runs, {threads} threads: {said}."]) + "\n"


def main() -> int:
    """Run the searches that have no result yet one after the other, and write what all came to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5], metavar="S", help="default 1 to 5")
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="default 2")
    args = parser.parse_args()
    runs = {run["seed"]: run for run in json.loads(FILE.read_text())["runs"]} if FILE.exists() else {}
    for seed in args.seeds:
        if seed in runs:
            continue
        runs[seed] = solve(seed, args.threads, LIMIT)
        print(json.dumps(runs[seed]), flush=True)
        FILE.parent.mkdir(parents=True, exist_ok=True)
        known = [runs[number] for number in sorted(runs)]
        write_json(FILE, {"runs": known})
        write_atomic(PAGE, replaced(PAGE.read_text(encoding="utf-8"), "solve", table(known)).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
