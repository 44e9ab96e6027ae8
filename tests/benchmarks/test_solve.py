# SPDX-License-Identifier: MIT
"""When a search counts as solved, and what the page says of it; the searches themselves take minutes."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.solve import Trials, table
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.evolve.randomness import report_seeds
from bitneat.network import Policy
from bitneat.sim.environment import EpisodeResult, Shaping

CONTROLLER = Controller((Input(),), (Node((Link(0),)),), (Signal(1),))


class Recorded:
    """Gives the rewards that it was made with, a call each, and remembers the seeds."""

    def __init__(self, rewards: Sequence[float]) -> None:
        self._rewards = list(rewards)
        self.seeds: list[int] = []

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        assert len(controllers) == 1
        assert shaping is None
        self.seeds += seeds
        reward = self._rewards.pop(0)
        return [[EpisodeResult(reward, reward, 9, True, False) for _ in seeds]]

    def close(self) -> None:
        pass


def run(seed: int, minutes: float, *, solved: bool = True) -> dict[str, object]:
    score = {"episodes": 1000, "mean": 301.0, "std": 2.0, "min": 250.0, "max": 305.0}
    return {
        "seed": seed, "threads": 2, "solved": solved, "seconds": 60.0 * minutes, "steps": 80_000_000, "generations": 190,
        "trials": 3, "selection": 302.0, "score": score, "packed_bytes": 150,
    }  # fmt: skip


def test_a_leader_passes_with_300_in_both_trials_and_no_episode_serves_twice() -> None:
    evaluator = Recorded([300.0, 299.9, 299.0, 300.0, 300.0])
    trials = Trials(evaluator)
    assert not trials.passed(CONTROLLER), "299.9 in the second"
    assert not trials.passed(CONTROLLER), "299 in the first, so that there is no second"
    assert trials.passed(CONTROLLER)
    assert trials.count == 3
    assert len(evaluator.seeds) == 1100 + 100 + 1100 == len(set(evaluator.seeds))
    assert not set(evaluator.seeds) & set(report_seeds(1100)), "on which champions and the ablation are scored"


def test_the_median_counts_what_was_not_solved_as_longest_and_is_the_higher_of_two() -> None:
    assert table([run(1, 5.0), run(2, 9.0), run(3, 7.0)]).endswith("Median of the 3 runs, 2 threads: 7.0 minutes.\n")
    assert table([run(1, 5.0), run(2, 9.0)]).endswith("Median of the 2 runs, 2 threads: 9.0 minutes.\n")
    one_failed = table([run(1, 5.0), run(2, 30.1, solved=False)])
    assert one_failed.endswith("threads: none: too few runs were solved.\n")
    few = [run(1, 5.0), run(2, 30.1, solved=False), run(3, 8.0, solved=False)]
    assert table(few).endswith("none: too few runs were solved.\n")
    assert "| 2 | not in 30.1 | 80 M | 190 | 3 | 301.0 ± 2.0 | 150 |" in one_failed
