# SPDX-License-Identifier: MIT
"""Episode seeds from generation to generation, and new populations from the best candidates when nothing gets better."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Constant
from bitneat.errors import BitneatError
from bitneat.evolve.config import parse
from bitneat.evolve.run_folder import RunFolder
from bitneat.evolve.search import Search
from bitneat.network import Policy
from bitneat.sim.environment import EpisodeResult, Shaping, inspect
from tests.evolve.test_run import SMALL, evolve, settings_for, stop_after

CARTPOLE = EnvironmentSpec("CartPole-v1")
SELECTION = 2**30


class Flat:
    """Everybody with no constant output earns the same; remembers which controllers ran on which seeds of the race."""

    def __init__(self, constant: float = 0.0) -> None:
        self.constant = constant
        """What those with a constant output earn."""
        self.races: list[tuple[list[str], tuple[int, ...]]] = []

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        del shaping
        if seeds[0] < SELECTION:
            self.races.append(([controller.sha256 for controller in controllers], tuple(seeds)))
        rewards = [
            self.constant if any(isinstance(output, Constant) for output in controller.outputs) else 1.0
            for controller in controllers
        ]
        return [[EpisodeResult(reward, reward, 5, True, False) for _ in seeds] for reward in rewards]

    def close(self) -> None:
        pass


def search(**settings: object) -> Search:
    text = SMALL.replace("race_episodes = 1 2\nrace_fractions = 1 0.3", "race_episodes = 2\nrace_fractions = 1")
    config = parse(text, "test").with_values("evolve", **settings)
    return Search(config, CARTPOLE, inspect(CARTPOLE), 5)


def test_seeds_are_new_in_every_generation_or_the_first_ones_again() -> None:
    for new_seeds, different in ((1, 4), (0, 1)):
        landscape = Flat()
        going = search(new_seeds=new_seeds)
        for _ in range(4):
            going.advance(landscape)
        assert len({seeds for _, seeds in landscape.races}) == different
    first_of_a_usual_run = Flat()
    search().advance(first_of_a_usual_run)
    assert landscape.races[0][1] == first_of_a_usual_run.races[0][1]


def keys(going: Search) -> set[int]:
    return set(going.population.population)


def test_a_search_that_stands_still_is_bred_anew_from_its_candidates() -> None:
    going, landscape = search(restart_after=3, generations=100), Flat()
    last = 0
    restarts = []
    for done in range(1, 13):
        before = keys(going)
        going.advance(landscape)
        # A candidate that is as good and smaller is better, too. Elites keep their keys but for the restarts.
        if done - max(last, going.candidates[0].generation) >= 3:
            last = done
            restarts.append(done)
            assert not before & keys(going), done
            best = {candidate.controller.sha256 for candidate in going.candidates[:2]}
            lowered = [going.kind.lower(genome)[0].sha256 for genome in going.population.population.values()]
            assert set(lowered[: len(best)]) == best
            assert len(set(lowered)) > len(lowered) / 2, "mutants of the candidates"
        else:
            assert before & keys(going), done
    assert restarts


def test_candidates_that_no_genome_is_like_make_room_for_a_population_from_nothing() -> None:
    going, landscape = search(restart_after=2, generations=100), Flat(constant=9.0)
    before = keys(going)
    while before & keys(going):
        before = keys(going)
        going.advance(landscape)
        assert going.generation < 20
    assert all(any(isinstance(o, Constant) for o in c.controller.outputs) for c in going.candidates[:2])
    assert len(keys(going)) == 14
    going.advance(landscape)


def test_without_restart_after_there_is_no_restart() -> None:
    going, landscape = search(generations=100), Flat()
    for _ in range(9):
        before = keys(going)
        going.advance(landscape)
        assert before & keys(going)


def test_patience_is_for_what_is_bred_after_the_linear_start() -> None:
    class Fading(Flat):
        """No candidate is as good as the one before."""

        def evaluate(
            self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
        ) -> list[list[EpisodeResult]]:
            if seeds[0] >= SELECTION:
                self.constant -= 1.0
                return [
                    [EpisodeResult(self.constant, self.constant, 5, True, False) for _ in seeds] for _ in controllers
                ]
            return super().evaluate(controllers, seeds, shaping)

    going, landscape = search(restart_after=3, linear_generations=8, generations=100), Fading()
    while going.starting:
        going.advance(landscape)
    kept = []
    for _ in range(4):
        before = keys(going)
        going.advance(landscape)
        kept.append(bool(before & keys(going)))
    assert going.candidates[0].generation == 0
    assert kept == [True, True, False, True], "a new population after three generations of NEAT, and not before"


def test_a_candidate_has_the_number_of_the_generation_that_it_led() -> None:
    going, landscape = search(linear_generations=3, generations=100), Flat()
    known: set[str] = set()
    for _ in range(6):
        row = going.advance(landscape)
        new = [candidate for candidate in going.candidates if candidate.controller.sha256 not in known]
        known.update(candidate.controller.sha256 for candidate in new)
        assert {candidate.generation for candidate in new} <= {row.generation}
    assert len(known) >= 4


@pytest.mark.parametrize("generation", [1, 2, 3])
def test_a_run_with_restarts_resumes_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, generation: int
) -> None:
    text = SMALL.replace("[evolve]", "[evolve]\nrestart_after = 1\nnew_seeds = 0")
    whole, stopped = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "stopped")
    evolve(whole, settings_for(text=text))
    with monkeypatch.context() as patch:
        stop_after(generation, patch)
        with pytest.raises(KeyboardInterrupt):
            evolve(stopped, settings_for(text=text))
    evolve(stopped, stopped.settings(), new=False)
    for name in ("champion.pkl", "history.csv", "checkpoints/generation-000004.json"):
        assert (stopped.path / name).read_bytes() == (whole.path / name).read_bytes(), name


def test_restarts_are_for_genomes_that_a_controller_becomes() -> None:
    text = (
        "[evolve]\nrestart_after = 3\n[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction\n"
        "[PlainGenome]\nweights = ternary\nweight_mutate_rate = 0\n"
    )
    with pytest.raises(BitneatError, match=r"\[evolve\] restart_after: restarts are for BitGenome"):
        parse(text, "test")
