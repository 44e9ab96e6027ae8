# SPDX-License-Identifier: MIT
"""Gains and parallel paths: how near they come, what they cost, and where they are exact."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bitneat.controller import Constant, Controller, Input, Reference
from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, FloatNode
from bitneat.quantize import spend_gains
from tests.quantize.networks import linear_networks, random_network

F = 8
ONE = 1 << F


def step(controller: Controller, values: list[float]) -> list[float]:
    """The outputs as numbers, for an observation that the encoder rounds."""
    signals = [
        max(-entry.limit, min(entry.limit, round(value * 2.0 ** (controller.frac_bits + entry.scale))))
        for entry, value in zip(controller.inputs, values, strict=True)
    ]
    return [y / controller.one for y in Reference(controller).step(signals)]


def smallest_power_not_below(value: float) -> float:
    power = 1.0
    while power < value:
        power *= 2
    while power / 2 >= value:
        power /= 2
    return power


@settings(deadline=None, max_examples=150)
@given(
    linear_networks(),
    st.lists(st.integers(-ONE, ONE), min_size=5, max_size=5),
    st.integers(3, 7),
    st.booleans(),
)
def test_a_linear_policy_is_within_half_a_step_a_weight(
    network: FloatNetwork, signals: list[int], bits: int, ternary: bool
) -> None:
    controller = spend_gains(network, (Input(0, ONE),) * 5, F, ternary=ternary, bits=bits)
    assert controller.is_ternary or not ternary
    observation = [signal / ONE for signal in signals]
    exact = network.step(observation)
    for node, expected, found in zip(network.nodes, exact, step(controller, observation), strict=True):
        largest = max(abs(weight) for _, weight in node.links)
        weight_step = max(smallest_power_not_below(largest) / 2**bits if largest else 0.0, 2**-7 if not ternary else 0)
        # Each weight and the bias are at most half a step off; each helper and the node round down, and digits below
        # a unit are dropped.
        bound = weight_step / 2 * (sum(map(abs, observation)) + 1) + (bits + 4) / ONE
        assert abs(found - expected) <= bound


@pytest.mark.parametrize("ternary", [False, True])
def test_integer_weights_are_exact(ternary: bool) -> None:
    for seed in range(40):
        network = random_network(seed, largest=3.0, hidden=3, whole=True, activations=("clamped", "hat", "relu", "abs"))
        controller = spend_gains(network, (Input(0, 300),) * 4, F, ternary=ternary, bits=7)
        rng = random.Random(seed)
        for _ in range(20):
            observation = [rng.randint(-300, 300) / ONE for _ in range(4)]
            expected = [max(-32767 / ONE, min(32767 / ONE, y)) for y in network.step(observation)]
            assert step(controller, observation) == expected, f"seed {seed}"


@pytest.mark.parametrize("ternary", [False, True])
@pytest.mark.parametrize("scale", [-1, 0, 4])
def test_deep_networks_come_nearer_with_more_bits(ternary: bool, scale: int) -> None:
    worst = {}
    for bits in (1, 3, 5, 7):
        errors = []
        for seed in range(25):
            network = random_network(seed)
            controller = spend_gains(network, (Input(scale),) * 4, 10, ternary=ternary, bits=bits)
            rng = random.Random(seed)
            for _ in range(10):
                observation = [rng.uniform(-1, 1) * 2.0**-scale for _ in range(4)]
                pairs = zip(network.step(observation), step(controller, observation), strict=True)
                errors += [abs(a - b) for a, b in pairs]
        worst[bits] = max(errors)
    assert worst[1] > worst[3] > worst[5]
    assert worst[7] < 0.05


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "sin", "gauss", "hat", "step"])
def test_activations_keep_their_names_and_scaling(activation: str) -> None:
    network = FloatNetwork(1, (FloatNode(((0, 0.75),), 0.25, 1.0, activation),), (1,))
    controller = spend_gains(network, (Input(),), 10, ternary=True, bits=4)
    for value in (-1.3, -0.4, 0.0, 0.21, 0.8):
        assert step(controller, [value]) == pytest.approx(network.step([value]), abs=0.03)


@pytest.mark.parametrize("response", [-0.6, 1.7, 0.01])
def test_a_response_goes_into_the_weights(response: float) -> None:
    network = FloatNetwork(2, (FloatNode(((0, 0.7), (1, -1.3)), 0.31, response, "identity"),), (2,))
    for ternary in (False, True):
        controller = spend_gains(network, (Input(),) * 2, 12, ternary=ternary, bits=7)
        assert step(controller, [0.5, -0.25]) == pytest.approx(network.step([0.5, -0.25]), abs=0.02)


def test_biases_of_any_size_are_ternary() -> None:
    for bias in (-5.3, -0.37, 0.0, 0.01, 0.5, 1.0, 3.0, 19.71):
        network = FloatNetwork(1, (FloatNode(((0, 1.0),), bias, 1.0, "identity"),), (1,))
        controller = spend_gains(network, (Input(0, ONE),), F, ternary=True, bits=7)
        assert controller.is_ternary
        assert step(controller, [0.25])[0] == pytest.approx(0.25 + bias, abs=2**-8 + 2 / ONE)


def test_fewer_terms_make_fewer_links() -> None:
    network = FloatNetwork(8, (FloatNode(tuple((i, 0.61 + 0.05 * i) for i in range(8)), 0.0, 1.0, "clamped"),), (8,))
    links = [
        spend_gains(network, (Input(),) * 8, F, ternary=False, bits=6, terms=terms).num_links for terms in (1, 2, None)
    ]
    assert links[0] == 8
    assert links[0] < links[1] <= links[2]


def test_nodes_without_weights_become_part_of_the_biases_of_others() -> None:
    dead = FloatNode(((0, 0.0),), 0.4, 1.0, "clamped")
    reader = FloatNode(((1, 0.5), (0, 1.0)), 0.1, 1.0, "identity")
    network = FloatNetwork(1, (dead, reader), (1, 2))
    for ternary in (False, True):
        controller = spend_gains(network, (Input(),), F, ternary=ternary, bits=6)
        assert controller.outputs[0] == Constant(round(0.4 * ONE))
        assert controller.is_ternary or not ternary
        assert step(controller, [0.5])[1] == pytest.approx(0.5 + 0.1 + 0.2, abs=0.02)


@pytest.mark.parametrize(
    ("weight", "bits", "inputs", "message"),
    [
        (3e7, 4, 1, "node 1: a weight of 3e.07 is too large"),
        (1.0, 8, 1, "bits: 8 is outside 0..7"),
        (1.0, 4, 2, "the network has 1 inputs, the controller is to have 2"),
    ],
)
@pytest.mark.parametrize("ternary", [False, True])
def test_what_cannot_be_is_said(weight: float, bits: int, inputs: int, message: str, ternary: bool) -> None:
    network = FloatNetwork(1, (FloatNode(((0, weight),), 0.0, 1.0, "identity"),), (1,))
    with pytest.raises(BitneatError, match=message):
        spend_gains(network, (Input(),) * inputs, F, ternary=ternary, bits=bits)


def test_a_step_is_taken_from_the_largest_weight_of_a_node() -> None:
    network = FloatNetwork(
        1, tuple(FloatNode(((0, math.ldexp(0.75, -k)),), 0.0, 1.0, "identity") for k in range(6)), tuple(range(1, 7))
    )
    controller = spend_gains(network, (Input(),), 12, ternary=True, bits=2)
    assert step(controller, [1.0]) == [math.ldexp(0.75, -k) for k in range(6)]
