# SPDX-License-Identifier: MIT
"""The ablation's runs and table; the runs themselves take hours."""

from __future__ import annotations

from benchmarks.ablation import SEEDS, STEPS, VARIANTS, jobs, steps_to, table
from bitneat.evolve.config import load
from bitneat.reproduce.results import Result
from bitneat.reproduce.running import configuration


def test_each_variant_differs_from_the_preset_in_what_it_names_and_has_the_same_steps() -> None:
    preset = load("bipedalwalker").with_values("evolve", generations=100_000, max_total_steps=STEPS)
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


def result(system: str, seed: int, mean: float, selection: list[float]) -> Result:
    score = {"episodes": 100, "mean": mean, "std": 1.0, "min": 0.0, "max": 400.0}
    history = {"steps": [10e6] * len(selection), "selection": selection}
    return Result(
        job=f"{system}-{seed}", group="ablation", system=system, seed=seed, command="", config={}, heldout=score,
        hardcore=None, episodes=1, steps=1, generations=3, nodes=1, links=1, packed_bytes=100 + seed, float_bytes=None,
        history=history,
    )  # fmt: skip


def test_the_table_orders_variants_by_their_median_and_compares_with_the_preset() -> None:
    runs = [
        result("all", 1, 290.0, [0.0, 290.0]),
        result("all", 2, 310.0, [100.0, 200.0, 301.0]),
        result("all", 3, 305.0, [300.0]),
        result("risk", 1, 312.5, [1.0]),
    ]
    lines = table({run.job: run for run in runs}).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["`risk`", "`all`"]
    assert lines[2].endswith("| 312.5 | 312.5 | +7.5 | - | 101 |")
    assert lines[3].endswith("| 305.0 | 290.0, 310.0, 305.0 |  | 30 M, 10 M | 102 |")


def test_steps_are_counted_up_to_the_generation_that_reaches_the_score() -> None:
    assert steps_to({"steps": [5.0, 7.0, 9.0], "selection": [1.0, 300.0, 400.0]}, 300.0) == 12.0
    assert steps_to({"steps": [5.0], "selection": [1.0]}, 300.0) is None
