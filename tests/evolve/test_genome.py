# SPDX-License-Identifier: MIT
"""The ternary genome: its mutations really mutate, stay legal, and depend on the seed alone."""

from __future__ import annotations

import pickle
import random
from collections import Counter

import pytest
from neat.innovation import InnovationTracker

from bitneat.controller import Input
from bitneat.controller.ir import MAX_SIGNALS
from bitneat.evolve.config import parse
from bitneat.evolve.genome import (
    MUTATIONS,
    BitGenome,
    BitGenomeConfig,
    genome_from_data,
    genome_to_data,
    same_network,
)
from bitneat.evolve.lowering import lower

RICH = """
[BitGenome]
num_hidden = 3
initial_links = 3
mutate_bias = 1
mutate_delay = 1
output_activation = any
activations = identity clamped relu abs hat step tanh sigmoid sin gauss
"""


def make_config(text: str = RICH, num_inputs: int = 5, num_outputs: int = 2) -> BitGenomeConfig:
    config = BitGenomeConfig(dict(parse(text, "test")["BitGenome"]), num_inputs, num_outputs)
    config.innovation_tracker = InnovationTracker()
    return config


def make_genome(config: BitGenomeConfig, key: int = 1) -> BitGenome:
    genome = BitGenome(key)
    genome.configure_new(config)
    return genome


def undelayed_cycle(genome: BitGenome) -> bool:
    waiting = {key for key, link in genome.connections.items() if not link.delay}
    while True:
        targets = {target for _, target in waiting}
        free = {(source, target) for source, target in waiting if source not in targets}
        if not free:
            return bool(waiting)
        waiting -= free


@pytest.mark.parametrize("name", MUTATIONS)
def test_each_mutation_changes_the_genome_exactly_if_it_says_so(name: str) -> None:
    random.seed(1)
    config = make_config()
    changed = 0
    for _ in range(60):
        genome = make_genome(config)
        for _ in range(3):
            genome.mutate(config)
        before = genome_from_data(genome_to_data(genome))
        said = MUTATIONS[name](genome, config)
        assert said == (not same_network(before, genome))
        changed += said
    assert changed > 20


def test_genomes_stay_legal_through_thousands_of_mutations_and_crossovers() -> None:
    random.seed(2)
    config = make_config()
    population = [make_genome(config) for _ in range(10)]
    for genome in population:
        genome.fitness = random.random()
    for step in range(1500):
        child = BitGenome(step)
        child.configure_crossover(*random.sample(population, 2), config)
        child.mutate(config)
        child.fitness = random.random()
        population[random.randrange(10)] = child
        assert set(config.output_keys) <= set(child.nodes)
        assert not undelayed_cycle(child)
        for (source, target), link in child.connections.items():
            assert target in child.nodes
            assert source in child.nodes or source in config.input_keys
            assert link.delay or source not in config.output_keys
            assert link.weight in (-1, 0, 1)
            assert link.key == (source, target)
        for node in child.nodes.values():
            assert -7 <= node.gain <= 7
            assert node.bias in (-1, 0, 1)


def test_a_flip_always_changes_the_weight_and_reaches_all_three_values() -> None:
    random.seed(3)
    config = make_config()
    genome = make_genome(config)
    seen: Counter[tuple[int, int]] = Counter()
    for _ in range(600):
        before = {key: link.weight for key, link in genome.connections.items()}
        assert genome.mutate_weight(config)
        (key,) = [key for key, link in genome.connections.items() if link.weight != before[key]]
        seen[before[key], genome.connections[key].weight] += 1
    assert set(seen) == {(-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0)}


def test_biases_and_delays_are_off_by_default() -> None:
    random.seed(4)
    config = make_config("")
    genome = make_genome(config)
    for _ in range(500):
        genome.mutate(config)
    assert all(node.bias == 0 for node in genome.nodes.values())
    assert all(link.delay == 0 for link in genome.connections.values())


def test_a_child_undergoes_the_same_number_of_mutations_whatever_its_size() -> None:
    random.seed(5)
    config = make_config("[BitGenome]\nnum_hidden = 40\ninitial_links = 5\nmutations = 2\n", 20, 4)
    differences = []
    for _ in range(200):
        parent = make_genome(config)
        child = BitGenome(2)
        child.configure_clone(parent)
        child.mutate(config)
        links = parent.connections.keys() | child.connections.keys()
        differences.append(
            sum(
                key not in parent.connections
                or key not in child.connections
                or parent.connections[key].weight != child.connections[key].weight
                for key in links
            )
        )
    assert 0.5 < sum(differences) / len(differences) < 4


@pytest.mark.parametrize("name", MUTATIONS)
def test_limits_on_nodes_and_links_hold(name: str) -> None:
    random.seed(6)
    config = make_config(
        "[BitGenome]\nmax_nodes = 6\nmax_links = 9\nmutate_split = 5\nmutate_path = 5\nmutate_add_link = 5\nmutate_delay = 1\n"
    )
    full = 0
    for _ in range(60):
        genome = make_genome(config)
        for _ in range(30):
            genome.mutate(config)
            assert len(genome.nodes) <= 6
            assert len(genome.connections) <= 9
        full += len(genome.nodes) == 6 or len(genome.connections) == 9
        for _ in range(5):
            MUTATIONS[name](genome, config)
            assert len(genome.nodes) <= 6
            assert len(genome.connections) <= 9
    assert full > 40


def test_a_node_is_not_bypassed_by_more_links_than_there_may_be() -> None:
    random.seed(7)
    for limit, done in ((5, False), (6, True)):
        config = make_config(f"[BitGenome]\nmax_links = {limit}\ninitial_links = 0\n", num_inputs=3, num_outputs=2)
        genome = make_genome(config)
        node = genome._new_node(config)
        for source in config.input_keys:
            genome._link(config, source, node)
        for output in config.output_keys:
            genome._link(config, node, output)
        assert genome.mutate_bypass_node(config) == done
        assert len(genome.connections) == (6 if done else 5)
        assert (node in genome.nodes) == (not done)


@pytest.mark.parametrize("limit", [1, 6, 30])
def test_a_new_genome_has_no_more_links_than_there_may_be(limit: int) -> None:
    random.seed(8)
    config = make_config(f"[BitGenome]\nmax_nodes = 24\nmax_links = {limit}\nnum_hidden = 20\ninitial_links = 4\n")
    for key in range(20):
        genome = make_genome(config, key)
        assert len(genome.nodes) == 22
        assert len(genome.connections) == limit


def test_nodes_and_inputs_together_fit_a_controller() -> None:
    random.seed(9)
    config = make_config("[BitGenome]\nmutate_split = 50\nmutate_path = 50\n", num_inputs=MAX_SIGNALS - 4)
    genome = make_genome(config)
    for _ in range(20):
        genome.mutate(config)
    assert len(genome.nodes) == 4
    lower(genome, (Input(),) * (MAX_SIGNALS - 4), 2, 8)


def test_a_genome_survives_plain_data() -> None:
    random.seed(7)
    config = make_config()
    genome = make_genome(config)
    for _ in range(30):
        genome.mutate(config)
    genome.fitness = 0.25
    again = genome_from_data(genome_to_data(genome))
    assert genome_to_data(again) == genome_to_data(genome)
    assert list(again.connections) == list(genome.connections)


def test_pickling_the_configuration_burns_no_node_key() -> None:
    config = make_config()
    make_genome(config)
    before = config.node_indexer.value
    copies = [pickle.loads(pickle.dumps(config)) for _ in range(3)]
    assert config.node_indexer.value == before
    assert all(copy.node_indexer.value == before for copy in copies)


def test_the_fitter_parent_gives_the_structure() -> None:
    random.seed(8)
    config = make_config()
    first, second = make_genome(config, 1), make_genome(config, 2)
    for _ in range(20):
        second.mutate(config)
    for fitter, other in ((first, second), (second, first)):
        fitter.fitness, other.fitness = 1.0, 0.0
        child = BitGenome(3)
        child.configure_crossover(first, second, config)
        assert set(child.connections) == set(fitter.connections)
        assert set(child.nodes) == set(fitter.nodes)
