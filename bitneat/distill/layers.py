# SPDX-License-Identifier: MIT
"""The matrices of a layered controller: the way back from `bitneat.distill.student.Student.controller`."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller, Signal
from bitneat.errors import BitneatError

Reals = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Layers:
    """What a layered controller computes, but for rounding: ``clip(weights @ x + biases, -1, 1)`` one after the other."""

    matrices: tuple[tuple[Reals, Reals], ...]
    """Of each layer the weights, (rows, columns), and the biases, (rows,)."""
    left_out: int
    """Weights that are not in them, since they skip a layer."""

    @property
    def hidden(self) -> tuple[int, ...]:
        """Nodes of each layer but the last."""
        return tuple(len(biases) for _, biases in self.matrices[:-1])


@dataclass(frozen=True)
class _Sum:
    """A weighted sum of inputs and clamped nodes."""

    weights: dict[int, float]
    bias: float = 0.0


def layers_of(controller: Controller) -> Layers:
    """Read the layers of a controller of clamped nodes, which identity nodes may help to add up.

    A node belongs to the layer after the last that it reads.

    Raises:
        BitneatError: if it has delayed links, other activations, or its outputs are not the nodes of the last layer.
    """
    controller = controller.canonical
    inputs = len(controller.inputs)
    values = [_Sum({i: 1.0}) for i in range(inputs)]
    clamped: dict[int, _Sum] = {}
    depths = dict.fromkeys(range(inputs), 0)
    for index, node in enumerate(controller.nodes, start=inputs):
        if node.activation not in ("clamped", "identity"):
            raise _unlayered(f"a node is {node.activation!r}, not clamped")
        if any(link.delay for link in node.links):
            raise _unlayered("a link is delayed")
        scale = 2.0**node.gain
        bias = math.ldexp(node.bias, -controller.frac_bits) * scale
        weights: dict[int, float] = {}
        for link in node.links:
            factor = math.ldexp(link.sign, link.shift) * scale
            bias += factor * values[link.source].bias
            for source, weight in values[link.source].weights.items():
                weights[source] = weights.get(source, 0.0) + factor * weight
        if node.activation == "identity":
            values.append(_Sum(weights, bias))
        else:
            values.append(_Sum({index: 1.0}))
            clamped[index] = _Sum(weights, bias)
            depths[index] = 1 + max((depths[source] for source in weights), default=0)
    layers = [[index for index in depths if depths[index] == depth] for depth in range(max(depths.values()) + 1)]
    outputs = [output.index for output in controller.outputs if isinstance(output, Signal)]
    if len(layers) == 1 or len(outputs) < len(controller.outputs) or sorted(outputs) != layers[-1]:
        raise _unlayered("the outputs are not the nodes of its last layer")
    layers[-1] = outputs
    matrices, kept = [], 0
    for below, layer in itertools.pairwise(layers):
        rows = [[clamped[index].weights.get(source, 0.0) for source in below] for index in layer]
        matrices.append((np.array(rows), np.array([clamped[index].bias for index in layer])))
        kept += sum(source in clamped[index].weights for index in layer for source in below)
    return Layers(tuple(matrices), sum(len(total.weights) for total in clamped.values()) - kept)


def _unlayered(what: str) -> BitneatError:
    return BitneatError(f"is no layered controller: {what}")
