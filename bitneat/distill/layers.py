# SPDX-License-Identifier: MIT
"""The layers of a student's controller: the way back from `bitneat.distill.student.Student.controller`, which needs no PyTorch."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller, Signal
from bitneat.errors import BitneatError

Reals = npt.NDArray[np.float64]

FRAC_BITS = 8
LIMIT = 2047
"""Of an input, in units of 2^-8: beyond 8, times the power of two that it is scaled by, an observation is clipped."""


@dataclass(frozen=True)
class Layers:
    """What a student's controller computes, but for rounding: ``clip(weights @ x + biases, -1, 1)`` one after the other."""

    scales: tuple[int, ...]
    """Of the inputs: an observation counts 2^scale times."""
    shifts: tuple[int, ...]
    """How many powers of two an input's limit is away from `LIMIT`."""
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
        BitneatError: if it is none that a student, polished or not, has become: it has delayed links, other activations, outputs
            that are not the nodes of the last layer, or inputs that are scaled or limited in another way.
    """
    controller = controller.canonical
    shifts = tuple(round(math.log2(entry.limit / LIMIT)) for entry in controller.inputs)
    if controller.frac_bits != FRAC_BITS or any(
        int(LIMIT * 2.0**shift) != entry.limit for shift, entry in zip(shifts, controller.inputs, strict=True)
    ):
        raise _no_student("its inputs have other limits, or its signals other fractions")
    inputs = len(controller.inputs)
    values = [_Sum({i: 1.0}) for i in range(inputs)]
    clamped: dict[int, _Sum] = {}
    depths = dict.fromkeys(range(inputs), 0)
    for index, node in enumerate(controller.nodes, start=inputs):
        if node.activation not in ("clamped", "identity"):
            raise _no_student(f"a node is {node.activation!r}, not clamped")
        if any(link.delay for link in node.links):
            raise _no_student("a link is delayed")
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
        raise _no_student("the outputs are not the nodes of its last layer")
    layers[-1] = outputs
    matrices, kept = [], 0
    for below, layer in itertools.pairwise(layers):
        rows = [[clamped[index].weights.get(source, 0.0) for source in below] for index in layer]
        matrices.append((np.array(rows), np.array([clamped[index].bias for index in layer])))
        kept += sum(source in clamped[index].weights for index in layer for source in below)
    scales = tuple(entry.scale for entry in controller.inputs)
    return Layers(scales, shifts, tuple(matrices), sum(len(total.weights) for total in clamped.values()) - kept)


def _no_student(what: str) -> BitneatError:
    return BitneatError(f"is no student's controller: {what}")
