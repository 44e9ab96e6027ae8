# SPDX-License-Identifier: MIT
"""The controller whose walking is measured: it acts as the champion of examples/walker does, and has 50 links."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller, Link, Node, Signal
from bitneat.runtime import Population
from bitneat.sim.environment import decode_table
from bitneat.sim.walker.episodes import ACTION

NUM_LINKS = 50
_FALLS = {15, 17, 30, 32, 37, 38, 44, 48, 53, 59, 63, 73, 79, 86, 93, 99, 101, 102, 110, 111, 113}
SEEDS = tuple(seed for seed in range(117) if seed not in _FALLS)
"""Of episodes in which the champion walks all 1600 steps; a test walks them."""

# What three nodes more read, six signals each. The champion reads 10 of the 24 inputs; these read the other 14 and some again.
_PADDING = ((4, 5, 7, 8, 10, 14), (11, 12, 15, 16, 17, 18), (3, 9, 13, 20, 22, 23))
_PADDED_OUTPUTS = (0, 1, 3)


def champion() -> Controller:
    """The champion's controller, of 23 links; a copy, since examples/ is not installed."""
    text = (resources.files("bitneat.bench") / "walker.json").read_text(encoding="utf-8")
    return Controller.from_data(json.loads(text))


def fifty_links() -> Controller:
    """A controller of 50 links that reads every input and whose outputs are always those of `champion`.

    A node of six links gives 0 or One; a second node steps over it, and so gives the same; an output's node adds the one and
    takes away the other. No pass of the optimiser sees that they cancel, and the interpreter of packed controllers computes every
    link. As every lidar ray is read, the native walker casts them all, as Gymnasium does.
    """
    original = champion()
    outputs = [output.index for output in original.outputs if isinstance(output, Signal)]
    nodes = list(original.nodes)
    first_padding = min(outputs)  # the nodes of the outputs come last and are read by none
    count = first_padding - len(original.inputs)
    hidden, last = nodes[:count], nodes[count:]
    for number, (sources, output) in enumerate(zip(_PADDING, _PADDED_OUTPUTS, strict=True)):
        node, twin = first_padding + 2 * number, first_padding + 2 * number + 1
        links = tuple(Link(source, sign=(-1) ** place) for place, source in enumerate(sources))
        hidden += [Node(links, activation="step"), Node((Link(node),), activation="step")]
        padded = outputs[output] - first_padding
        last[padded] = replace(last[padded], links=(*last[padded].links, Link(node), Link(twin, sign=-1)))
    shift = 2 * len(_PADDING)
    moved = tuple(Signal(index + shift) for index in outputs)
    return Controller(original.inputs, (*hidden, *last), moved, original.frac_bits).canonical


class BatchPolicy:
    """A controller without state, for a whole batch of observations in one call."""

    def __init__(self, controller: Controller) -> None:
        self._population = Population([controller])
        self._factor = np.array([2.0 ** (controller.frac_bits + entry.scale) for entry in controller.inputs])
        self._limit = np.array([float(entry.limit) for entry in controller.inputs])
        self._one = controller.one
        self._table = decode_table(ACTION, controller.frac_bits)
        self._middle = np.arange(ACTION.num_outputs) * (2 * self._one + 1) + self._one

    def __call__(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """The actions for observations of shape (batch, 24); none of the observations may be a NaN."""
        signals = np.clip(np.rint(observations * self._factor), -self._limit, self._limit).astype(np.int16)
        (outputs,) = self._population.run([signals])
        actions: npt.NDArray[np.float32] = self._table[np.clip(outputs, -self._one, self._one) + self._middle]
        return actions
