# SPDX-License-Identifier: MIT
"""neat-python's own genome: its networks are neat-python's, its integers stay integers, and its checkpoints hold all of it."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from neat.innovation import InnovationTracker
from neat.nn import FeedForwardNetwork

from bitneat.controller import Controller, Encoder, Input, Link, Node, Reference, Signal
from bitneat.controller.ir import MAX_SIGNALS
from bitneat.errors import BitneatError
from bitneat.evolve.config import ConfigError, parse
from bitneat.evolve.kinds import kind_for
from bitneat.evolve.lowering import lower_float, lower_integer, with_shared_weight
from bitneat.evolve.plain import WEIGHTS, PlainGenome, PlainGenomeConfig, plain_from_data, plain_to_data, wiring
from bitneat.runtime import RuntimeController
from tests.evolve.test_lowering import genome_of

INPUTS = (Input(),) * 5
NUM_OUTPUTS = 3


def settings(weights: str, **more: object) -> PlainGenomeConfig:
    lines = "".join(f"{key} = {value}\n" for key, value in more.items())
    text = (
        f"[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction\n[PlainGenome]\nweights = {weights}\n{lines}"
    )
    config = PlainGenomeConfig(parse(text, "test")["PlainGenome"], len(INPUTS), NUM_OUTPUTS)
    config.innovation_tracker = InnovationTracker()
    return config


def grown(config: PlainGenomeConfig, seed: int, mutations: int = 40) -> PlainGenome:
    """A genome after many mutations; the global generator is put back afterwards."""
    outside = random.getstate()
    random.seed(seed)
    genome = PlainGenome(seed)
    genome.configure_new(config)
    for _ in range(mutations):
        genome.mutate(config)
    random.setstate(outside)
    return genome


class _Aggregations:
    @staticmethod
    def get(name: str) -> object:
        del name
        return sum


@pytest.mark.parametrize("seed", range(25))
def test_a_float_genome_becomes_the_network_that_neat_python_makes_of_it(seed: int) -> None:
    config = settings("float")
    genome = grown(config, seed)
    ours = lower_float(genome, len(INPUTS), NUM_OUTPUTS)
    config.aggregation_function_defs = _Aggregations()
    for node in genome.nodes.values():
        node.response, node.aggregation = 1.0, "sum"  # type: ignore[attr-defined]
    theirs = FeedForwardNetwork.create(genome, type("Config", (), {"genome_config": config}))
    rng = np.random.default_rng(seed)
    for _ in range(10):
        observation = rng.normal(0, 1, len(INPUTS)).tolist()
        assert ours.step(observation) == pytest.approx(theirs.activate(observation), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("weights", ["integer", "ternary"])
@pytest.mark.parametrize("seed", range(15))
def test_an_integer_genome_computes_its_weighted_sums_exactly(weights: str, seed: int) -> None:
    config = settings(weights, activations="identity", activation_default="identity", weight_mutate_rate=0.3)
    genome = grown(config, seed, 12)
    controller = lower_integer(genome, INPUTS, NUM_OUTPUTS, 8)
    inputs = np.random.default_rng(seed).integers(-3, 4, len(INPUTS))
    signals = {-1 - i: int(value) for i, value in enumerate(inputs)}
    found = wiring(genome, NUM_OUTPUTS)
    reached: set[int] = set()
    for key in found.order:
        total = sum(link.weight * signals[link.key[0]] for link in found.links[key]) + 256 * int(genome.nodes[key].bias)
        live = any(w.weight and (w.key[0] < 0 or w.key[0] in reached) for w in found.links[key])
        reached |= {key} if live else set()
        signals[key] = max(-32767, min(32767, total)) if live or key < NUM_OUTPUTS else 0  # others are left out
    outputs = RuntimeController(controller).step(inputs.astype(np.int16))
    assert outputs.tolist() == [signals[key] for key in range(NUM_OUTPUTS)]


@pytest.mark.parametrize("seed", range(10))
def test_a_ternary_genome_becomes_a_ternary_controller(seed: int) -> None:
    genome = grown(settings("ternary", weight_mutate_rate=0.1), seed)
    assert all(link.weight in (-1, 0, 1) for link in genome.connections.values())
    assert lower_integer(genome, INPUTS, NUM_OUTPUTS, 8).is_ternary


@pytest.mark.parametrize("weights", ["integer", "ternary"])
def test_every_gene_of_an_integer_genome_holds_integers(weights: str) -> None:
    genome = grown(settings(weights), 3, 120)
    assert len(genome.nodes) > NUM_OUTPUTS  # links were split
    assert {type(link.weight) for link in genome.connections.values()} == {int}
    assert {type(node.bias) for node in genome.nodes.values()} == {int}


def test_a_plain_genome_has_no_more_nodes_than_a_controller_beside_the_inputs() -> None:
    inputs = (Input(),) * (MAX_SIGNALS - 5)
    text = (
        "[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction\n"
        "[PlainGenome]\nweights = ternary\ninitial_connection = unconnected\nnode_delete_prob = 0\n"
    )
    config = PlainGenomeConfig(parse(text, "test")["PlainGenome"], len(inputs), NUM_OUTPUTS)
    config.innovation_tracker = InnovationTracker()
    genome = grown(config, 1)
    assert len(genome.nodes) == 5
    lower_integer(genome, inputs, NUM_OUTPUTS, 8)


def test_weights_that_do_not_mutate_stay_as_they_were() -> None:
    config = settings("ternary", weight_mutate_rate=0, conn_add_prob=0, conn_delete_prob=0, node_add_prob=0)
    genome = grown(config, 1, 0)
    before = {key: link.weight for key, link in genome.connections.items()}
    for _ in range(50):
        genome.mutate(config)
    assert {key: link.weight for key, link in genome.connections.items()} == before
    flipping = settings("ternary", weight_mutate_rate=0.5, conn_add_prob=0, conn_delete_prob=0, node_add_prob=0)
    for _ in range(5):
        genome.mutate(flipping)
    assert {key: link.weight for key, link in genome.connections.items()} != before


@pytest.mark.parametrize("weights", WEIGHTS)
def test_a_child_has_the_structure_of_the_fitter_parent_and_genes_of_both(weights: str) -> None:
    config = settings(weights)
    first, second = grown(config, 1, 3), grown(config, 2, 3)
    first.fitness, second.fitness = 2.0, 1.0
    child = PlainGenome(9)
    random.seed(4)
    child.configure_crossover(second, first, config)
    assert set(child.connections) == set(first.connections)
    assert set(child.nodes) == set(first.nodes)
    shared = [key for key in first.connections if key in second.connections]
    assert {child.connections[key].weight for key in shared} <= {
        parent.connections[key].weight for key in shared for parent in (first, second)
    }


@pytest.mark.parametrize("weights", WEIGHTS)
def test_a_genome_comes_back_from_plain_data(weights: str) -> None:
    genome = grown(settings(weights), 7)
    genome.fitness = 1.5
    data = plain_to_data(genome)
    again = plain_from_data(data, weights, ("sin",))  # whatever the configuration has by now
    assert plain_to_data(again) == data
    assert list(again.connections) == list(genome.connections)


def test_activations_of_an_old_checkpoint_are_numbers_in_the_configurations_list() -> None:
    data = [1, None, [[0, 0, 1], [1, 0, 0]], []]
    genome = plain_from_data(data, "ternary", ("sin", "relu"))
    assert [node.activation for node in genome.nodes.values()] == ["relu", "sin"]


@pytest.mark.parametrize("activation", [2, -1, True, 1.0, None, "softmax", [], {}])
def test_an_activation_that_is_not_there_is_named(activation: object) -> None:
    with pytest.raises(BitneatError, match=r"activation .*: expected one of identity, "):
        plain_from_data([1, None, [[0, 0, activation]], []], "ternary", ("sin", "relu"))


def test_a_cycle_in_a_damaged_genome_is_found() -> None:
    genome = grown(settings("ternary"), 5)
    link = type(next(iter(genome.connections.values())))
    for key in ((0, 1), (1, 0)):
        genome.connections[key] = link(key, innovation=0)
        genome.connections[key].weight, genome.connections[key].enabled = 1, True
    with pytest.raises(BitneatError, match="form a cycle"):
        wiring(genome, NUM_OUTPUTS)


def test_a_shared_weight_scales_every_link() -> None:
    nodes = (Node((Link(0, 0, 0, 1), Link(1, 0, 0, 1)), 0, 0, "identity"),)
    base = Controller((Input(), Input()), nodes, (Signal(2),), 8).canonical
    x = np.array([40, -8], np.int16)
    for units, resolution, expected in ((1, 0, 32), (-1, 0, -32), (1, -1, 64), (-1, 1, -16), (3, 1, 48), (5, 4, 10)):
        controller = with_shared_weight(base, units, resolution)
        assert RuntimeController(controller).step(x).tolist() == [expected], (units, resolution)


def test_a_weight_agnostic_genome_runs_with_each_of_its_weights() -> None:
    text = (
        "[NEAT]\ngenome = WeightAgnostic\n[WeightAgnostic]\nshared_weights = -2 0.5 1\n[BitGenome]\ninitial_links = 4\n"
    )
    config = parse(text, "test")
    kind = kind_for(config, INPUTS, NUM_OUTPUTS)
    kind.settings.innovation_tracker = InnovationTracker()
    random.seed(2)
    genome = kind.genome_type(1)
    genome.configure_new(kind.settings)
    variants = kind.lower(genome)
    assert len(variants) == 3
    assert {type(v) for v in variants} == {Controller}
    gains = [{node.gain for node in v.nodes} for v in variants if isinstance(v, Controller)]
    assert gains == [{1}, {-1}, {0}]
    assert all(link.sign == -1 for node in variants[0].nodes for link in node.links)  # type: ignore[union-attr]
    tuned = kind.tuned(variants[1])
    assert len({policy.sha256 for policy in tuned}) == len(tuned) == 96
    assert {variant.sha256 for variant in variants} <= {policy.sha256 for policy in tuned}
    assert Encoder(variants[0])  # type: ignore[arg-type]


def test_a_sum_beyond_the_accumulator_makes_the_weights_of_an_integer_genome_smaller() -> None:
    inputs = (Input(0, 32767),) * 700
    nodes = [[0, 100, "identity"], [1, 100, "identity"]]
    links = [[-1 - i, 0, i, 127 if i % 2 else -127, 1] for i in range(700)] + [[-1, 1, 700, 127, 1]]
    controller = lower_integer(plain_from_data([1, None, nodes, links], "integer", ()), inputs, 2, 8)
    signals = [0] * 700
    signals[0], signals[1], signals[2] = 10, 20, 3
    first, second = Reference(controller).step(signals)
    assert first == 63 * (20 - 13) + 50 * 256  # halves, toward zero
    assert second == 127 * 10 + 100 * 256  # what fits stays
    fewer = lower_integer(plain_from_data([1, None, nodes, links[:500] + links[-1:]], "integer", ()), inputs, 2, 8)
    assert Reference(fewer).step(signals)[0] == 127 * (20 - 13) + 100 * 256


@pytest.mark.parametrize(
    ("units", "resolution", "expected"), [(1, -3, 4), (170, 0, 85), (127, 7, 126), (-127, 7, -126)]
)
def test_a_sum_beyond_the_accumulator_makes_a_shared_weight_smaller_or_coarser(
    units: int, resolution: int, expected: int
) -> None:
    count = 16000 if resolution < 0 else 700
    inputs = (Input(0, 32767),) * count
    nodes = (
        Node(tuple(Link(i, 0, 0, 1) for i in range(count)), 0, 0, "identity"),
        Node((Link(0, 0, 0, 1),), 0, 0, "identity"),
    )
    base = Controller(inputs, nodes, (Signal(count), Signal(count + 1)), 8).canonical
    signals = [128] + [0] * (count - 1)
    scale = 2.0**-resolution
    first, second = Reference(with_shared_weight(base, units, resolution)).step(signals)
    assert first == expected * 128 / (128 if resolution == 7 else 1)
    assert second == units * 128 * scale


def test_a_shared_weight_is_refused_by_the_configuration_or_is_what_links_have() -> None:
    genome = genome_of({0: (0, 0, "identity")}, {(-1, 0): 1})
    refused = []
    for units in range(-1024, 1025):
        text = f"[NEAT]\ngenome = WeightAgnostic\n[WeightAgnostic]\nshared_weights = {units / 128!r}\n"
        try:
            config = parse(text, "my.ini")
        except ConfigError as error:
            message = (
                rf"my\.ini: \[WeightAgnostic\] shared_weights: {re.escape(f'{units / 128:.20g}')}: .* from -170 to 170"
            )
            assert re.fullmatch(message, str(error))
            refused.append(units)
            continue
        (controller,) = kind_for(config, INPUTS[:1], 1).lower(genome)
        assert isinstance(controller, Controller)
        assert Reference(controller).step([128]) == [units]
    assert {0, 257, 385, 1023} <= set(refused)
    assert all(units == 0 or abs(units) // (units & -units) > 170 for units in refused)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[NEAT]\ngenome = PlainGenome", "reproduction: expected BitReproduction for BitGenome"),
        ("[NEAT]\nreproduction = PlainReproduction", "reproduction: expected BitReproduction for BitGenome"),
        ("[PlainGenome]\nweights = ternary", r"\[PlainGenome\] is not in use"),
        (
            "[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction\n[PlainGenome]\nweights = bits",
            "weights = bits",
        ),
        (
            "[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction\n[PlainGenome]\nactivations = sin",
            "activation_default: expected one of activations",
        ),
        ("[NEAT]\ngenome = WeightAgnostic\n[evolve]\nlinear_generations = 3", "a linear start is for BitGenome"),
        ("[NEAT]\ngenome = WeightAgnostic\n[WeightAgnostic]\nshared_weights = 0 1", "shared_weights"),
    ],
)
def test_a_configuration_that_does_not_fit_together_is_refused(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse(text, "test")
