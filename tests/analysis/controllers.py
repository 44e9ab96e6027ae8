# SPDX-License-Identifier: MIT
"""The controllers whose C is analysed: the committed champions, one with every activation, and random ones with every feature."""

from __future__ import annotations

import random
from pathlib import Path

from bitneat.codegen import STYLES
from bitneat.controller import ACTIVATION_NAMES, Constant, Controller, Input, Link, Node, Signal
from tests.strategies import random_controller

__all__ = ["CHAMPIONS", "STYLES", "one_of_each", "rich_controller"]

_EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CHAMPIONS = {
    f"{path.parent.name}-{path.stem}": path
    for path in sorted([_EXAMPLES / "walker" / "champion.pkl", *(_EXAMPLES / "champions").glob("*.pkl")])
}


def rich_controller(seed: int) -> Controller:
    """A small random controller with a path to an output: ternary if the seed is even, without memory if it is a multiple of 3."""
    rng = random.Random(seed)
    while True:
        controller = random_controller(
            rng, size="small", ternary=seed % 2 == 0, feed_forward=seed % 3 == 0, num_nodes=8
        )
        if not all(isinstance(output, Constant) for output in controller.canonical.outputs):
            return controller


def one_of_each(frac_bits: int) -> Controller:
    """A controller with a node of each activation, behind sums that can be anything."""
    nodes = tuple(
        Node((Link(0), Link(1, 0, 2, -1)), gain=index % 3 - 1, activation=name)
        for index, name in enumerate(ACTIVATION_NAMES)
    )
    outputs = tuple(Signal(2 + index) for index in range(len(nodes)))
    return Controller((Input(), Input()), nodes, outputs, frac_bits)
