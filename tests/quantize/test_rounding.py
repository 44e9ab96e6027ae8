# SPDX-License-Identifier: MIT
"""Rounding weight by weight, and ternary weights by a threshold."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest

from bitneat.controller import Controller, Input, Reference
from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, FloatNode
from bitneat.quantize import round_weights, threshold_weights
from tests.quantize.networks import random_network

F = 8
ONE = 1 << F
EXACT = ("clamped", "hat", "relu", "abs", "identity")


def rounded(network: FloatNetwork, ternary: bool) -> FloatNetwork:
    """What rounding means, in floats and by NumPy."""

    def number(value: float) -> float:
        return float(np.rint(np.clip(value, -1, 1) if ternary else value))

    nodes = (
        replace(node, links=tuple((s, number(w)) for s, w in node.links), bias=number(node.bias))
        for node in network.nodes
    )
    return replace(network, nodes=tuple(nodes))


def assert_equal(controller: Controller, network: FloatNetwork, seed: int) -> None:
    rng = random.Random(seed)
    reference = Reference(controller)
    for _ in range(30):
        signals = [rng.randint(-entry.limit, entry.limit) for entry in controller.inputs]
        expected = network.step([signal / ONE for signal in signals])
        clipped = [max(-32767, min(32767, y * ONE)) for y in expected]
        assert reference.step(signals) == clipped, f"seed {seed}"


@pytest.mark.parametrize("ternary", [False, True])
def test_a_rounded_controller_is_exactly_the_rounded_network(ternary: bool) -> None:
    for seed in range(80):
        network = random_network(seed, largest=2.5, hidden=3, activations=EXACT)
        controller = round_weights(network, (Input(0, 200),) * 4, F, ternary=ternary)
        assert controller.is_ternary or not ternary
        assert_equal(controller, rounded(network, ternary), seed)


def test_a_constant_hidden_node_stays_exact_in_ternary() -> None:
    network = FloatNetwork(
        1,
        (FloatNode(((0, 0.2),), 0.6, 1.0, "tanh"), FloatNode(((0, 1.0), (1, 1.0)), 0.0, 1.0, "identity")),
        (2,),
    )
    ternary = round_weights(network, (Input(),), F, ternary=True)
    integer = round_weights(network, (Input(),), F, ternary=False)
    assert ternary.is_ternary
    assert not integer.is_ternary
    for signal in (-300, 0, 55):
        assert Reference(ternary).step([signal]) == Reference(integer).step([signal])
        assert Reference(ternary).step([signal])[0] - signal == Reference(ternary).step([0])[0] > 200


@pytest.mark.parametrize(("response", "gain"), [(0.9, 0), (0.3, -2), (5.0, 2), (-1.9, 1), (1e-6, -7), (0.0, None)])
def test_a_response_becomes_the_nearest_power_of_two(response: float, gain: int | None) -> None:
    network = FloatNetwork(1, (FloatNode(((0, 1.2),), 1.0, response, "identity"),), (1,))
    for ternary in (False, True):
        controller = round_weights(network, (Input(0, 16 * ONE),), F, ternary=ternary)
        slope = 0.0 if gain is None else (2.0**gain if response > 0 else -(2.0**gain))
        for signal in (-1024, 0, 128):
            assert Reference(controller).step([signal]) == [ONE + int(slope * signal)]


def test_a_threshold_leaves_the_large_weights_with_their_mean_size() -> None:
    weights = (0.9, -1.1, 0.1, -0.2, 1.0)
    # delta = 0.7 * 0.66 = 0.462; alpha = (0.9 + 1.1 + 1.0) / 3 = 1.0
    network = FloatNetwork(5, (FloatNode(tuple(enumerate(weights)), 0.7, 1.0, "identity"),), (5,))
    controller = threshold_weights(network, (Input(),) * 5, F)
    (node,) = controller.nodes
    assert [(link.source, link.sign) for link in node.links] == [(0, 1), (1, -1), (4, 1)]
    assert (node.gain, node.bias) == (0, ONE)
    scaled = replace(network, nodes=(replace(network.nodes[0], response=0.24),))
    (node,) = threshold_weights(scaled, (Input(),) * 5, F).nodes
    assert (node.gain, node.bias) == (-2, ONE)
    (node,) = threshold_weights(scaled, (Input(2),) * 5, F).nodes
    assert node.gain == -4


def test_thresholded_networks_are_ternary_whatever_they_hold() -> None:
    for seed in range(50):
        network = random_network(seed, largest=3.0, activations=("tanh", "relu", "gauss"))
        controller = threshold_weights(network, (Input(),) * 4, F)
        assert controller.is_ternary
        assert controller.num_links <= network.num_links


def test_what_cannot_be_rounded_is_said() -> None:
    large = FloatNetwork(1, (FloatNode(((0, 171.0),)),), (1,))
    with pytest.raises(BitneatError, match="node 1: a weight is beyond ±170"):
        round_weights(large, (Input(),), F, ternary=False)
    with pytest.raises(BitneatError, match=r"node 1: its weights' scale 2\^20 is no gain"):
        threshold_weights(FloatNetwork(1, (FloatNode(((0, 1e6),)),), (1,)), (Input(),), F)
    with pytest.raises(BitneatError, match="the network has 1 inputs"):
        round_weights(large, (), F, ternary=True)
