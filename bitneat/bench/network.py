# SPDX-License-Identifier: MIT
"""The network that is measured: as many inputs and outputs as the walker, 100 ternary links, none of them dead."""

from __future__ import annotations

import random

from bitneat.champion import Champion, EnvironmentSpec
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Output, Signal

NUM_INPUTS = 24
NUM_HIDDEN = 27
NUM_OUTPUTS = 4
NUM_LINKS = 100
INPUT_LIMIT = 2047


def hundred_links() -> Controller:
    """Return the network, the same every time: 31 clamped nodes, each fed by something and read by something."""
    draw = random.Random(100)
    first_output = NUM_INPUTS + NUM_HIDDEN
    last = first_output + NUM_OUTPUTS
    links: set[tuple[int, int]] = set()  # (source, node)
    for node in range(NUM_INPUTS, last):
        links.add((draw.randrange(min(node, first_output)), node))
    for hidden in range(NUM_INPUTS, first_output):
        links.add((hidden, draw.randrange(hidden + 1, last)))
    while len(links) < NUM_LINKS:
        node = draw.randrange(NUM_INPUTS, last)
        links.add((draw.randrange(min(node, first_output)), node))
    nodes = [
        Node(tuple(Link(source, sign=draw.choice((-1, 1))) for source, to in sorted(links) if to == node))
        for node in range(NUM_INPUTS, last)
    ]
    outputs: list[Output] = [Signal(node) for node in range(first_output, last)]
    controller = Controller(tuple(Input(limit=INPUT_LIMIT) for _ in range(NUM_INPUTS)), tuple(nodes), tuple(outputs), 8)
    return controller.canonical


def champion_of(controller: Controller) -> Champion:
    """Return a walker's champion with this controller, as `bitneat codegen` reads it."""
    action = BoxAction((-1.0,) * NUM_OUTPUTS, (1.0,) * NUM_OUTPUTS, (NUM_OUTPUTS,), "float32")
    return Champion(controller, action, EnvironmentSpec("BipedalWalker-v3"), {})
