# SPDX-License-Identifier: MIT
"""emlearn's code as a candidate: a multilayer perceptron of ReLU that computes the network.

emlearn knows dense layers with ReLU. A clamp is relu(s + 1) - relu(s - 1) - 1, and a value that a later layer reads is carried
through the layers between as relu(v + b) - b, with b no less than its magnitude.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.peers.candidate import Candidate, CannotExpressError
from benchmarks.peers.networks import levels
from bitneat.controller import Constant, Controller

Form = tuple[dict[int, float], float]
"""A value as a weighted sum of the current layer's units, and a constant."""


def emlearn_code(controller: Controller) -> Candidate:
    """The perceptron in float, by emlearn's loadable method; its inline one fails on any network in version 0.23.2."""
    import emlearn
    from emlearn.net import c_generate_net_loadable

    weights, biases = perceptron(controller)
    activations = ["relu"] * (len(weights) - 1) + ["identity"]
    text: str = c_generate_net_loadable(activations, weights, biases, prefix="net")
    count = len(controller.outputs)
    return Candidate(
        name="emlearn, float",
        note="ReLU layers; without the C library's exp, log and tanh that it would also link",
        sources={"net_model.h": text},
        prologue='#include "net_model.h"',
        call=f"net_regress(input, {len(controller.inputs)}, output, {count});",
        element="float",
        unit=1.0,
        include=(Path(emlearn.__file__).parent,),
    )


def perceptron(controller: Controller) -> tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]]:
    """Weights (inputs, outputs) and biases of each layer.

    Raises:
        CannotExpressError: if an activation is no sum of ReLU.
    """
    known = {"clamped", "identity", "relu"}
    if not all(node.activation in known for node in controller.nodes):
        raise CannotExpressError("an activation is no sum of ReLUs")
    if controller.is_recurrent:
        raise CannotExpressError("no state")
    one, first = float(controller.one), len(controller.inputs)
    forms: dict[int, Form] = {index: ({index: 1.0}, 0.0) for index in range(first)}
    bounds = {index: entry.limit / one for index, entry in enumerate(controller.inputs)}
    steps = levels(controller)
    weights: list[npt.NDArray[Any]] = []
    biases: list[npt.NDArray[Any]] = []
    width = first
    for position, new in enumerate(steps):
        later = {
            link.source for level in steps[position + 1 :] for n in level for link in controller.nodes[n - first].links
        }
        later |= {output.index for output in controller.outputs if not isinstance(output, Constant)}
        units: list[Form] = []
        moved: dict[int, Form] = {}
        for signal in new:
            node = controller.nodes[signal - first]
            total = _combine([(link.sign * 2.0**link.shift, forms[link.source]) for link in node.links])
            total = _combine([(2.0**node.gain, (total[0], total[1] + node.bias / one))])
            if node.activation == "clamped":
                moved[signal] = ({len(units): 1.0, len(units) + 1: -1.0}, -1.0)
                units += [(total[0], total[1] + 1), (total[0], total[1] - 1)]
            else:
                lift = 0.0 if node.activation == "relu" else 128.0
                moved[signal] = ({len(units): 1.0}, -lift)
                units.append((total[0], total[1] + lift))
            bounds[signal] = {"clamped": 1.0}.get(node.activation, 128.0)
        for signal in sorted(set(forms) & later):
            moved[signal] = ({len(units): 1.0}, -bounds[signal])
            units.append((forms[signal][0], forms[signal][1] + bounds[signal]))
        weights.append(_matrix(units, width))
        biases.append(np.array([constant for _, constant in units]))
        forms, width = moved, len(units)
    outputs: list[Form] = [
        ({}, output.value / one) if isinstance(output, Constant) else forms[output.index]
        for output in controller.outputs
    ]
    weights.append(_matrix(outputs, width))
    biases.append(np.array([constant for _, constant in outputs]))
    return weights, biases


def _combine(parts: list[tuple[float, Form]]) -> Form:
    total: dict[int, float] = {}
    constant = 0.0
    for factor, (form, offset) in parts:
        constant += factor * offset
        for unit, weight in form.items():
            total[unit] = total.get(unit, 0.0) + factor * weight
    return total, constant


def _matrix(units: list[Form], width: int) -> npt.NDArray[Any]:
    matrix = np.zeros((width, len(units)))
    for column, (form, _) in enumerate(units):
        for unit, weight in form.items():
            matrix[unit, column] = weight
    return matrix
