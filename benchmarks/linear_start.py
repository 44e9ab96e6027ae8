# SPDX-License-Identifier: MIT
"""The linear start that runs with the same seed have in common, computed once.

What it does depends on few entries of the configuration, and takes 20 million steps. A run that begins from its checkpoint comes to
the same bytes as one that computes it (a test compares them).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.evolve.config import Config, parse
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.run import searching
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.evolve.search import Search
from bitneat.files import read_capped, write_atomic
from bitneat.sim.environment import inspect

_DECIDING = (
    "frac_bits",
    "input_scales",
    "input_limits",
    "max_steps",
    "fall_reward",
    "selection_episodes",
    "finalists",
    "linear_population",
    "linear_episodes",
    "linear_walks_at",
)
_PARTS = ("linear", "candidates", "history")
"""What of a search's state the linear start changes; the rest comes with its last generation."""
_MAX_BYTES = 1 << 26


@dataclass(frozen=True)
class LinearStart:
    """All but the last generation of a linear start."""

    config: Config
    seed: int
    parts: Mapping[str, Any]

    @property
    def generations(self) -> int:
        """How many are completed."""
        return len(self.parts["history"])

    def serves(self, config: Config, seed: int) -> bool:
        """Whether a run's linear start begins with these very generations."""
        ours, theirs = self.config["evolve"], config["evolve"]
        same = all(ours[key] == theirs[key] for key in _DECIDING)
        return same and seed == self.seed and theirs["linear_generations"] > self.generations

    def begin(self, folder: Path, settings: RunSettings) -> None:
        """Make the folder of a run that goes on from here."""
        runs = RunFolder(folder)
        runs.create(settings)
        search = searching(runs, settings, inspect(settings.environment))
        search.restore({**search.to_data(), **self.parts})
        runs.save_checkpoint(search)


def linear_start(file: Path, spec: EnvironmentSpec, config: Config, seed: int, evaluator: Evaluator) -> LinearStart:
    """Read it from ``file`` if it is there, else compute it and write it there.

    Raises:
        BitneatError: if the file is of another start.
    """
    if file.exists():
        data = json.loads(read_capped(file, _MAX_BYTES))
        start = LinearStart(parse(data["config"], str(file)), data["seed"], data["parts"])
        if not start.serves(config, seed):
            raise BitneatError(f"{file}: is of another configuration; remove it")
        return start
    search = Search(config, spec, inspect(spec), seed, ())
    for _ in range(config["evolve"]["linear_generations"] - 1):
        search.advance(evaluator)
    state = search.to_data()
    parts = {name: state[name] for name in _PARTS}
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(file, json.dumps({"config": config.text, "seed": seed, "parts": parts}).encode())
    return LinearStart(config, seed, parts)
