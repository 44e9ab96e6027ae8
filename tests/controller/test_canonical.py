# SPDX-License-Identifier: MIT
from __future__ import annotations

import itertools
import random
from pathlib import Path

import pytest
from hypothesis import given

from bitneat.controller import ACTIVATION_NAMES, Constant, Controller, Input, Link, Node, Output, Reference, Signal
from tests.strategies import controllers, controllers_with_inputs, input_vectors, patient, random_controller

PREVIOUS = 1


def build(*nodes: Node, outputs: tuple[int | Output, ...], inputs: int = 2) -> Controller:
    named = tuple(Signal(output) if isinstance(output, int) else output for output in outputs)
    return Controller((Input(),) * inputs, nodes, named)


def tanh(*links: Link, bias: int = 0) -> Node:
    return Node(links, bias, 0, "tanh")


class TestPruning:
    def test_nodes_that_no_output_needs_go(self) -> None:
        controller = build(tanh(Link(0)), tanh(Link(1)), tanh(Link(2)), outputs=(3,))
        assert controller.canonical == build(tanh(Link(1)), outputs=(2,))

    def test_inputs_stay_all(self) -> None:
        controller = build(outputs=(Constant(3),), inputs=5)
        assert controller.canonical == controller

    def test_delayed_links_are_followed(self) -> None:
        controller = build(tanh(Link(3, PREVIOUS)), tanh(Link(4, PREVIOUS)), tanh(Link(1)), outputs=(2,))
        assert controller.canonical == controller

    def test_a_loop_that_feeds_nothing_goes(self) -> None:
        loop = tanh(Link(2, PREVIOUS), Link(3, PREVIOUS)), tanh(Link(2))
        assert build(*loop, tanh(Link(0)), outputs=(4,)).canonical == build(tanh(Link(0)), outputs=(2,))

    def test_no_path_to_an_output_leaves_no_node(self) -> None:
        assert build(tanh(Link(0)), outputs=(0, 1)).canonical == build(outputs=(0, 1))


class TestConstantFolding:
    def test_a_constant_becomes_a_bias_of_its_undelayed_readers(self) -> None:
        half = Node((), 100, 1, "clamped")
        reader = Node((Link(0), Link(2, shift=2, sign=-1)), 7, -3, "sin")
        expected = build(Node((Link(0),), 7 - 4 * 200, -3, "sin"), outputs=(2,))
        assert build(half, reader, outputs=(3,)).canonical == expected

    def test_constants_of_constants_fold_too(self) -> None:
        nodes = [Node((), 10, 0, "identity"), Node((Link(2), Link(2, shift=1)), 2, 0, "relu"), tanh(Link(0), Link(3))]
        assert build(*nodes, outputs=(4,)).canonical == build(tanh(Link(0), bias=32), outputs=(2,))

    def test_a_constant_output_is_a_number(self) -> None:
        assert build(Node((), 0, 0, "gauss"), outputs=(2, 0)).canonical == build(outputs=(Constant(256), 0))

    def test_a_delayed_reader_keeps_the_node_since_it_reads_zero_first(self) -> None:
        node = Node((), 100, 1, "tanh")
        controller = build(node, tanh(Link(2, PREVIOUS), Link(2)), outputs=(3,))
        value = Reference(build(node, outputs=(2,))).step([0, 0])[0]
        folded = Node((), value, 0, "clamped")
        assert controller.canonical == build(folded, tanh(Link(2, PREVIOUS), bias=value), outputs=(3,))
        assert Reference(controller).run([[0, 0]] * 3) == Reference(controller.canonical).run([[0, 0]] * 3)

    def test_a_constant_beyond_one_is_kept_as_an_identity(self) -> None:
        controller = build(Node((), 300, 0, "abs"), tanh(Link(2, PREVIOUS)), outputs=(3,))
        assert controller.canonical == build(Node((), 300, 0, "identity"), tanh(Link(2, PREVIOUS)), outputs=(3,))

    def test_a_node_with_a_delayed_source_is_never_constant(self) -> None:
        controller = build(Node((), 9, 0, "identity"), tanh(Link(2, PREVIOUS)), tanh(Link(3)), outputs=(4,))
        assert len(controller.canonical.nodes) == 3

    def test_the_same_constant_has_the_same_form_whatever_it_was_made_from(self) -> None:
        ways = [
            Node((), 256, 0, "identity"),
            Node((), 900, 0, "clamped"),
            Node((), 0, 3, "hat"),
            Node((), 1, 0, "step"),
        ]
        canonical = {build(way, tanh(Link(2, PREVIOUS)), outputs=(3, 2)).canonical for way in ways}
        assert len(canonical) == 1


class TestOrder:
    def test_links_are_sorted_by_source_delay_shift(self) -> None:
        links = [Link(0), Link(0, 0, 1, -1), Link(0, 1), Link(1), Link(1, 1, 2, -1)]
        for order in itertools.permutations(links):
            assert build(tanh(*order), outputs=(2,)).canonical.nodes[0].links == tuple(links)

    def test_nodes_keep_their_order(self) -> None:
        """The nodes are in topological order already, so Kahn's order with the smallest index first keeps it."""
        for seed in range(200):
            controller = random_controller(random.Random(seed), size="small")
            canonical = controller.canonical
            kinds = [(node.activation, node.gain) for node in controller.nodes]
            rest = iter(kinds)
            for node in canonical.nodes:
                if node.links:  # what had only constants to read may be written in another way
                    assert (node.activation, node.gain) in rest, f"seed {seed}"

    def test_dead_nodes_in_between_leave_no_trace(self) -> None:
        rng = random.Random(3)
        for seed in range(100):
            controller = random_controller(random.Random(seed), size="small", num_nodes=5)
            position = rng.randrange(6)
            first = len(controller.inputs)
            number = {i: i + (i >= first + position) for i in range(controller.num_signals)}
            nodes = [
                Node(
                    tuple(Link(number[link.source], link.delay, link.shift, link.sign) for link in node.links),
                    node.bias, node.gain, node.activation,
                )
                for node in controller.nodes
            ]  # fmt: skip
            nodes.insert(position, Node((Link(0),), 1, 0, "sin"))
            outputs = tuple(
                Signal(number[output.index]) if isinstance(output, Signal) else output for output in controller.outputs
            )
            padded = Controller(controller.inputs, tuple(nodes), outputs, controller.frac_bits)
            assert padded.canonical == controller.canonical, f"seed {seed}"
            assert padded.sha256 == controller.sha256, f"seed {seed}"

    def test_the_order_of_links_leaves_no_trace(self) -> None:
        for seed in range(100):
            rng = random.Random(seed)
            controller = random_controller(rng, size="small")
            shuffled = tuple(
                Node(tuple(rng.sample(node.links, len(node.links))), node.bias, node.gain, node.activation)
                for node in controller.nodes
            )
            other = Controller(controller.inputs, shuffled, controller.outputs, controller.frac_bits)
            assert other.canonical == controller.canonical, f"seed {seed}"


class TestEveryCanonicalForm:
    @patient
    @given(controllers())
    def test_is_its_own_canonical_form(self, controller: Controller) -> None:
        canonical = controller.canonical
        assert canonical.canonical == canonical
        assert canonical.sha256 == controller.sha256

    @patient
    @given(controllers_with_inputs())
    def test_gives_the_same_outputs(self, case: tuple[Controller, list[list[int]]]) -> None:
        controller, sequence = case
        assert Reference(controller.canonical).run(sequence) == Reference(controller).run(sequence)

    def test_of_seeded_controllers_gives_the_same_outputs(self) -> None:
        for seed in range(150):
            rng = random.Random(seed)
            controller = random_controller(rng)
            sequence = input_vectors(controller, rng, 15)
            assert Reference(controller.canonical).run(sequence) == Reference(controller).run(sequence), f"seed {seed}"
            assert controller.canonical.canonical == controller.canonical, f"seed {seed}"


GOLDEN = {
    "one input, no node": Controller((Input(),), (), (Signal(0),), 8),
    "one node": Controller((Input(-3, 1280),), (tanh(Link(0)),), (Signal(1),), 8),
    "all fields": Controller(
        (Input(), Input(2, 77), Input(-16, 1)),
        (
            Node((Link(2, 0, 7, -1), Link(4, 1), Link(0)), -300, -7, "sin"),
            Node((Link(3), Link(3, 1, 0, -1), Link(4, 1, 3)), 4096, 5, "gauss"),
            Node((), 0, 0, "sigmoid"),
        ),
        (Signal(4), Constant(-32767), Signal(0), Signal(5)),
        12,
    ),
    "a walker's size": Controller(
        (Input(0, 1280),) * 24,
        tuple(
            Node(
                tuple(Link((7 * i + 5 * j) % (24 + i), int(j == 3), 0, 1 - 2 * ((i + j) % 2)) for j in range(4)),
                256 * (i % 3 - 1),
                i % 15 - 7,
                ACTIVATION_NAMES[i % 10],
            )
            for i in range(31)
        ),
        tuple(Signal(i) for i in range(51, 55)),
        8,
    ),
}


class TestFingerprint:
    @pytest.mark.parametrize("name", GOLDEN)
    def test_of_golden_controllers_never_changes(self, name: str) -> None:
        """A change here breaks every SHA-256 that was ever written down."""
        golden = dict(
            line.split("  ")[::-1]
            for line in (Path(__file__).parent / "golden_sha256.txt").read_text(encoding="ascii").splitlines()
        )
        assert GOLDEN[name].sha256 == golden[name]

    def test_changes_with_everything_that_counts(self) -> None:
        base = GOLDEN["all fields"]
        variants = [
            Controller(base.inputs, base.nodes, base.outputs, 11),
            Controller((Input(1), *base.inputs[1:]), base.nodes, base.outputs, 12),
            Controller((Input(0, 32766), *base.inputs[1:]), base.nodes, base.outputs, 12),
            Controller(base.inputs, base.nodes, base.outputs[::-1], 12),
            Controller(base.inputs, base.nodes, (Signal(4), Constant(0), *base.outputs[2:]), 12),
        ]
        first, *rest = base.nodes
        for other in (
            Node(first.links, first.bias, first.gain, "tanh"),
            Node(first.links, first.bias, -6, first.activation),
            Node(first.links, -301, first.gain, first.activation),
            Node(first.links[1:], first.bias, first.gain, first.activation),
            Node((Link(2, 0, 7, 1), *first.links[1:]), first.bias, first.gain, first.activation),
            Node((Link(2, 0, 6, -1), *first.links[1:]), first.bias, first.gain, first.activation),
            Node((Link(2, 1, 7, -1), *first.links[1:]), first.bias, first.gain, first.activation),
            Node((Link(1, 0, 7, -1), *first.links[1:]), first.bias, first.gain, first.activation),
        ):
            variants.append(Controller(base.inputs, (other, *rest), base.outputs, 12))
        hashes = {base.sha256, *(variant.sha256 for variant in variants)}
        assert len(hashes) == len(variants) + 1
