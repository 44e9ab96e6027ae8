# SPDX-License-Identifier: MIT
"""Variation gives controllers, near the one it started from, and keeps what was promised."""

import random

import pytest

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.evolve.variation import vary
from tests.strategies import random_controller

TERNARY = Controller(
    (Input(), Input(), Input()),
    (
        Node((Link(0, 0, 0, 1), Link(1, 0, 0, -1)), 0, 1, "clamped"),
        Node((Link(1, 0, 0, 1), Link(2, 0, 0, 1), Link(3, 0, 0, -1)), 0, 0, "abs"),
        Node((Link(3, 0, 0, 1), Link(4, 0, 0, 1)), 0, -1, "clamped"),
    ),
    (Signal(4), Signal(5)),
    8,
).canonical


@pytest.mark.parametrize("seed", range(60))
def test_any_controller_varies_into_canonical_ones_of_the_same_shape(seed: int) -> None:
    rng = random.Random(seed)
    controller = random_controller(rng).canonical
    for _ in range(20):
        varied = vary(controller, rng)
        assert varied == varied.canonical
        assert varied.inputs == controller.inputs
        assert (len(varied.outputs), varied.frac_bits) == (len(controller.outputs), controller.frac_bits)
        controller = varied


def test_ternary_stays_ternary_and_free_of_delays() -> None:
    rng = random.Random(1)
    controller = TERNARY
    for _ in range(500):
        controller = vary(controller, rng)
        assert controller.is_ternary
        assert not any(link.delay for node in controller.nodes for link in node.links)


def test_one_change_is_small_and_each_kind_of_change_occurs() -> None:
    rng = random.Random(2)
    seen = {
        (v.num_links - TERNARY.num_links, len(v.nodes) - len(TERNARY.nodes))
        for v in (vary(TERNARY, rng, 1.0) for _ in range(2000))
    }
    assert {(1, 0), (-1, 0), (0, 0)} <= seen
    assert any(nodes > 0 for _, nodes in seen)
    assert any(nodes < 0 for _, nodes in seen)
    assert len({vary(TERNARY, rng, 1.0).sha256 for _ in range(400)}) > 80


def test_biases_change_and_new_nodes_can_be_small_corrections() -> None:
    rng = random.Random(4)
    varied = [vary(TERNARY, rng, 1.0) for _ in range(2000)]
    assert {node.bias for v in varied for node in v.nodes} == {-256, 0, 256}
    grown = [v for v in varied if len(v.nodes) > len(TERNARY.nodes)]
    assert min(node.gain for v in grown for node in v.nodes) == -4


def test_the_same_generator_gives_the_same_variations() -> None:
    first, second = random.Random(3), random.Random(3)
    assert [vary(TERNARY, first) for _ in range(50)] == [vary(TERNARY, second) for _ in range(50)]
