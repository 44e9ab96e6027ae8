# SPDX-License-Identifier: MIT
"""From genome to controller: what a genome means, checked against a second evaluator written from that meaning alone."""

from __future__ import annotations

import random
from functools import cache

import pytest

from bitneat.controller import Constant, Controller, Input, Reference, Signal
from bitneat.controller.activation import evaluate
from bitneat.errors import BitneatError
from bitneat.evolve.genome import BitConnectionGene, BitGenome, BitNodeGene
from bitneat.evolve.lowering import has_path, lower
from tests.evolve.test_genome import make_config, make_genome

INPUTS = tuple(Input(0, 2000) for _ in range(5))


def genome_of(nodes: dict[int, tuple[int, int, str]], links: dict[tuple[int, int], int]) -> BitGenome:
    genome = BitGenome(1)
    for key, (gain, bias, activation) in nodes.items():
        node = BitNodeGene(key)
        node.gain, node.bias, node.activation = gain, bias, activation
        genome.nodes[key] = node
    for number, (ends, weight) in enumerate(links.items()):
        link = BitConnectionGene(ends, innovation=number)
        link.weight, link.enabled, link.delay = weight, True, 0
        genome.connections[ends] = link
    return genome


def meaning(genome: BitGenome, values: list[int], num_outputs: int, frac_bits: int) -> list[int]:
    """The outputs by recursion over the genes."""

    @cache
    def fed(key: int) -> bool:
        return key < 0 or any(fed(a) for (a, b), link in genome.connections.items() if b == key and link.counts)

    @cache
    def value(key: int) -> int:
        if key < 0:
            return values[-1 - key]
        node = genome.nodes[key]
        total = node.bias << frac_bits
        for (source, target), link in genome.connections.items():
            if target == key and link.counts and fed(source):
                total += link.weight * value(source)
        total = total << node.gain if node.gain >= 0 else total >> -node.gain
        return evaluate(node.activation, max(-32767, min(32767, total)), frac_bits)

    return [value(key) for key in range(num_outputs)]


def test_controllers_compute_what_their_genomes_mean() -> None:
    random.seed(11)
    text = (
        "[BitGenome]\nnum_hidden = 3\ninitial_links = 2\nmutate_bias = 2\noutput_activation = any\n"
        "activations = identity clamped relu abs hat step tanh sigmoid sin gauss\n"
    )
    config = make_config(text)
    for frac_bits in (4, 8, 12):
        for _ in range(60):
            genome = make_genome(config)
            for _ in range(25):
                genome.mutate(config)
            reference = Reference(lower(genome, INPUTS, 2, frac_bits))
            for _ in range(10):
                values = [random.randint(-2000, 2000) for _ in range(5)]
                assert reference.step(values) == meaning(genome, values, 2, frac_bits)


def test_the_controller_is_canonical_ternary_and_ends_with_its_outputs() -> None:
    random.seed(12)
    config = make_config()
    for _ in range(100):
        genome = make_genome(config)
        for _ in range(20):
            genome.mutate(config)
        controller = lower(genome, INPUTS, 2, 8)
        assert controller == controller.canonical
        assert controller.is_ternary
        if not controller.is_recurrent:
            signals = [output.index for output in controller.outputs if isinstance(output, Signal)]
            assert sorted(signals) == list(range(controller.num_signals - len(signals), controller.num_signals))


def test_delayed_links_read_the_step_before() -> None:
    genome = genome_of({0: (0, 0, "identity")}, {(-1, 0): 1, (0, 0): 1})
    genome.connections[0, 0].delay = 1
    reference = Reference(lower(genome, INPUTS[:1], 1, 8))
    assert [reference.step([1])[0] for _ in range(4)] == [1, 2, 3, 4]


def test_hidden_nodes_that_no_input_reaches_are_absent() -> None:
    genome = genome_of(
        {0: (0, 0, "clamped"), 5: (0, 0, "gauss"), 6: (0, 1, "step")}, {(-1, 0): 1, (5, 0): 1, (6, 5): 1}
    )
    assert lower(genome, INPUTS[:1], 1, 8) == lower(genome_of({0: (0, 0, "clamped")}, {(-1, 0): 1}), INPUTS[:1], 1, 8)


def test_a_cycle_in_a_damaged_genome_is_named() -> None:
    nodes = {0: (0, 0, "clamped"), 5: (0, 0, "gauss"), 6: (0, 1, "step")}
    genome = genome_of(nodes, {(-1, 0): 1, (-1, 5): 1, (5, 6): 1, (6, 5): 1})
    with pytest.raises(BitneatError, match="nodes 5, 6: form a cycle"):
        lower(genome, INPUTS[:1], 1, 8)
    genome.connections[6, 5].delay = 1
    assert lower(genome, INPUTS[:1], 1, 8).num_links == 1


def test_zero_and_disabled_links_are_absent() -> None:
    genome = genome_of({0: (0, 0, "clamped")}, {(-1, 0): 1, (-2, 0): 0, (-3, 0): 1})
    genome.connections[-3, 0].enabled = False
    assert lower(genome, INPUTS, 1, 8).num_links == 1


def test_a_genome_without_a_path_is_constant() -> None:
    controller = lower(genome_of({0: (0, 0, "clamped"), 1: (0, 1, "clamped")}, {}), INPUTS, 2, 8)
    assert controller.outputs == (Constant(0), Constant(256))
    assert not has_path(controller)


@pytest.mark.parametrize("count", [511, 513, 700])
def test_a_gain_that_could_overflow_the_accumulator_is_lowered(count: int) -> None:
    genome = genome_of({0: (7, 0, "clamped")}, {(-1 - i, 0): 1 for i in range(count)})
    controller = lower(genome, (Input(),) * count, 1, 8)
    assert isinstance(controller, Controller)
    assert controller.nodes[0].gain == (7 if count <= 512 else 6)
