# SPDX-License-Identifier: MIT
"""`bitneat evolve` on one core, against a loop that does nothing but step Gymnasium's BipedalWalker-v3."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium

from bitneat.bench.measurement import Measurement, seconds_of
from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, Controller, Encoder
from bitneat.evolve.config import load, preset_for
from bitneat.evolve.evaluation import Evaluator, GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.evolve.search import Search
from bitneat.network import Policy
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import EpisodeResult, Shaping, inspect

GOAL = 0.85
_ENVIRONMENT = EnvironmentSpec("BipedalWalker-v3")
_POPULATION = {"native": 50, "gymnasium": 12}
"""Small, since the replay in Gymnasium takes nearly all the time; smaller still where our side takes as long."""
_SELECTION_EPISODES = 3
"""As much fewer than the preset's as the population is smaller; on walkers that stand they would outweigh the race."""

_Actions: TypeAlias = list[Any]


class _Diary:
    """An evaluator that does what another does, and notes which controller walked how far on which seed."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self.episodes: list[tuple[Controller, int, int]] = []

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        results = self._evaluator.evaluate(controllers, seeds, shaping)
        for controller, episodes in zip(controllers, results, strict=True):
            assert isinstance(controller, Controller)  # the preset's genome has no float weights
            self.episodes += [(controller, seed, result.steps) for seed, result in zip(seeds, episodes, strict=True)]
        return results

    def close(self) -> None:
        self._evaluator.close()


def measure(repetitions: int) -> list[Measurement]:
    """Measure whole generations, with their breeding and checkpoints, against the very same episodes replayed bare."""
    return [
        _measure("native", "evolve on BipedalWalker-v3, one worker", repetitions, GOAL),
        _measure("gymnasium", "the same with --simulator gymnasium", repetitions),
    ]


def _measure(simulator: str, what: str, repetitions: int, goal: float | None = None) -> Measurement:
    info = inspect(_ENVIRONMENT)
    config = load(preset_for(_ENVIRONMENT)).with_values("NEAT", pop_size=_POPULATION[simulator])
    # Generations of NEAT are what is measured, from a random population: its walkers fall or stand.
    config = config.with_values("evolve", selection_episodes=_SELECTION_EPISODES, linear_generations=0)
    search = Search(config, _ENVIRONMENT, info, seed=1)
    evaluator: Evaluator = (
        NativeWalkerEvaluator(_ENVIRONMENT, search.max_steps, 1)
        if simulator == "native"
        else GymnasiumEvaluator(_ENVIRONMENT, info.action, search.max_steps, 1, simulator)
    )
    diary = _Diary(evaluator)
    bare = gymnasium.make(_ENVIRONMENT.id)
    ours, baseline = [], []
    with tempfile.TemporaryDirectory() as temporary:
        folder = RunFolder(Path(temporary) / "run")
        folder.create(RunSettings(_ENVIRONMENT, config, 1))

        def generation() -> None:
            search.advance(diary)
            folder.save_checkpoint(search)
            folder.save_history(search)

        generation()  # compiles, loads, and starts from nothing
        for _ in range(repetitions):
            diary.episodes.clear()
            seconds = seconds_of(generation)
            steps = sum(count for _, _, count in diary.episodes)
            replay = [
                (seed, _actions(controller, info.action, seed, count)) for controller, seed, count in diary.episodes
            ]
            ours.append(steps / seconds)
            baseline.append(steps / seconds_of(partial(_step_only, bare, replay)))
    ratio = statistics.median(own / other for own, other in zip(ours, baseline, strict=True))
    return Measurement(
        what,
        statistics.median(ours),
        "the same episodes in a bare Gymnasium loop, no policy",
        statistics.median(baseline),
        "steps/s",
        ratio,
        "times as fast",
        "" if goal is None else f">= {goal}",
        None if goal is None else ratio >= goal,
    )


def _actions(controller: Controller, action: Action, seed: int, steps: int) -> _Actions:
    """What the controller does in its first ``steps`` steps; not timed."""
    encoder = Encoder(controller)
    policy = RuntimeController(controller)
    environment = gymnasium.make(_ENVIRONMENT.id)
    policy.reset()
    observation, _ = environment.reset(seed=seed)
    actions: _Actions = []
    for _ in range(steps):
        actions.append(action.decode(policy.step(encoder(observation)), controller.frac_bits))
        observation, *_ = environment.step(actions[-1])
    return actions


def _step_only(environment: gymnasium.Env[Any, Any], episodes: list[tuple[int, _Actions]]) -> None:
    for seed, actions in episodes:
        environment.reset(seed=seed)
        for action in actions:
            environment.step(action)
