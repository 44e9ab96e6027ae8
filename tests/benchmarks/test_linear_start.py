# SPDX-License-Identifier: MIT
"""A run that begins from a shared linear start comes to the same bytes as one that computes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.linear_start import LinearStart, linear_start
from bitneat.errors import BitneatError
from bitneat.evolve.config import load
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.evolve.run import carry_on
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.reproduce.running import WALKER, _Growth
from bitneat.sim.environment import inspect

PRESET = load("bipedalwalker").with_values(
    "evolve", generations=6, linear_generations=4, linear_population=8, linear_episodes=1, race_episodes=(1,),
    race_fractions=(1.0,), selection_episodes=2, final_episodes=2, report_episodes=2, max_steps=120,
)  # fmt: skip
PRESET = PRESET.with_values("NEAT", pop_size=10)


def test_a_variant_ends_in_the_same_bytes_from_the_shared_start(tmp_path: Path) -> None:
    evaluator = NativeWalkerEvaluator(WALKER, 120, 1)
    start = linear_start(tmp_path / "start.json", WALKER, PRESET, 3, evaluator)
    assert start == linear_start(tmp_path / "start.json", WALKER, PRESET, 3, evaluator), "read again"
    assert start.generations == 3
    variants = [
        PRESET.with_values("NEAT", pop_size=14),
        PRESET.with_values("BitGenome", mutations=4.0, mutate_gain=0.0),
        PRESET.with_values("evolve", linear_generations=5, stall_steps=50, risk=1.0),
    ]
    for number, config in enumerate(variants):
        assert start.serves(config, 3)
        settings = RunSettings(WALKER, config, 3)
        alone, shared = tmp_path / f"alone-{number}", tmp_path / f"shared-{number}"
        RunFolder(alone).create(settings)
        start.begin(shared, settings)
        for folder in (alone, shared):
            carry_on(RunFolder(folder), settings, inspect(WALKER), evaluator, _Growth(folder))
        files = [path.relative_to(alone) for path in sorted(alone.rglob("*")) if path.is_file()]
        assert {"champion.json", "history.csv", "report.json"} <= {path.name for path in files}
        for file in files:
            if file.name != "growth.json":
                assert (alone / file).read_bytes() == (shared / file).read_bytes(), file


def test_a_start_serves_only_runs_that_begin_with_it(tmp_path: Path) -> None:
    start = LinearStart(PRESET, 3, {"history": [[]] * 3})
    assert not start.serves(PRESET, 4)
    assert not start.serves(PRESET.with_values("evolve", linear_generations=3), 3)
    for key, value in (("linear_population", 16), ("fall_reward", -50.0), ("frac_bits", 7), ("selection_episodes", 3)):
        assert not start.serves(PRESET.with_values("evolve", **{key: value}), 3), key


def test_another_start_in_the_file_is_refused(tmp_path: Path) -> None:
    evaluator = NativeWalkerEvaluator(WALKER, 120, 1)
    linear_start(tmp_path / "start.json", WALKER, PRESET, 3, evaluator)
    with pytest.raises(BitneatError, match=r"start\.json: is of another configuration"):
        linear_start(tmp_path / "start.json", WALKER, PRESET, 4, evaluator)
