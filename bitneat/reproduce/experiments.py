# SPDX-License-Identifier: MIT
"""What runs: every experiment as data, for each of the budgets.

The paper's budget is 200 genomes, 300 generations and 5 episodes each. "A tenth" is the same with a tenth of the generations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Overrides = Mapping[str, Mapping[str, Any]]

SYSTEMS = ("default", "int", "bit", "bit-flips", "bit-gains", "softmax", "wann")
"""Those that evolve; the preset of each is ``paper-SYSTEM``."""
BASELINES = ("ars", "ppo", "dqn")
BETAS = (0.005, 0.03, 0.09)
SURVIVAL_THRESHOLDS = (1.0, 0.5, 0.1)
SCENARIOS = (1, 3, 5, 10)
QUANTIZATIONS = (
    ("int", "round"),
    ("int", "gains"),
    ("ternary", "round"),
    ("ternary", "twn"),
    ("ternary", "gains"),
    ("ternary", "search"),
)
"""(target, method) of `bitneat quantize`, for each champion of the float genome and for ARS's policy."""


@dataclass(frozen=True)
class Job:
    """One run. Its name is unique and says what it is."""

    name: str
    group: str
    """``table``, ``grid``, ``scenarios``, ``quantization`` or ``baselines``."""
    system: str
    seed: int
    overrides: Overrides = field(default_factory=dict)
    """Of the preset's configuration, by section."""
    after: tuple[str, ...] = ()
    """Jobs whose results this one needs."""
    source: str | None = None
    """Of a quantization: the job whose champion it takes."""
    target: str = ""
    method: str = ""
    steps: int = 0
    """Of a baseline: the budget in steps."""
    preset: str = ""
    """Of what evolves: the preset, if not ``paper-SYSTEM``."""


@dataclass(frozen=True)
class Budget:
    """How much of everything."""

    name: str
    population: int
    generations: int
    """Of the systems in the table."""
    seeds: Mapping[str, int]
    """Runs of each system."""
    small_generations: int
    """Of the grid, the scenarios, and systems that get a tenth."""
    small_seeds: int
    gains_steps: int | None
    """Steps of a run of bit-gains; None for as many as the run of ``bit`` with the same seed took."""
    linear_generations: int
    baseline_steps: Mapping[str, int]
    search_generations: int
    """Of the quantization by search."""
    episodes: Mapping[str, int]
    """Entries of [evolve] that say how many episodes choose and score champions, where not as in the presets."""


BUDGETS: Mapping[str, Budget] = {
    "paper": Budget(
        name="paper",
        population=200,
        generations=300,
        seeds={"default": 3, "int": 1, "bit": 3, "bit-gains": 3, "softmax": 1, "wann": 1},
        small_generations=30,
        small_seeds=3,
        gains_steps=None,
        linear_generations=150,
        baseline_steps={"ars": 20_000_000, "ppo": 5_000_000, "dqn": 1_000_000},
        search_generations=20,
        episodes={},
    ),
    "hour": Budget(
        name="hour",
        population=200,
        generations=30,
        seeds={"default": 1, "int": 1, "bit": 1, "bit-gains": 1, "softmax": 1, "wann": 1},
        small_generations=8,
        small_seeds=1,
        gains_steps=60_000_000,
        linear_generations=120,
        baseline_steps={"ars": 2_000_000, "ppo": 500_000, "dqn": 100_000},
        search_generations=5,
        episodes={},
    ),
    "smoke": Budget(
        name="smoke",
        population=20,
        generations=4,
        seeds={"default": 1, "int": 1, "bit": 1, "bit-gains": 1, "softmax": 1, "wann": 1},
        small_generations=2,
        small_seeds=1,
        gains_steps=450_000,
        linear_generations=2,
        baseline_steps={"ars": 3_000, "ppo": 3_000, "dqn": 1_000},
        search_generations=1,
        episodes={"selection_episodes": 4, "final_episodes": 4, "report_episodes": 10},
    ),
}

_FULL_GENERATIONS = 300
_WANN_GENERATIONS = 250
"""A weight-agnostic genome takes six episodes, the others five."""


def jobs(budget: Budget) -> list[Job]:
    """Every run of a budget; what others need comes before them."""
    return [*_table(budget), *_grid(budget), *_scenarios(budget), *_baselines(budget), *_quantizations(budget)]


def _evolve(budget: Budget, generations: int, **more: Any) -> dict[str, dict[str, Any]]:
    evolve = {**budget.episodes, "generations": generations, **more}
    return {"evolve": evolve, "NEAT": {"pop_size": budget.population}}


def _table(budget: Budget) -> list[Job]:
    found = []
    for system, count in budget.seeds.items():
        for seed in range(1, count + 1):
            generations = budget.generations
            after: tuple[str, ...] = ()
            more: dict[str, Any] = {}
            if system == "wann":
                generations = max(1, budget.generations * _WANN_GENERATIONS // _FULL_GENERATIONS)
            elif system == "bit-gains":
                # Its steps end it, not its generations.
                generations = 100_000
                more = {"linear_generations": budget.linear_generations}
                if budget.gains_steps is None:
                    after = (f"bit-{seed}",)
                else:
                    more["max_total_steps"] = budget.gains_steps
            elif system == "softmax":
                after = tuple(job.name for job in _grid(budget))
            found.append(
                Job(f"{system}-{seed}", "table", system, seed, _evolve(budget, generations, **more), tuple(after))
            )
    for seed in range(1, budget.small_seeds + 1):
        name = f"bit-flips-{seed}"
        found.append(Job(name, "table", "bit-flips", seed, _evolve(budget, budget.small_generations)))
    return found


def _grid(budget: Budget) -> list[Job]:
    found = []
    for threshold in SURVIVAL_THRESHOLDS:
        for beta in BETAS:
            for seed in range(1, budget.small_seeds + 1):
                overrides = _evolve(budget, budget.small_generations)
                overrides["SoftmaxReproduction"] = {"beta": beta, "survival_threshold": threshold}
                found.append(Job(f"grid-{threshold:g}-{beta:g}-{seed}", "grid", "softmax", seed, overrides))
    return found


def _scenarios(budget: Budget) -> list[Job]:
    """As many episodes in all for each number of scenarios: fewer of them mean more generations."""
    found = []
    for count in SCENARIOS:
        for seed in range(1, budget.small_seeds + 1):
            generations = max(1, budget.small_generations * 5 // count)
            overrides = _evolve(budget, generations, race_episodes=(count,))
            found.append(Job(f"scenarios-{count}-{seed}", "scenarios", "bit", seed, overrides))
    return found


def _quantizations(budget: Budget) -> list[Job]:
    found = [
        _quantize(budget, f"ptq-{target}", f"default-{seed}", target=target, method=method, seed=seed)
        for seed in range(1, budget.seeds["default"] + 1)
        for target, method in QUANTIZATIONS
    ]
    # ARS's policy walks, whatever the float genome came to.
    return [
        *found,
        *(
            _quantize(budget, f"ars-{target}", "ars-0", target=target, method=method, seed=0)
            for target, method in QUANTIZATIONS
        ),
    ]


def _quantize(budget: Budget, system: str, source: str, *, target: str, method: str, seed: int) -> Job:
    return Job(
        f"{system}-{method}-{seed}", "quantization", system, seed,
        overrides={"quantize": {"generations": budget.search_generations, **budget.episodes}},
        after=(source,), source=source, target=target, method=method,
    )  # fmt: skip


def _baselines(budget: Budget) -> list[Job]:
    return [
        Job(f"{system}-0", "baselines", system, 0, overrides={"baseline": dict(budget.episodes)}, steps=steps)
        for system, steps in budget.baseline_steps.items()
    ]
