# SPDX-License-Identifier: MIT
"""What each lever of the search is worth: the preset of BipedalWalker-v3 without it, three seeds, 50 million simulated steps each.

    python -m benchmarks.ablation                    # all that has no result yet; stop it and call it again as you like
    python -m benchmarks.ablation --only 'all-*' --only 'no-race-*'
    python -m benchmarks.ablation --list

Each run is one of `bitneat evolve` with the entries changed that `VARIANTS` has, in a process with one thread. Runs with the same
seed share the linear start, where the variant does not change it. Results are kept in docs/search, a file a run; then each champion
walks 1,000 episodes more, since a hundred leave falls to chance, and the table in docs/search.md is written anew.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from benchmarks.linear_start import linear_start
from benchmarks.pages import replaced
from bitneat.errors import BitneatError
from bitneat.evolve.config import load, parse
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.run_folder import RunSettings
from bitneat.evolve.search import Score
from bitneat.files import write_atomic, write_json
from bitneat.network import Policy
from bitneat.reproduce.experiments import Job
from bitneat.reproduce.results import Result, load_all, policy_from_data
from bitneat.reproduce.running import REPORT_EPISODES, WALKER, configuration
from bitneat.reproduce.schedule import State, elapsed, run_all
from bitneat.sim.environment import Shaping
from bitneat.sim.walker.trigonometry import probe_for
from bitneat.sim.walker.vector import STEP_LIMIT

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "search"
PAGE = ROOT / "docs" / "search.md"
STEPS = 50_000_000
SEEDS = (1, 2, 3)
FINAL_EPISODES = 128
SOLVED = 300.0
SCORED = 1000
"""Episodes that score a champion, after those of its run."""
_FALL = -100.0

Variant = tuple[str, Mapping[str, Mapping[str, Any]]]

VARIANTS: Mapping[str, Variant] = {
    "all": ("the preset as it is", {}),
    "no-linear-start": ("NEAT from random genomes", {"evolve": {"linear_generations": 0}}),
    "long-linear-start": (
        "300 generations of the linear start, which use up the steps: no NEAT",
        {"evolve": {"linear_generations": 300}},
    ),
    "no-race": ("5 episodes for every genome, no race", {"evolve": {"race_episodes": (5,), "race_fractions": (1.0,)}}),
    "same-seeds": ("the same episodes in every generation of NEAT", {"evolve": {"new_seeds": 0}}),
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
    "no-gain-mutation": ("no gain is changed", {"BitGenome": {"mutate_gain": 0.0}}),
    "clamped-only": ("one activation for what NEAT adds", {"BitGenome": {"activations": ("clamped",)}}),
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
    # The preset chooses by more final episodes by now: what the first of these runs showed.
    evolve = {
        "generations": 100_000,
        "max_total_steps": STEPS,
        "final_episodes": FINAL_EPISODES,
        **overrides.get("evolve", {}),
    }
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
    scores = scored(results, FOLDER / "scores.json", NativeWalkerEvaluator(WALKER, STEP_LIMIT, args.workers))
    page = PAGE.read_text(encoding="utf-8")
    write_atomic(PAGE, replaced(page, "ablation", table(results, scores)).encode())
    return 0


def begin(open_jobs: Sequence[Job], folder: Path, workers: int) -> None:
    """Let the runs that have not begun yet go on from the linear start that they share."""
    evaluator = NativeWalkerEvaluator(WALKER, STEP_LIMIT, workers)
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


@dataclass(frozen=True)
class Walks:
    """How a champion walks in episodes that came after those of its run."""

    sha256: str
    """Of the controller."""
    episodes: int
    mean: float
    std: float
    falls: int


def scored(results: Mapping[str, Result], file: Path, evaluator: Evaluator) -> dict[str, Walks]:
    """How each champion walks, by job; what ``file`` has of the same controllers is not computed again."""
    known = {name: Walks(**entry) for name, entry in json.loads(file.read_text()).items()} if file.exists() else {}
    scores = {}
    for name, result in sorted(results.items()):
        assert result.policy is not None
        policy = policy_from_data(result.policy)
        found = known.get(name)
        if found is None or (found.sha256, found.episodes) != (policy.sha256, SCORED):
            found = walks(policy, evaluator)
        scores[name] = found
    write_json(file, {name: asdict(entry) for name, entry in scores.items()})
    return scores


def walks(policy: Policy, evaluator: Evaluator) -> Walks:
    """How a policy walks in the report's episodes after the hundred that a run is scored on."""
    seeds = report_seeds(REPORT_EPISODES + SCORED)[REPORT_EPISODES:]
    fallen = Shaping(fall_reward=_FALL, fall_value=_FALL - 1.0)  # tells a fall from an arrival
    episodes = evaluator.evaluate([policy], seeds, fallen)[0]
    score = Score.of(episodes)
    return Walks(policy.sha256, SCORED, score.mean, score.std, sum(one.shaped != one.reward for one in episodes))


def table(results: Mapping[str, Result], scores: Mapping[str, Walks]) -> str:
    """A row for each variant that has a result. Differences are to the preset's run with the same seed; the largest is first."""
    runs = {
        name: {result.seed: result for result in results.values() if result.system == name and result.job in scores}
        for name in VARIANTS
    }
    means = {name: {seed: scores[run.job].mean for seed, run in found.items()} for name, found in runs.items()}
    gains = {
        name: [mean - means["all"][seed] for seed, mean in found.items() if seed in means["all"]]
        for name, found in means.items()
        if found
    }
    median_gains = {name: statistics.median(found) if found else -math.inf for name, found in gains.items()}
    lines = [
        "| variant | what is changed | mean reward | more than the preset with the same seed, median"
        " | falls in 100 walks | generations of NEAT | 300 on the selection seeds after | packed bytes |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in sorted(gains, key=lambda name: -median_gains[name]):
        found = [runs[name].get(seed) for seed in SEEDS]
        difference = f"{median_gains[name]:+.1f}" if gains[name] and name != "all" else ""
        size = statistics.median(run.packed_bytes or 0 for run in found if run is not None)
        cells = (
            f"`{name}`",
            VARIANTS[name][0],
            _each(found, lambda run: f"{scores[run.job].mean:.1f}"),
            difference,
            _each(found, lambda run: f"{100 * scores[run.job].falls / scores[run.job].episodes:.1f}"),
            _each(found, _neat_generations),
            _each(found, _reached),
            f"{size:g}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _each(runs: Sequence[Result | None], text: Callable[[Result], str]) -> str:
    """What there is to say of each run, by seed; nothing for those that are missing at the end."""
    known = [None if run is None else text(run) for run in runs]
    while known and known[-1] is None:
        known.pop()
    return ", ".join(entry if entry is not None else "?" for entry in known)


def _neat_generations(run: Result) -> str:
    linear = parse(run.config["text"], run.job)["evolve"]["linear_generations"]
    return str(max(run.generations - linear, 0))


def _reached(run: Result) -> str:
    """Million steps until the best candidate had 300 on the selection seeds."""
    millions = steps_to(run.history, SOLVED)
    return "-" if millions is None else f"{millions / 1e6:.0f} M"


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
