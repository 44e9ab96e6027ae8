# SPDX-License-Identifier: MIT
"""How long `bitneat evolve` without arguments takes to a controller of 300 on BipedalWalker-v3, by seed of the search.

    python -m benchmarks.solve                       # seeds 1 to 5, two threads
    python -m benchmarks.solve --seeds 7 8 --threads 4

A run counts as solved when the leader has a mean of at least 300 on the selection seeds *and* on 100 episodes that nothing was
chosen on; then it is scored on 1,000 more. Times are of this machine, wall clock, with whatever else it does; steps are not.
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
from bitneat.controller.packing import pack
from bitneat.evolve.config import load
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.search import Candidate, Score, Search
from bitneat.files import write_atomic, write_json
from bitneat.reproduce.running import WALKER
from bitneat.sim.environment import inspect

SOLVED = 300.0
UNSEEN, MORE = 100, 1000
LIMIT = 30 * 60.0
PAGE = Path(__file__).resolve().parents[1] / "docs" / "search.md"
FILE = Path(__file__).resolve().parents[1] / "docs" / "search" / "solve.json"


def solve(seed: int, threads: int, limit: float) -> dict[str, Any]:
    """One search until it is solved or the time is up."""
    info = inspect(WALKER)
    search = Search(load("bipedalwalker"), WALKER, info, seed, ())
    evaluator = NativeWalkerEvaluator(WALKER, search.max_steps, threads)
    seeds = report_seeds(UNSEEN + MORE)
    began = time.monotonic()
    tried: Candidate | None = None
    score: Score | None = None
    while not search.finished and time.monotonic() - began < limit:
        search.advance(evaluator)
        leader = search.candidates[0]
        if leader.mean < SOLVED or leader is tried:
            continue
        tried = leader
        score = Score.of(evaluator.evaluate([leader.controller], seeds[:UNSEEN])[0])
        if score.mean >= SOLVED:
            break
    seconds = time.monotonic() - began
    controller = search.candidates[0].controller
    solved = score is not None and score.mean >= SOLVED
    more = Score.of(evaluator.evaluate([controller], seeds[UNSEEN:])[0])
    return {
        "seed": seed,
        "solved": solved,
        "seconds": round(seconds, 1),
        "steps": search.total_steps,
        "generations": search.generation,
        "selection": search.candidates[0].mean,
        "unseen": None if score is None else score.to_data(),
        "more": more.to_data(),
        "packed_bytes": len(pack(controller)),
    }


def table(runs: Sequence[Mapping[str, Any]], threads: int) -> str:
    """A row for each run, and the median of the times; a run that was not solved took the longest."""
    lines = [
        "| seed of the search | minutes to 300 | steps | generations | mean of 100 unseen episodes | of 1,000 more | bytes |",
        "|---|---|---|---|---|---|---|",
    ]
    for run in runs:
        unseen = "-" if run["unseen"] is None else f"{run['unseen']['mean']:.1f}"
        minutes = f"{run['seconds'] / 60:.1f}" if run["solved"] else "not in 30"
        lines.append(
            f"| {run['seed']} | {minutes} | {run['steps'] / 1e6:.0f} M | {run['generations']} | {unseen} |"
            f" {run['more']['mean']:.1f} | {run['packed_bytes']} |"
        )
    times = sorted(run["seconds"] if run["solved"] else math.inf for run in runs)
    middle = statistics.median_low(times)
    said = "none: too few runs were solved" if middle == math.inf else f"{middle / 60:.1f} minutes"
    return "\n".join([*lines, "", f"Median of the {len(runs)} runs, {threads} threads: {said}."]) + "\n"


def main() -> int:
    """Run the searches one after the other, and write what they came to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5], metavar="S", help="default 1 to 5")
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="default 2")
    args = parser.parse_args()
    runs = []
    for seed in args.seeds:
        runs.append(solve(seed, args.threads, LIMIT))
        print(json.dumps(runs[-1]), flush=True)
    FILE.parent.mkdir(parents=True, exist_ok=True)
    write_json(FILE, {"threads": args.threads, "runs": runs})
    page = PAGE.read_text(encoding="utf-8")
    write_atomic(PAGE, replaced(page, "solve", table(runs, args.threads)).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
