# SPDX-License-Identifier: MIT
"""From layers, as trainers with gradients have them, to a float network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bitneat.errors import BitneatError
from bitneat.network import MAX_LINKS, FloatNetwork, FloatNode

Floats = npt.NDArray[np.float64]

ARGUMENT_SCALES: Mapping[str, float] = {
    "identity": 1.0,
    "clamped": 1.0,
    "relu": 1.0,
    "tanh": 2.5,
    "sigmoid": 5.0,
}
"""The functions that layers may have, and by how much neat-python's of that name scales its argument: its tanh is tanh(2.5 z)."""


class PolicyError(BitneatError):
    """A policy cannot be read, or is of a kind that has no float network."""


@dataclass(frozen=True)
class Layer:
    """``activation(weights @ x + bias)``.

    ``weights`` has the shape (out, in), ``bias`` (out,); ``activation`` is the plain function of `ARGUMENT_SCALES` by that name.
    """

    weights: Floats
    bias: Floats
    activation: str


def layered_network(layers: Sequence[Layer]) -> FloatNetwork:
    """The network of some layers, one after the other; a weight of 0 is no link.

    tanh(x) is neat-python's tanh of x / 2.5, so the weights and biases of such a layer are divided by 2.5.

    Raises:
        PolicyError: if shapes do not fit one another, a number is not finite, or an activation is unknown.
    """
    if not layers:
        raise PolicyError("has no layers")
    nodes: list[FloatNode] = []
    first = 0
    width = num_inputs = layers[0].weights.shape[1] if layers[0].weights.ndim == 2 else 0
    if sum(layer.weights.size for layer in layers) > MAX_LINKS:
        raise PolicyError(f"has more than {MAX_LINKS} weights")
    for number, layer in enumerate(layers, start=1):
        if layer.weights.ndim != 2 or layer.weights.shape[1] != width or layer.weights.shape[0] < 1:
            raise PolicyError(f"layer {number}: expected weights of shape (out, {width}), got {layer.weights.shape}")
        if layer.bias.shape != layer.weights.shape[:1]:
            raise PolicyError(
                f"layer {number}: expected a bias of shape {layer.weights.shape[:1]}, got {layer.bias.shape}"
            )
        if not (np.isfinite(layer.weights).all() and np.isfinite(layer.bias).all()):
            raise PolicyError(f"layer {number}: a number is not finite")
        scale = ARGUMENT_SCALES.get(layer.activation)
        if scale is None:
            raise PolicyError(f"layer {number}: {layer.activation} is not one of {', '.join(ARGUMENT_SCALES)}")
        for row, bias in zip((layer.weights / scale).tolist(), (layer.bias / scale).tolist(), strict=True):
            links = tuple((first + i, weight) for i, weight in enumerate(row) if weight)
            nodes.append(FloatNode(links, bias, 1.0, layer.activation))
        first = num_inputs if number == 1 else first + width
        width = layer.weights.shape[0]
    return FloatNetwork(num_inputs, tuple(nodes), tuple(range(first, first + width)))


def with_normalization(layers: Sequence[Layer], mean: Floats, variance: Floats, epsilon: float = 1e-8) -> list[Layer]:
    """The layers for observations as they are, if they were trained with (x - mean) / sqrt(variance + epsilon).

    Raises:
        PolicyError: if shapes do not fit, or a variance is negative or not finite.
    """
    expected = layers[0].weights.shape[1:]
    if len(expected) != 1 or mean.shape != expected or variance.shape != expected:
        raise PolicyError(f"normalization: expected a mean and a variance of shape {expected}")
    if not (np.isfinite(mean).all() and np.isfinite(variance).all() and (variance >= 0).all()):
        raise PolicyError("normalization: expected finite means and variances, none of them negative")
    weights = layers[0].weights / np.sqrt(variance + epsilon)
    bias = layers[0].bias - (weights * mean).sum(axis=1)
    return [replace(layers[0], weights=weights, bias=bias), *layers[1:]]


def with_unit_actions(layers: Sequence[Layer], low: Sequence[float], high: Sequence[float]) -> list[Layer]:
    """The layers with outputs from -1 to 1, if theirs are actions from ``low`` to ``high`` and not activated.

    Raises:
        PolicyError: if there are more or fewer outputs than bounds.
    """
    last = layers[-1]
    if last.weights.shape[:1] != (len(low),):
        raise PolicyError(f"has {last.weights.shape[0]} outputs, the environment's action {len(low)}")
    width = np.array(high) - np.array(low)
    factor = 2.0 / np.where(width > 0, width, 1.0)
    bias = (last.bias - np.array(low)) * factor - 1.0
    return [*layers[:-1], replace(last, weights=last.weights * factor[:, None], bias=bias)]
