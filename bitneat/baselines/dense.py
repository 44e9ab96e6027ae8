# SPDX-License-Identifier: MIT
"""Networks of dense layers, which trainers with gradients make, and what they are as a `FloatNetwork`."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, FloatNode
from bitneat.policy.arrays import read_arrays

Floats = npt.NDArray[np.float32]

RESPONSES = {"tanh": 0.4, "relu": 1.0}
"""Hidden activations, with the response that turns ours into the usual one: ours is tanh(2.5 z)."""


@dataclass(frozen=True, eq=False)
class DenseNetwork:
    """Layer by layer ``activation(weights @ x + bias)``; the last is clipped to -1 and 1 if ``clipped``, else left as it is.

    Raises:
        BitneatError: if the shapes do not fit one another.
    """

    weights: tuple[Floats, ...]
    """Each (outputs of the layer, its inputs)."""
    biases: tuple[Floats, ...]
    hidden: str = "tanh"
    """``tanh`` or ``relu``, as everybody means them."""
    clipped: bool = True

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise BitneatError(f"dense network: {len(self.weights)} matrices and {len(self.biases)} biases do not fit")
        for index, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            inputs = weights.shape[1:] if index == 0 else self.weights[index - 1].shape[:1]
            if weights.ndim != 2 or weights.shape != (*bias.shape, *inputs):
                raise BitneatError(f"dense network: layer {index + 1} of {weights.shape} and {bias.shape} does not fit")
        if self.hidden not in RESPONSES:
            raise BitneatError(f"dense network: {self.hidden!r} is not one of {', '.join(RESPONSES)}")

    @property
    def parameters(self) -> int:
        """Weights and biases."""
        return sum(array.size for array in (*self.weights, *self.biases))

    @property
    def float_bytes(self) -> int:
        """What the parameters take in float32."""
        return 4 * self.parameters

    def folded(self, mean: npt.ArrayLike, deviation: npt.ArrayLike) -> DenseNetwork:
        """The network that does to x what this one does to ``(x - mean) / deviation``, each (inputs,); rounded to float32."""
        scaled = self.weights[0].astype(np.float64) / np.asarray(deviation, np.float64)
        bias = self.biases[0].astype(np.float64) - scaled @ np.asarray(mean, np.float64)
        return DenseNetwork(
            (scaled.astype(np.float32), *self.weights[1:]),
            (bias.astype(np.float32), *self.biases[1:]),
            self.hidden,
            self.clipped,
        )

    def to_network(self) -> FloatNetwork:
        """The same as nodes and links: every weight is a link, zeros too."""
        nodes: list[FloatNode] = []
        inputs = self.weights[0].shape[1]
        sources: Sequence[int] = range(inputs)
        last = len(self.weights) - 1
        for index, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            activation = ("clamped" if self.clipped else "identity") if index == last else self.hidden
            response = 1.0 if index == last else RESPONSES[self.hidden]
            first = inputs + len(nodes)
            for row, constant in zip(weights.tolist(), bias.tolist(), strict=True):
                links = tuple(zip(sources, row, strict=True))
                nodes.append(FloatNode(links, response * constant, response, activation))
            sources = range(first, inputs + len(nodes))
        return FloatNetwork(inputs, tuple(nodes), tuple(sources))

    def to_npz(self) -> bytes:
        """An ``.npz`` file of the arrays W1, b1, W2, b2, …; the same bytes for the same numbers."""
        arrays = {}
        for index, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True), start=1):
            arrays[f"W{index}"], arrays[f"b{index}"] = weights, bias
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        return buffer.getvalue()


def dense_from_npz(content: bytes, hidden: str, clipped: bool) -> DenseNetwork:
    """Read what `DenseNetwork.to_npz` wrote.

    Raises:
        BitneatError: if it is no such file, or its shapes do not fit.
    """
    try:
        arrays = read_arrays(content)
    except BitneatError as error:
        raise BitneatError(f"not an .npz file of arrays: {error}") from None
    layers = len(arrays) // 2
    names = {f"{kind}{index}" for kind in "Wb" for index in range(1, layers + 1)}
    if not layers or set(arrays) != names or any(array.dtype != np.float32 for array in arrays.values()):
        raise BitneatError("expected float32 arrays W1, b1, W2, b2, …")
    weights = tuple(arrays[f"W{index}"] for index in range(1, layers + 1))
    biases = tuple(arrays[f"b{index}"] for index in range(1, layers + 1))
    return DenseNetwork(weights, biases, hidden, clipped)
