# SPDX-License-Identifier: MIT
"""The matrices of a layered controller compute what it does, but for rounding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bitneat.champion import load
from bitneat.controller import Constant, Controller, Input, Link, Node, Reference, Signal
from bitneat.distill.layers import layers_of
from bitneat.errors import BitneatError

CHAMPIONS = Path(__file__).parents[2] / "examples" / "champions"
STUDENT = load(CHAMPIONS / "start" / "student.pkl").controller


def _difference(controller: Controller) -> float:
    """Largest of what the matrices and the controller's own integers say of random observations."""
    layers = layers_of(controller)
    rng = np.random.default_rng(5)
    signals = rng.integers(-300, 301, (300, len(controller.inputs)))
    reference = Reference(controller)
    found = np.clip(np.array([reference.step(row.tolist()) for row in signals]) / 256, -1.0, 1.0)
    values = signals / 256
    for weights, biases in layers.matrices:
        values = np.clip(values @ weights.T + biases, -1.0, 1.0)
    assert np.abs(found).mean() > 0.1
    return float(np.abs(found - values).max())


def test_a_student_s_matrices_compute_what_its_controller_does() -> None:
    layers = layers_of(STUDENT)
    assert layers.hidden == (22, 14)
    assert [weights.shape for weights, _ in layers.matrices] == [(22, 24), (14, 22), (4, 14)]
    assert layers.left_out == 0
    assert _difference(STUDENT) < 0.1  # rounding down, over three layers


def test_a_link_that_skips_a_layer_is_left_out_and_counted() -> None:
    first = len(STUDENT.inputs)
    index = next(i for i in range(len(STUDENT.nodes) - 1, 0, -1) if STUDENT.nodes[i].activation == "clamped")
    node = STUDENT.nodes[index]
    assert all(link.source >= first for link in node.links)
    more = replace(node, links=(Link(0), *node.links))
    nodes = (*STUDENT.nodes[:index], more, *STUDENT.nodes[index + 1 :])
    changed = layers_of(replace(STUDENT, nodes=nodes))
    assert changed.left_out == 1
    for (weights, biases), (others, other_biases) in zip(changed.matrices, layers_of(STUDENT).matrices, strict=True):
        assert np.array_equal(weights, others)
        assert np.array_equal(biases, other_biases)


def test_identities_may_follow_each_other_and_outputs_stand_in_any_order() -> None:
    nodes = (
        Node((Link(0), Link(1, sign=-1)), 64, 1, "identity"),
        Node((Link(1), Link(2)), -32, 2, "identity"),
        Node((Link(0), Link(3, sign=-1)), 128, -1, "clamped"),
        Node((Link(0), Link(2, shift=1)), 0, -2, "clamped"),
    )
    controller = Controller((Input(0, 2047), Input(1, 1023)), nodes, (Signal(5), Signal(4)))
    layers = layers_of(controller)
    ((weights, biases),) = layers.matrices
    # Node 2 is 2 (x0 - x1 + 1/4), node 3 is 4 (x1 + node 2 - 1/8), by hand.
    assert weights.tolist() == [[1.25, -1.0], [(1 - 8) / 2, 4 / 2]]
    assert biases.tolist() == [0.25, (0.5 - 1.5) / 2]
    assert (layers.scales, layers.shifts) == ((0, 1), (0, -1))
    assert _difference(controller) < 0.05


INPUT = Input(0, 2047)
NODE = Node((Link(0),), 0, 0, "clamped")


@pytest.mark.parametrize(
    ("nodes", "outputs", "message"),
    [
        ((replace(NODE, activation="tanh"),), (Signal(1),), "a node is 'tanh', not clamped"),
        ((replace(NODE, links=(Link(0, delay=1),)),), (Signal(1),), "a link is delayed"),
        ((NODE, replace(NODE, links=(Link(1),))), (Signal(1), Signal(2)), "the outputs are not the nodes"),
        ((NODE,), (Signal(1), Signal(1)), "the outputs are not the nodes"),
        ((NODE,), (Signal(1), Constant(5)), "the outputs are not the nodes"),
        ((), (Signal(0),), "the outputs are not the nodes"),
        ((replace(NODE, activation="identity"),), (Signal(1),), "the outputs are not the nodes"),
    ],
)
def test_what_has_no_layers_is_refused(nodes: tuple[Node, ...], outputs: tuple[Signal, ...], message: str) -> None:
    with pytest.raises(BitneatError, match=f"^is no student's controller: {message}"):
        layers_of(Controller((INPUT,), nodes, outputs))


@pytest.mark.parametrize(("limit", "frac_bits"), [(1500, 8), (1, 8), (32767, 8), (2047, 7)])
def test_inputs_that_no_student_has_are_refused(limit: int, frac_bits: int) -> None:
    with pytest.raises(BitneatError, match=r"^is no student's controller: its inputs have other limits"):
        layers_of(Controller((INPUT, Input(1, limit)), (NODE,), (Signal(2),), frac_bits))
