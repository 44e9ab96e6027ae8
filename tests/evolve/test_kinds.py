# SPDX-License-Identifier: MIT
"""Runs of every kind of genome and reproduction: they resume to the same bytes, and stop and start as they are told."""

from __future__ import annotations

import json
import math
import random
import statistics
from pathlib import Path

import numpy as np
import pytest
from neat.innovation import InnovationTracker

from bitneat.champion import EnvironmentSpec, FloatChampion, load_any
from bitneat.controller import Constant, Controller, Input
from bitneat.errors import BitneatError
from bitneat.evolve.config import load, parse
from bitneat.evolve.evaluation import GymnasiumEvaluator
from bitneat.evolve.genome import BitGenomeConfig
from bitneat.evolve.kinds import kind_for
from bitneat.evolve.linear import LinearSearch
from bitneat.evolve.lowering import genome_from_controller, lower
from bitneat.evolve.plain_reproduction import SoftmaxReproduction
from bitneat.evolve.reproduction import Settings
from bitneat.evolve.run_folder import RunFolder, RunSettings
from bitneat.evolve.search import Search
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import default_inputs, inspect
from tests.evolve.test_run import evolve, stop_after

KINDS = {
    "default": ("paper-default", {}),
    "int": ("paper-int", {}),
    "bit": ("paper-bit", {}),
    "bit-flips": ("paper-bit-flips", {}),
    "softmax": ("paper-softmax", {}),
    "wann": ("paper-wann", {}),
    "bit-gains": ("paper-bit-gains", {"linear_generations": 3, "linear_population": 6, "linear_episodes": 1}),
}
GENERATIONS = 6


def settings_of(kind: str) -> RunSettings:
    preset, more = KINDS[kind]
    config = load(preset).with_values("NEAT", pop_size=14)
    config = config.with_values(
        "evolve", generations=GENERATIONS, max_total_steps=0, max_steps=60,
        selection_episodes=2, final_episodes=3, report_episodes=3, **more,
    )  # fmt: skip
    if kind not in ("wann", "softmax", "bit-gains"):
        config = config.with_values("PlainReproduction", max_stagnation=2)  # so that species die
        config = config.with_values("PlainSpeciesSet", compatibility_threshold=0.7 if "bit" in kind else 1.8)
    return RunSettings(EnvironmentSpec("Acrobot-v1"), config, 5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stopped_run_of_every_kind_resumes_to_the_same_bytes(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, stopped = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "stopped")
    evolve(whole, settings_of(kind))
    for generation in (2, 4):
        with monkeypatch.context() as patch:
            stop_after(generation, patch)
            first = generation == 2
            settings = settings_of(kind) if first else stopped.settings()
            with pytest.raises(KeyboardInterrupt):
                evolve(stopped, settings, new=first)
    evolve(stopped, stopped.settings(), new=False)
    for name in ("champion.pkl", "champion.json", "history.csv", "report.json", "checkpoints/generation-000006.json"):
        assert (stopped.path / name).read_bytes() == (whole.path / name).read_bytes(), name


def test_weight_agnostic_genomes_have_no_gains_and_biases_to_mutate() -> None:
    keys = "mutate_gain = 100\nmutate_bias = 100\nmutate_add_link = 1\ngain_min = -3\ngain_init_min = -3\ngain_init_max = 3\n"
    config = parse(f"[NEAT]\ngenome = WeightAgnostic\n[BitGenome]\n{keys}", "test")
    kind = kind_for(config, (Input(),) * 4, 2)
    kind.settings.innovation_tracker = InnovationTracker()
    random.seed(3)
    changed = 0
    for key in range(40):
        genome = kind.genome_type(key)
        genome.configure_new(kind.settings)
        before = [policy.sha256 for policy in kind.lower(genome)]
        genome.mutate(kind.settings)
        assert all((node.gain, node.bias) == (0, 0) for node in genome.nodes.values())
        changed += [policy.sha256 for policy in kind.lower(genome)] != before
    assert changed > 15  # with those two mutations hardly any


def test_a_float_run_leaves_a_float_champion(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    evolve(folder, settings_of("default"))
    champion = load_any(folder.champion_pickle)
    assert isinstance(champion, FloatChampion)
    assert champion == load_any(folder.path / "champion.json")
    assert champion.provenance["steps"] > 0


def test_the_fitness_of_plain_reproduction_is_the_mean_reward(tmp_path: Path) -> None:
    settings = settings_of("bit")
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 1)
    evaluator = GymnasiumEvaluator(settings.environment, info.action, 60, 1)
    genomes = list(search.population.population.items())
    search._evaluator = evaluator
    state = search.streams.to_data()
    search._rank(genomes)
    search.streams.restore(state)
    seeds = search.streams.search_seeds(5)
    for _, genome in genomes:
        (policy,) = search.kind.lower(genome)
        rewards = [episode.reward for episode in evaluator.evaluate([policy], seeds)[0]]
        assert genome.fitness == statistics.fmean(rewards)


def test_a_run_ends_with_the_generation_that_uses_up_its_steps(tmp_path: Path) -> None:
    settings = settings_of("bit")
    config = settings.config.with_values("evolve", max_total_steps=9000, generations=1000)
    folder = RunFolder(tmp_path / "run")
    outcome = evolve(folder, RunSettings(settings.environment, config, 5))
    steps = [int(line.split(",")[10]) for line in (folder.path / "history.csv").read_text().splitlines()[1:]]
    assert outcome.finished
    assert sum(steps[:-1]) < 9000 <= sum(steps) == outcome.champion.provenance["steps"]


def test_after_the_linear_start_the_population_is_made_of_its_policy() -> None:
    settings = settings_of("bit-gains")
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 3)
    evaluator = GymnasiumEvaluator(settings.environment, info.action, 60, 1)
    while search.starting:
        search.advance(evaluator)
    assert search.linear is not None
    policies = {search.kind.lower(genome)[0].sha256 for genome in search.population.population.values()}
    sizes = {search.kind.lower(genome)[0].num_links for genome in list(search.population.population.values())[:4]}
    assert sizes == {search.linear.ternary(r).num_links for r in (1, 2, 3, 4)}
    assert len(policies) > 4  # and of mutants
    assert set(search.population.species.genome_to_species) == set(search.population.population)


def test_a_linear_start_that_leads_nowhere_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A policy that learns nothing has constants for outputs, whatever it is rounded to, which no genome has.
    monkeypatch.setattr(LinearSearch, "_learn", lambda *_: None)
    settings = settings_of("bit-gains")
    config = settings.config.with_values("evolve", linear_generations=1, generations=3)
    info = inspect(settings.environment)
    search = Search(config, settings.environment, info, 5)
    before = {key: search.kind.to_data(genome) for key, genome in search.population.population.items()}
    search.advance(GymnasiumEvaluator(settings.environment, info.action, 60, 1))
    assert search.linear is not None
    assert not search.starting
    assert {type(output) for r in (1, 2, 3, 4) for output in search.linear.ternary(r).outputs} == {Constant}
    assert {key: search.kind.to_data(genome) for key, genome in search.population.population.items()} == before
    assert evolve(RunFolder(tmp_path / "run"), RunSettings(settings.environment, config, 5)).finished


def test_a_rounding_of_the_linear_start_that_no_genome_is_like_is_left_out() -> None:
    settings = settings_of("bit-gains")
    config = settings.config.with_values("evolve", linear_generations=1, generations=3)
    info = inspect(settings.environment)
    search = Search(config, settings.environment, info, 2)
    search.advance(GymnasiumEvaluator(settings.environment, info.action, 60, 1))
    assert search.linear is not None
    roundings = [search.linear.ternary(r) for r in (1, 2, 3, 4)]
    used = [policy for policy in roundings if Constant not in map(type, policy.outputs)]
    assert len(used) == 3
    genomes = list(search.population.population.values())
    assert [search.kind.lower(genome)[0].num_links for genome in genomes[:3]] == [policy.num_links for policy in used]


@pytest.mark.parametrize("seed", range(5))
def test_a_genome_made_of_a_controller_lowers_to_it_again(seed: int) -> None:
    info = inspect(EnvironmentSpec("Acrobot-v1"))
    inputs = default_inputs(info, 8)
    linear = LinearSearch(inputs, 3, 8, seed, population=8)
    linear._mean = np.random.default_rng(seed).normal(0, 1, linear._mean.shape)
    settings = BitGenomeConfig(dict(parse("", "test")["BitGenome"]), len(inputs), 3)
    settings.innovation_tracker = InnovationTracker()
    for resolution in (1, 3):
        controller = linear.ternary(resolution)
        again = lower(
            genome_from_controller(1, controller, settings), inputs, 3, 8
        )  # its nodes may come in another order
        assert (len(again.nodes), again.num_links) == (len(controller.nodes), controller.num_links)
        first, second = RuntimeController(controller), RuntimeController(again)
        for x in np.random.default_rng(seed).integers(-256, 257, (50, len(inputs))):
            signals = np.clip(x, [-i.limit for i in inputs], [i.limit for i in inputs])
            assert first.step(signals).tolist() == second.step(signals).tolist()
    with pytest.raises(BitneatError, match=r"nodes\[\d\]"):
        genome_from_controller(1, linear.shifted(), settings)


def test_softmax_draws_parents_by_their_fitness_and_copies_them() -> None:
    beta, count = 0.03, 4000
    settings = settings_of("softmax")
    search = Search(settings.config, settings.environment, inspect(settings.environment), 1)
    population = search.population
    for place, genome in enumerate(population.population.values()):
        genome.fitness = 10.0 * place
    reproduction = SoftmaxReproduction(
        Settings({"beta": beta, "survival_threshold": 0.5, "mutation_rate": 0.0, "elitism": 1}), None, None
    )
    reproduction.genome_indexer.value = 10_000
    random.seed(8)
    children = reproduction.reproduce(search._neat_config, population.species, count, 0)
    assert len(children) == count
    best = max(population.population.values(), key=lambda genome: genome.fitness)
    assert children[best.key] is best
    drawn = [json.dumps(search.kind.to_data(child)[2:]) for key, child in children.items() if key != best.key]
    parents = sorted(population.population.values(), key=lambda genome: -genome.fitness)[:7]
    weights = [math.exp(beta * parent.fitness) for parent in parents]
    for parent, weight in zip(parents, weights, strict=True):
        share = drawn.count(json.dumps(search.kind.to_data(parent)[2:])) / len(drawn)
        assert share == pytest.approx(weight / sum(weights), abs=0.03)


def test_too_many_species_for_the_population_are_refused_in_one_line(tmp_path: Path) -> None:
    settings = settings_of("default")
    config = settings.config.with_values("PlainSpeciesSet", compatibility_threshold=0.01)
    with pytest.raises(BitneatError, match=r"species do not fit; raise \[PlainSpeciesSet\]"):
        evolve(RunFolder(tmp_path / "run"), RunSettings(settings.environment, config, 5))


@pytest.mark.parametrize("kind", ["default", "bit", "softmax", "bit-gains"])
def test_a_damaged_gene_in_a_checkpoint_is_refused(kind: str) -> None:
    settings = settings_of(kind)
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 1)
    search.advance(GymnasiumEvaluator(settings.environment, info.action, 60, 1))
    data = json.loads(json.dumps(search.to_data()))
    genome = next(genome for genome in data["population"] if genome[3])
    genome[3][0][3] = 2.5 if kind != "default" else "1"
    other = Search(settings.config, settings.environment, info, 1)
    with pytest.raises((BitneatError, TypeError)):
        other.restore(data)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("max_nodes = 2", "max_nodes = 2: expected at least 3, the outputs of Acrobot-v1"),
        (
            "max_nodes = 8\nnum_hidden = 6",
            "num_hidden = 6: expected at most 5, since Acrobot-v1 has 3 outputs and 6 inputs",
        ),
    ],
)
@pytest.mark.parametrize("genome", ["BitGenome", "WeightAgnostic"])
def test_more_nodes_at_the_start_than_there_may_be_are_refused(genome: str, keys: str, message: str) -> None:
    spec = EnvironmentSpec("Acrobot-v1")
    config = parse(f"[NEAT]\ngenome = {genome}\n[BitGenome]\n{keys}\n", "few.ini")
    config = config.with_values("evolve", generations=9)  # as the command line may
    with pytest.raises(BitneatError, match=rf"^few\.ini: \[BitGenome\] {message}"):
        Search(config, spec, inspect(spec), 1)
    Search(config.with_values("BitGenome", max_nodes=9), spec, inspect(spec), 1)


def test_candidates_are_controllers_or_networks_of_the_environment() -> None:
    settings = settings_of("default")
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 1)
    search.advance(GymnasiumEvaluator(settings.environment, info.action, 60, 1))
    data = json.loads(json.dumps(search.to_data()))
    assert "network" in data["candidates"][0]
    data["candidates"][0]["network"]["num_inputs"] = 30
    with pytest.raises(BitneatError, match="candidates: a controller does not fit"):
        Search(settings.config, settings.environment, info, 1).restore(data)
    assert not isinstance(search.candidates[0].controller, Controller)
