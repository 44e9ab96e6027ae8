# SPDX-License-Identifier: MIT
"""Rescaling keeps what a network computes."""

import random

import pytest

from bitneat.network import FloatNetwork, FloatNode
from bitneat.quantize.scaling import rescaled
from tests.quantize.networks import random_network


@pytest.mark.parametrize("only_order", [False, True])
def test_a_rescaled_network_computes_the_same_within_the_range(only_order: bool) -> None:
    for seed in range(40):
        activations = ("relu", "identity", "abs") if seed % 2 else ("relu", "tanh", "hat", "identity")
        network = random_network(seed, largest=30.0, activations=activations)
        rng = random.Random(seed)
        runs = [[rng.uniform(-1, 1) for _ in range(4)] for _ in range(20)]
        everything = FloatNetwork(4, network.nodes, tuple(range(4, 11)))
        values = [everything.step(observation) for observation in runs]
        peaks = [max(abs(row[place]) for row in values) for place in range(7)]
        other = rescaled(network, peaks, 8.0, only_order=only_order)
        inside = FloatNetwork(4, other.nodes, everything.outputs)
        last = max(peaks[5:])
        for observation in runs:
            expected, found = network.step(observation), other.step(observation)
            if not only_order:
                assert found == pytest.approx(expected)
            assert sorted(range(2), key=lambda i: found[i]) == sorted(range(2), key=lambda i: expected[i])
            scaled = inside.step(observation)
            assert all(abs(y) <= 8.0 for y in scaled[:5])
            if only_order and seed % 2 and last:
                assert max(map(abs, found)) <= 8.0


def test_a_small_value_is_made_large() -> None:
    hidden = FloatNode(((0, 0.01),), 0.0, 1.0, "relu")
    network = FloatNetwork(1, (hidden, FloatNode(((1, 50.0),), 0.0, 1.0, "clamped")), (2,))
    other = rescaled(network, [0.01, 0.5], 4.0, only_order=False)
    assert other.nodes[0].response == 256.0
    assert other.nodes[1].links == ((1, 50.0 / 256),)
    assert other.nodes[1].response == 1.0
