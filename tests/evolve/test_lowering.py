# SPDX-License-Identifier: MIT
"""From genome to controller: what a genome means, checked against a second evaluator written from that meaning alone."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from neat.innovation import InnovationTracker

import bitneat
from bitneat.controller import Constant, Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.activation import evaluate
from bitneat.errors import BitneatError
from bitneat.evolve.config import parse
from bitneat.evolve.genes import BitConnectionGene, BitNodeGene
from bitneat.evolve.genome import BitGenome, BitGenomeConfig
from bitneat.evolve.lowering import genome_from_controller, has_path, lower
from tests.evolve.test_genome import make_config, make_genome
from tests.strategies import controllers_with_inputs, input_vectors, patient

CHAMPIONS = Path(__file__).resolve().parents[2] / "examples" / "champions"

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


def there_and_back(controller: Controller) -> Controller:
    """What a genome that is like a controller lowers to."""
    settings = BitGenomeConfig(dict(parse("", "test")["BitGenome"]), len(controller.inputs), len(controller.outputs))
    settings.innovation_tracker = InnovationTracker()
    genome = genome_from_controller(1, controller, settings)
    return lower(genome, controller.inputs, len(controller.outputs), controller.frac_bits)


@patient
@given(controllers_with_inputs(ternary=True, max_steps=12))
def test_a_controller_that_a_genome_is_like_computes_the_same_after_it(
    drawn: tuple[Controller, list[list[int]]],
) -> None:
    controller, inputs = drawn
    try:
        again = there_and_back(controller.canonical)
    except BitneatError as error:  # no genome is
        assert "[" in str(error) or "a node" in str(error)
        return
    assert Reference(again).run(inputs) == Reference(controller).run(inputs)


X, ONE = Input(0, 2000), 256


@pytest.mark.parametrize(
    ("nodes", "outputs", "same"),
    [
        ((), (Constant(0), Constant(256), Constant(-64), Constant(1024)), True),
        ((), (Signal(0), Signal(1), Signal(0)), False),
        ((Node((Link(0), Link(1, 1, 0, -1)), ONE, -2, "tanh"),), (Signal(2), Signal(2)), False),
        ((Node((Link(0), Link(2, 1)), 0, 1), Node((Link(2), Link(1)), 0, 0, "relu")), (Signal(2), Signal(3)), False),
        ((Node((Link(0), Link(0, 1, 0, -1)), 0, 3),), (Signal(2),), False),
        ((Node((Link(0),), 0, 0, "abs"), Node((Link(2), Link(2, 1, 0, -1)), 0, 2)), (Signal(3), Signal(3)), False),
        ((Node((Link(2, 1, 0, -1),), ONE),), (Signal(2),), True),
        ((Node((), ONE), Node((Link(0), Link(2, 1)))), (Signal(2), Signal(3)), True),
    ],
    ids=[
        "constants", "inputs", "one node for two", "a node that others read", "an input now and before",
        "a node now and before", "a clock", "a constant output that others read",
    ],
)  # fmt: skip
def test_what_outputs_share_or_nodes_read_twice_becomes_nodes_of_their_own(
    nodes: tuple[Node, ...], outputs: tuple[Signal | Constant, ...], same: bool
) -> None:
    controller = Controller((X, X), nodes, outputs).canonical
    again = there_and_back(controller)
    assert (again.sha256 == controller.sha256) is same
    inputs = input_vectors(controller, random.Random(1), 50)
    assert Reference(again).run(inputs) == Reference(controller).run(inputs)


@pytest.mark.parametrize(
    ("nodes", "outputs", "message"),
    [
        ((), (Constant(3),), r"outputs\[0\]: is the constant 3, which no bias and gain of a genome make"),
        ((Node((Link(0),), 3),), (Signal(2),), r"nodes\[0\]\.bias: 3 is not 0 or ±2\^F"),
        ((Node((Link(0, 0, 1),)),), (Signal(2),), r"nodes\[0\]\.links\[0\]: has a shift"),
        (
            (Node((Link(2, 1, 0, -1),), ONE), Node((Link(2), Link(0)), 0)),
            (Signal(3),),
            r"nodes\[0\]: no input reaches it",
        ),
    ],
)
def test_what_no_genome_has_is_named(
    nodes: tuple[Node, ...], outputs: tuple[Signal | Constant, ...], message: str
) -> None:
    with pytest.raises(BitneatError, match=message):
        there_and_back(Controller((X, X), nodes, outputs).canonical)


@pytest.mark.parametrize("path", sorted(CHAMPIONS.glob("*.pkl")), ids=lambda path: path.stem)
def test_a_search_can_start_from_every_champion_of_the_examples(path: Path) -> None:
    controller = bitneat.load(path).controller.canonical
    if not controller.is_ternary:
        pytest.skip("is not ternary; a search starts from its ternary version")
    again = there_and_back(controller)
    inputs = input_vectors(controller, random.Random(2), 200)
    assert Reference(again).run(inputs) == Reference(controller).run(inputs)


def test_of_a_genomes_controller_there_is_a_genome_again() -> None:
    random.seed(12)
    config = make_config("[BitGenome]\nnum_hidden = 3\ninitial_links = 2\nmutate_bias = 2\nmutate_delay = 2\n")
    for number in range(60):
        genome = make_genome(config)
        for _ in range(25):
            genome.mutate(config)
        controller = lower(genome, INPUTS, 2, 8)
        again = there_and_back(controller)
        inputs = input_vectors(controller, random.Random(number), 12)
        assert Reference(again).run(inputs) == Reference(controller).run(inputs), number
