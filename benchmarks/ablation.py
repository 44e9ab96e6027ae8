# SPDX-License-Identifier: MIT
"""What each lever of the search is worth: the preset of BipedalWalker-v3 without it, three seeds, 50 million simulated steps each.

    python -m benchmarks.ablation                    # all that has no result yet; stop it and call it again as you like
    python -m benchmarks.ablation --only 'all-*' --only 'no-race-*'
    python -m benchmarks.ablation --list

Each run is one of `bitneat evolve` with the entries changed that `VARIANTS` has, in a process with one thread. Runs with the same
seed share the linear start, where the variant does not change it. Results are kept in docs/search, a file a run, and the table in
docs/search.md is written anew from those that are there.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from benchmarks.linear_start import linear_start
from benchmarks.pages import replaced
from bitneat.errors import BitneatError
from bitneat.evolve.config import load
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.evolve.run import RunSettings
from bitneat.files import write_atomic
from bitneat.reproduce.experiments import Job
from bitneat.reproduce.results import Result, load_all
from bitneat.reproduce.running import WALKER, configuration
from bitneat.reproduce.schedule import State, elapsed, run_all
from bitneat.sim.walker.trigonometry import probe_for

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "search"
PAGE = ROOT / "docs" / "search.md"
STEPS = 50_000_000
SEEDS = (1, 2, 3)
SOLVED = 300.0
_MAX_STEPS = 1600

Variant = tuple[str, Mapping[str, Mapping[str, Any]]]

VARIANTS: Mapping[str, Variant] = {
    "all": ("the preset as it is", {}),
    "no-linear-start": ("NEAT from random genomes", {"evolve": {"linear_generations": 0}}),
    "long-linear-start": ("300 generations of the linear start, not 150", {"evolve": {"linear_generations": 300}}),
    "no-race": ("5 episodes for every genome, no race", {"evolve": {"race_episodes": (5,), "race_fractions": (1.0,)}}),
    "same-seeds": ("the same episodes in every generation", {"evolve": {"new_seeds": 0}}),
    "no-early-end": ("episodes without progress go on", {"evolve": {"stall_steps": 0}}),
    "free-falls": ("a fall costs nothing in the search", {"evolve": {"fall_value_start": 0.0, "fall_value_end": 0.0}}),
    "finish-bonus": ("a bonus of 100 for the time that is left at the end", {"evolve": {"finish_bonus": 100.0}}),
    "no-size-pressure": ("reward alone decides", {"evolve": {"size_pressure": 0.0}}),
    "size-pressure": (
        "Pareto fronts of reward and links in half of the generations",
        {"evolve": {"size_pressure": 0.5}},
    ),
    "risk": ("one standard deviation is taken off the mean", {"evolve": {"risk": 1.0}}),
    "restarts": ("a new population after 10 generations without a better candidate", {"evolve": {"restart_after": 10}}),
    "one-species": ("no speciation", {"BitSpeciesSet": {"target_species": 1}}),
    "sought-species": (
        "the threshold that gives 6 species is sought in each generation",
        {"BitSpeciesSet": {"threshold_trials": 16}},
    ),
    "many-species": (
        "20 species, whose threshold is sought",
        {"BitSpeciesSet": {"target_species": 20, "threshold_trials": 16}},
    ),
    "no-crossover": ("mutation alone", {"BitReproduction": {"crossover": 0.0}}),
    "one-mutation": ("one mutation a child, not 1.5", {"BitGenome": {"mutations": 1.0}}),
    "four-mutations": ("four mutations a child", {"BitGenome": {"mutations": 4.0}}),
    "no-gain-mutation": ("gains stay as the linear start left them", {"BitGenome": {"mutate_gain": 0.0}}),
    "clamped-only": ("one activation", {"BitGenome": {"activations": ("clamped",)}}),
    "delays": ("delayed links, which remember", {"BitGenome": {"mutate_delay": 1.0}}),
    "half-population": ("100 genomes, twice the generations", {"NEAT": {"pop_size": 100}}),
    "double-population": ("400 genomes, half the generations", {"NEAT": {"pop_size": 400}}),
}
"""What each is, and its entries of the configuration."""


def jobs() -> list[Job]:
    """A run of each variant with each seed; whatever number of generations the steps allow."""
    return [
        Job(f"{name}-{seed}", "ablation", name, seed, _overrides(entries), preset="bipedalwalker")
        for seed in SEEDS
        for name, (_, entries) in VARIANTS.items()
    ]


def _overrides(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    overrides = {section: dict(values) for section, values in entries.items()}
    evolve = {"generations": 100_000, "max_total_steps": STEPS, **overrides.get("evolve", {})}
    return {**overrides, "evolve": evolve}


def main() -> int:
    """Run what is open, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="PATTERN", action="append", help="only runs whose name matches")
    parser.add_argument("--list", action="store_true", help="print the runs, and which are done, and stop")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="runs at the same time (default 2)")
    args = parser.parse_args()
    chosen = [job for job in jobs() if not args.only or any(fnmatchcase(job.name, one) for one in args.only)]
    if args.list:
        done = load_all(FOLDER / "results")
        for job in chosen:
            print(f"{'done' if job.name in done else 'open':5} {job.name}")
        return 0
    began = time.monotonic()

    def tell(state: State) -> None:
        if state.finished is not None:
            score = state.finished.heldout
            text = f"{state.finished.job}: {score['mean']:.1f} ± {score['std']:.1f} held out"
            print(f"{text} ({state.done} of {state.total}, {elapsed(began)})", flush=True)

    try:
        begin([job for job in chosen if job.name not in load_all(FOLDER / "results")], FOLDER, args.workers)
        results = run_all(chosen, FOLDER, args.workers, _command, tell)
    except BitneatError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print("stopped; the same command goes on", file=sys.stderr)
        return 130
    page = PAGE.read_text(encoding="utf-8")
    write_atomic(PAGE, replaced(page, "ablation", table(results)).encode())
    return 0


def begin(open_jobs: Sequence[Job], folder: Path, workers: int) -> None:
    """Let the runs that have not begun yet go on from the linear start that they share."""
    evaluator = NativeWalkerEvaluator(WALKER, _MAX_STEPS, workers)
    for job in open_jobs:
        config, run = configuration(job, {}), folder / "runs" / job.name
        if config["evolve"]["linear_generations"] == 0 or (run / "run.json").exists():
            continue
        preset = load("bipedalwalker")
        start = linear_start(folder / "runs" / f"linear-start-{job.seed}.json", WALKER, preset, job.seed, evaluator)
        if start.serves(config, job.seed):
            start.begin(run, RunSettings(WALKER, config, job.seed, trigonometry=probe_for(WALKER)))


def _command(job: Job) -> str:
    return f"python -m benchmarks.ablation --only {job.name}"


def table(results: Mapping[str, Result]) -> str:
    """A row for each variant that has a result, the best median first; differences are to the preset's median."""
    runs = {name: [r for r in results.values() if r.system == name] for name in VARIANTS}
    medians = {name: statistics.median(_means(found)) for name, found in runs.items() if found}
    lines = [
        "| variant | what is changed | held out, median | each run | against the preset | 300 reached after | packed bytes |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in sorted(medians, key=lambda name: -medians[name]):
        found = sorted(runs[name], key=lambda run: run.seed)
        difference = f"{medians[name] - medians['all']:+.1f}" if "all" in medians and name != "all" else ""
        each = ", ".join(f"{mean:.1f}" for mean in _means(found))
        size = statistics.median(run.packed_bytes or 0 for run in found)
        lines.append(
            f"| `{name}` | {VARIANTS[name][0]} | {medians[name]:.1f} | {each} | {difference} | {_reached(found)} | {size:g} |"
        )
    return "\n".join(lines) + "\n"


def _means(runs: Sequence[Result]) -> list[float]:
    return [float(run.heldout["mean"]) for run in runs]


def _reached(runs: Sequence[Result]) -> str:
    """Million steps until the best candidate had 300 on the selection seeds, of each run that came so far."""
    found = [millions for run in runs if (millions := steps_to(run.history, SOLVED)) is not None]
    return ", ".join(f"{millions / 1e6:.0f} M" for millions in found) or "-"


def steps_to(history: Mapping[str, Sequence[float]], score: float) -> float | None:
    """Simulated steps up to the first generation whose best candidate has the score on the selection seeds."""
    total = 0.0
    for steps, selection in zip(history["steps"], history["selection"], strict=True):
        total += steps
        if selection >= score:
            return total
    return None


if __name__ == "__main__":
    sys.exit(main())
