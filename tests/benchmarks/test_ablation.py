# SPDX-License-Identifier: MIT
"""The ablation's runs and table; the runs themselves take hours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest

from benchmarks.ablation import FINAL_EPISODES, SEEDS, STEPS, VARIANTS, Walks, jobs, scored, steps_to, table, walks
from bitneat.controller import Constant, Controller, Input, Link, Node, Signal
from bitneat.evolve.config import load
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.network import Policy
from bitneat.reproduce.results import Result, policy_to_data
from bitneat.reproduce.running import WALKER, configuration
from bitneat.sim.environment import EpisodeResult, Shaping

CONTROLLER = Controller((Input(),), (Node((Link(0),)),), (Signal(1),))


def test_each_variant_differs_from_the_preset_in_what_it_names_and_has_the_same_steps() -> None:
    preset = load("bipedalwalker").with_values(
        "evolve", generations=100_000, max_total_steps=STEPS, final_episodes=FINAL_EPISODES
    )
    seen = set()
    for job in jobs():
        config = configuration(job, {})
        entries = VARIANTS[job.system][1]
        expected = preset
        for section, values in entries.items():
            expected = expected.with_values(section, **values)
        assert config.text == expected.text, job.name
        changed = [line for line in config.text.splitlines() if line not in preset.text.splitlines()]
        assert len(changed) == sum(map(len, entries.values())), "an entry that the preset has already"
        seen.add((job.system, job.seed))
        assert config["evolve"]["max_total_steps"] == 50_000_000
    assert seen == {(name, seed) for name in VARIANTS for seed in SEEDS}


def result(system: str, seed: int, selection: list[float], generations: int = 170) -> Result:
    score = {"episodes": 100, "mean": 0.0, "std": 1.0, "min": 0.0, "max": 400.0}
    history = {"steps": [10e6] * len(selection), "selection": selection}
    config = {"text": "[evolve]\nlinear_generations = 150\n"}
    return Result(
        job=f"{system}-{seed}", group="ablation", system=system, seed=seed, command="", config=config, heldout=score,
        hardcore=None, episodes=1, steps=1, generations=generations, nodes=1, links=1, packed_bytes=100 + seed, float_bytes=None,
        history=history, policy=policy_to_data(CONTROLLER),
    )  # fmt: skip


def walks_of(mean: float, falls: int = 0) -> Walks:
    return Walks("", 1000, mean, 1.0, falls)


def test_the_table_orders_variants_by_what_they_have_more_than_the_preset_with_the_same_seed() -> None:
    runs = [
        result("all", 1, [0.0, 290.0]),
        result("all", 2, [100.0, 200.0, 301.0]),
        result("all", 3, [300.0]),
        result("risk", 1, [1.0], generations=140),
        result("restarts", 2, [1.0]),
        result("delays", 3, [1.0]),
    ]
    means = {"all-1": 280.0, "all-2": 310.0, "all-3": 305.0, "risk-1": 312.5, "restarts-2": 309.0}
    scores = {name: walks_of(mean, falls=int(mean - 270)) for name, mean in means.items()}
    lines = table({run.job: run for run in runs}, scores).splitlines()
    rows = {line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[3:-1]] for line in lines[2:]}
    assert list(rows) == ["`risk`", "`all`", "`restarts`"], "what has not been scored is not there"
    assert rows["`risk`"] == ["312.5", "+32.5", "4.2", "0", "-", "101"]
    assert rows["`restarts`"] == ["?, 309.0", "-1.0", "?, 3.9", "?, 20", "?, -", "102"]
    assert rows["`all`"] == ["280.0, 310.0, 305.0", "", "1.0, 4.0, 3.5", "20, 20, 20", "-, 30 M, 10 M", "102"]


class Walked:
    """Every third walk falls: -100 of 40."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, ...]] = []

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        assert shaping is not None
        self.calls.append(tuple(seeds))
        fallen = shaping.fall_value - shaping.fall_reward
        falls = [i % 3 == 0 for i in range(len(seeds))]
        walk, fall = EpisodeResult(300.0, 300.0, 9, True, False), EpisodeResult(40.0, 40.0 + fallen, 9, True, False)
        return [[fall if falls_now else walk for falls_now in falls] for _ in controllers]

    def close(self) -> None:
        pass


def test_champions_walk_in_episodes_that_their_runs_did_not_report_and_once_only(tmp_path: Path) -> None:
    file, evaluator = tmp_path / "scores.json", Walked()
    first = scored({"all-1": result("all", 1, [])}, file, evaluator)
    assert (first["all-1"].falls, first["all-1"].episodes) == (334, 1000)
    assert first["all-1"].mean == pytest.approx(300.0 - 260.0 * 0.334)
    assert evaluator.calls == [tuple(report_seeds(1100)[100:])]
    both = scored({"all-1": result("all", 1, []), "risk-1": result("risk", 1, [])}, file, evaluator)
    assert both == {"all-1": first["all-1"], "risk-1": first["all-1"]}
    assert len(evaluator.calls) == 2
    other = replace(CONTROLLER, outputs=(Signal(0),))
    scored({"all-1": replace(result("all", 1, []), policy=policy_to_data(other))}, file, evaluator)
    assert len(evaluator.calls) == 3, "another controller"


def test_real_falls_are_counted() -> None:
    stiff = Controller(tuple(Input() for _ in range(24)), (), tuple(Constant(256 * sign) for sign in (1, -1, -1, 1)))
    found = walks(stiff, NativeWalkerEvaluator(WALKER, 120, 1))
    plain = NativeWalkerEvaluator(WALKER, 120, 1).evaluate([stiff], report_seeds(1100)[100:])[0]
    assert found.falls == sum(episode.terminated for episode in plain)
    assert 0 < found.falls < 1000
    assert found.mean == pytest.approx(fmean(episode.reward for episode in plain))


def test_steps_are_counted_up_to_the_generation_that_reaches_the_score() -> None:
    assert steps_to({"steps": [5.0, 7.0, 9.0], "selection": [1.0, 300.0, 400.0]}, 300.0) == 12.0
    assert steps_to({"steps": [5.0], "selection": [1.0]}, 300.0) is None
