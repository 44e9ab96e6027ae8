# SPDX-License-Identifier: MIT
"""How one job runs, in a folder of its own, from where it was stopped."""

from __future__ import annotations

import csv
import statistics
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bitneat.champion import EnvironmentSpec
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.config import Config, parse
from bitneat.evolve.config import load as load_config
from bitneat.evolve.evaluation import Evaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.recheck import Recheck
from bitneat.evolve.run import carry_on
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.evolve.search import Candidate, Generation, Score, Search
from bitneat.files import read_capped, write_atomic
from bitneat.network import FloatNetwork, Policy
from bitneat.reproduce.experiments import BETAS, SURVIVAL_THRESHOLDS, Job
from bitneat.reproduce.results import Result, policy_from_data, policy_to_data
from bitneat.sim.environment import inspect
from bitneat.sim.walker.trigonometry import probe_for, refuse_other
from bitneat.sim.walker.vector import STEP_LIMIT, step_limit
from bitneat.state import seal, unseal

WALKER = EnvironmentSpec("BipedalWalker-v3")
HARDCORE = EnvironmentSpec("BipedalWalkerHardcore-v3")
REPORT_EPISODES = 100
"""That score a champion, if the budget does not say otherwise."""
_FLOAT_BYTES = 4
_SNAPSHOTS = 12
"""About so many pictures of the network's growth are kept of a run."""
_MOST_LINKS_KEPT = 5000
_GROWTH_FORMAT = "bitneat-growth"
_MAX_GROWTH_BYTES = 1 << 26


def run(job: Job, folder: Path, results: Mapping[str, Result], command: str) -> Result:
    """Run a job to its end.

    Args:
        job: whose ``after`` are all in ``results``.
        folder: for whatever the run needs to go on.
        results: of other jobs.
        command: that makes this result again.
    """
    if job.group == "quantization":
        return _quantized(job, results, command)
    if job.group == "baselines":
        return _baseline(job, folder, command)
    return _evolved(job, folder, results, command)


def configuration(job: Job, results: Mapping[str, Result]) -> Config:
    """The configuration of a job that evolves; two depend on other jobs' results."""
    config = load_config(_preset(job))
    for section, values in job.overrides.items():
        config = config.with_values(section, **values)
    if job.group == "table" and job.system == "softmax":
        threshold, beta = best_cell(results)
        config = config.with_values("SoftmaxReproduction", survival_threshold=threshold, beta=beta)
    if job.group == "table" and job.system == "bit-gains" and "max_total_steps" not in job.overrides["evolve"]:
        config = config.with_values("evolve", max_total_steps=results[f"bit-{job.seed}"].steps)
    return config


def _preset(job: Job) -> str:
    return job.preset or f"paper-{job.system}"


def mismatch(result: Result, job: Job, results: Mapping[str, Result]) -> str | None:
    """What of a result is not as its job would have it now, if it is another experiment's; None if it is the job's own.

    A result whose configuration follows from others' that are not there is taken as it is.
    """
    if result.heldout["episodes"] != _report_episodes(job):
        return f"was scored over {result.heldout['episodes']} episodes, not {_report_episodes(job)}"
    if job.group == "baselines":
        return None if result.steps >= job.steps else f"took {result.steps} steps, not {job.steps}"
    if job.group == "quantization":
        expected = {"to": job.target, "method": job.method, "source": job.source}
        generations = job.overrides["quantize"]["generations"]
        if dict(result.config) != expected:
            return "quantizes something else, or in another way"
        if (
            job.source is not None
            and job.source in results
            and dict(results[job.source].heldout) != result.notes.get("before")
        ):
            return f"is of another {job.source} than there is now"
        searched = result.notes.get("how", {}).get("generations")
        if job.method == "search" and searched != generations:
            return f"searched for {searched} generations, not {generations}"
        return None
    if not set(job.after) <= set(results):
        return None
    # Parsed, since an option that came later is not in its text, and has the value that it had without being one.
    text = result.config.get("text")
    if not isinstance(text, str):
        return "has no configuration"
    same = parse(text, job.name).text == configuration(job, results).text
    return None if same else "has another configuration"


def best_cell(results: Mapping[str, Result]) -> tuple[float, float]:
    """The survival threshold and beta with the best mean of the scores on which champions are chosen; not the held-out ones."""

    def score(cell: tuple[float, float]) -> float:
        runs = [r for name, r in results.items() if name.startswith(f"grid-{cell[0]:g}-{cell[1]:g}-")]
        return statistics.fmean(r.notes["selection"]["mean"] for r in runs)

    return max(((t, b) for t in SURVIVAL_THRESHOLDS for b in BETAS), key=score)


def _evolved(job: Job, folder: Path, results: Mapping[str, Result], command: str) -> Result:
    runs = RunFolder(folder, lambda text: print(f"bitneat: {text}", file=sys.stderr, flush=True))
    config = configuration(job, results)
    if (folder / "run.json").exists():
        settings = runs.settings()
        if settings.config.text != config.text:
            raise BitneatError(f"{folder}: holds a run with another configuration; remove it")
        refuse_other(settings.trigonometry, str(folder / "run.json"))
    else:
        settings = RunSettings(WALKER, config, job.seed, trigonometry=probe_for(WALKER))
        runs.create(settings)
    info = inspect(WALKER)
    evaluator = NativeWalkerEvaluator(WALKER, STEP_LIMIT, 1)
    check = Recheck(WALKER, info.action, STEP_LIMIT)
    outcome = carry_on(runs, settings, info, evaluator, _Growth(folder), check=check)
    rows = _rows(folder / "history.csv")
    policy = outcome.candidate.controller
    last = rows[-1]
    provenance = outcome.champion.provenance
    return _result(
        job,
        command,
        policy,
        outcome.score,
        config={"preset": _preset(job), "text": settings.config.text},
        episodes=sum(int(row["episodes"]) for row in rows),
        steps=sum(int(row["steps"]) for row in rows),
        generations=len(rows),
        paper_max=float(last["best"]),
        paper_nodes=info.num_inputs + int(last["genome_nodes"]),
        paper_links=int(last["genome_links"]),
        history={
            name: [round(float(row[name]), 2) for row in rows]
            for name in ("best", "mean", "selection", "genome_nodes", "genome_links", "best_links", "steps")
        },
        growth=tuple(_Growth(folder).snapshots()) if job.group == "table" else (),
        notes={"selection": provenance["selection"], "champion_generation": provenance["generation"]},
    )


def _quantized(job: Job, results: Mapping[str, Result], command: str) -> Result:
    from bitneat.champion import FloatChampion
    from bitneat.evolve.quantizing import Arena, Request, quantize

    assert job.source is not None
    source = results[job.source]
    assert source.policy is not None
    network = policy_from_data(source.policy)
    assert isinstance(network, FloatNetwork)
    info = inspect(WALKER)
    evaluator = NativeWalkerEvaluator(WALKER, STEP_LIMIT, 1)
    request = Request(job.target, job.method, 8, job.overrides["quantize"]["generations"], job.seed)
    outcome = quantize(
        FloatChampion(network, info.action, WALKER, {}), request, Arena(WALKER, info, STEP_LIMIT, evaluator)
    )
    controller = outcome.champion.controller
    Recheck(WALKER, info.action, STEP_LIMIT)(_candidate(controller, evaluator))
    seeds = report_seeds(_report_episodes(job))
    score = Score.of(evaluator.evaluate([controller], seeds)[0])
    return _result(
        job,
        command,
        controller,
        score,
        config={"to": job.target, "method": job.method, "source": job.source},
        episodes=0,
        steps=0,
        generations=0,
        notes={"before": dict(source.heldout), "how": dict(outcome.trials[0].candidate.how)},
    )


def _baseline(job: Job, folder: Path, command: str) -> Result:
    from bitneat.baselines import train

    trained = train(job.system, job.steps, job.seed, folder, report_episodes=_report_episodes(job))
    walks = trained.actions is None
    small = trained.links <= _MOST_LINKS_KEPT
    return Result(
        job=job.name,
        group=job.group,
        system=job.system,
        seed=job.seed,
        command=command,
        config={"settings": dict(trained.settings), "versions": dict(trained.versions)},
        heldout=trained.heldout.to_data(),
        hardcore=_score_on(trained.policy, HARDCORE, step_limit(hardcore=True), job).to_data() if walks else None,
        episodes=trained.episodes,
        steps=trained.steps,
        generations=0,
        nodes=trained.nodes,
        links=trained.links,
        packed_bytes=None,
        float_bytes=trained.float_bytes,
        policy=policy_to_data(trained.policy) if walks and small else None,
        notes={"library_held_out": trained.by_library.to_data()},
    )


def _result(job: Job, command: str, policy: Policy, score: Score, **entries: Any) -> Result:
    if isinstance(policy, FloatNetwork):
        packed = None
        numbers = policy.num_links + sum(node.bias != 0 for node in policy.nodes)
        float_bytes = _FLOAT_BYTES * numbers
    else:
        packed, float_bytes = len(pack(policy)), None
    return Result(
        job=job.name,
        group=job.group,
        system=job.system,
        seed=job.seed,
        command=command,
        heldout=score.to_data(),
        hardcore=_score_on(policy, HARDCORE, step_limit(hardcore=True), job).to_data(),
        nodes=len(policy.nodes),
        links=policy.num_links,
        packed_bytes=packed,
        float_bytes=float_bytes,
        policy=policy_to_data(policy),
        **entries,
    )


def _score_on(policy: Policy, spec: EnvironmentSpec, max_steps: int, job: Job) -> Score:
    evaluator = NativeWalkerEvaluator(spec, max_steps, 1)
    return Score.of(evaluator.evaluate([policy], report_seeds(_report_episodes(job)))[0])


def _report_episodes(job: Job) -> int:
    """Episodes that score a champion."""
    entries = [section["report_episodes"] for section in job.overrides.values() if "report_episodes" in section]
    return int(entries[0]) if entries else REPORT_EPISODES


def _candidate(policy: Policy, evaluator: Evaluator) -> Candidate:
    from bitneat.evolve.randomness import selection_seeds

    (episodes,) = evaluator.evaluate([policy], selection_seeds(1))
    return Candidate(policy, 0, tuple(episode.reward for episode in episodes))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        raise BitneatError(f"{path}: holds no generation")
    return rows


def _is_snapshot(entry: Any) -> bool:
    return isinstance(entry, dict) and set(entry) == {"generation", "policy"} and type(entry["generation"]) is int


class _Growth:
    """Keeps the best candidate so far at some generations, while a run goes on."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "growth.json"
        self._every = 1

    def snapshots(self) -> list[dict[str, Any]]:
        """What was kept, generations rising."""
        if not self._path.exists():
            return []
        data = unseal(read_capped(self._path, _MAX_GROWTH_BYTES, regular=True), str(self._path), required=False)
        kept = data.get("snapshots") if isinstance(data, dict) else data  # before there was a seal, the list alone
        if not isinstance(kept, list) or not all(_is_snapshot(entry) for entry in kept):
            raise BitneatError(f"{self._path}: damaged: expected snapshots; remove {self._path.parent} to run it again")
        return kept

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Choose the distance between pictures; take the one that a run lacks which was killed just before it."""
        del seconds
        self._every = max(1, min(generations, 300) // _SNAPSHOTS)
        if search.candidates:
            self._take(search.generation - 1, search.candidates[0])

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Take a picture now and then."""
        if best is not None:
            self._take(row.generation, best)

    def _take(self, generation: int, best: Candidate) -> None:
        if generation % self._every == 0:
            kept = [entry for entry in self.snapshots() if entry["generation"] < generation]
            snapshot = {"generation": generation, "policy": policy_to_data(best.controller)}
            write_atomic(self._path, seal({"format": _GROWTH_FORMAT, "snapshots": [*kept, snapshot]}))

    def choosing(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing to do."""
