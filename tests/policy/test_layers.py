# SPDX-License-Identifier: MIT
"""Layers against NumPy's own matrix products."""

from __future__ import annotations

import numpy as np
import pytest

from bitneat.controller import BoxAction
from bitneat.errors import BitneatError
from bitneat.network import decode
from bitneat.policy.layers import Layer, layered_network, with_normalization, with_unit_actions

PLAIN = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "identity": lambda x: x,
    "clamped": lambda x: np.clip(x, -1, 1),
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
}


def layers(rng: np.random.Generator, sizes: tuple[int, ...], names: tuple[str, ...]) -> list[Layer]:
    return [
        Layer(rng.normal(size=(out, size)), rng.normal(size=out), name)
        for size, out, name in zip(sizes[:-1], sizes[1:], names, strict=True)
    ]


def forward(parts: list[Layer], x: np.ndarray) -> np.ndarray:
    for part in parts:
        x = PLAIN[part.activation](part.weights @ x + part.bias)
    return x


@pytest.mark.parametrize(
    "names", [("identity",), ("tanh", "clamped"), ("relu", "sigmoid", "identity"), ("sigmoid", "tanh", "relu")]
)
def test_a_layered_network_computes_its_matrix_products(names: tuple[str, ...]) -> None:
    rng = np.random.default_rng(1)
    parts = layers(rng, (5, 4, 3, 2)[: len(names) + 1], names)
    network = layered_network(parts)
    for _ in range(20):
        x = rng.normal(size=5)
        assert network.step(x.tolist()) == pytest.approx(forward(parts, x))


def test_normalization_is_folded_into_the_first_layer() -> None:
    rng = np.random.default_rng(2)
    parts = layers(rng, (3, 4, 2), ("tanh", "identity"))
    mean, variance = rng.normal(size=3), rng.uniform(0.1, 4, size=3)
    network = layered_network(with_normalization(parts, mean, variance, 1e-3))
    x = rng.normal(size=3)
    assert network.step(x.tolist()) == pytest.approx(forward(parts, (x - mean) / np.sqrt(variance + 1e-3)))


def test_actions_in_the_environments_units_are_cut_off_at_its_bounds() -> None:
    rng = np.random.default_rng(3)
    parts = layers(rng, (3, 2), ("identity",))
    action = BoxAction((-2.0, 0.5), (2.0, 3.5), (2,), "float64")
    network = layered_network(with_unit_actions(parts, action.low, action.high))
    for _ in range(30):
        x = 2 * rng.normal(size=3)
        expected = np.clip(forward(parts, x), action.low, action.high)
        assert decode(action, network.step(x.tolist())) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("weights", "bias", "name", "message"),
    [
        (np.ones((2, 4)), np.ones(2), "tanh", r"layer 2: expected weights of shape \(out, 3\), got \(2, 4\)"),
        (np.ones((2, 3)), np.ones(3), "tanh", r"layer 2: expected a bias of shape \(2,\), got \(3,\)"),
        (np.ones((2, 3)), np.array([1.0, np.nan]), "tanh", "layer 2: a number is not finite"),
        (np.ones((2, 3)), np.ones(2), "elu", "layer 2: elu is not one of identity, clamped"),
        (np.ones(3), np.ones(3), "tanh", r"layer 2: expected weights of shape"),
    ],
)
def test_layers_that_do_not_fit_are_refused(weights: np.ndarray, bias: np.ndarray, name: str, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        layered_network([Layer(np.ones((3, 2)), np.zeros(3), "relu"), Layer(weights, bias, name)])


def test_a_normalization_that_does_not_fit_is_refused() -> None:
    parts = [Layer(np.ones((3, 2)), np.zeros(3), "relu")]
    for mean, variance in ((np.ones(3), np.ones(3)), (np.ones(2), -np.ones(2)), (np.ones(2), np.full(2, np.inf))):
        with pytest.raises(BitneatError, match="normalization: expected"):
            with_normalization(parts, mean, variance)
    with pytest.raises(BitneatError, match="has 3 outputs, the environment's action 1"):
        with_unit_actions(parts, (-1.0,), (1.0,))
    with pytest.raises(BitneatError, match="has no layers"):
        layered_network([])
