# SPDX-License-Identifier: MIT
"""Random float networks."""

from __future__ import annotations

import random
from collections.abc import Sequence

from hypothesis import strategies as st

from bitneat.network import FloatNetwork, FloatNode

LIPSCHITZ = ("clamped", "hat", "abs", "relu", "identity")
"""Activations that never stretch a difference."""


def random_network(
    seed: int,
    *,
    inputs: int = 4,
    hidden: int = 5,
    outputs: int = 2,
    largest: float = 1.0,
    activations: Sequence[str] = LIPSCHITZ,
    whole: bool = False,
) -> FloatNetwork:
    """A network whose nodes read anything before them; with integers for weights and biases if ``whole``."""
    rng = random.Random(seed)

    def number() -> float:
        value = rng.uniform(-largest, largest)
        return float(round(value)) if whole else value

    nodes = []
    for index in range(inputs, inputs + hidden + outputs):
        sources = rng.sample(range(index), min(index, rng.randint(1, 5)))
        nodes.append(FloatNode(tuple((s, number()) for s in sources), number(), 1.0, rng.choice(activations)))
    first = inputs + hidden
    return FloatNetwork(inputs, tuple(nodes), tuple(range(first, first + outputs)))


@st.composite
def linear_networks(draw: st.DrawFn, *, inputs: int = 5, outputs: int = 2, largest: float = 8.0) -> FloatNetwork:
    """One layer, whose outputs are not clipped."""
    numbers = st.floats(-largest, largest, allow_subnormal=False)
    nodes = tuple(
        FloatNode(
            tuple(enumerate(draw(st.lists(numbers, min_size=inputs, max_size=inputs)))), draw(numbers), 1.0, "identity"
        )
        for _ in range(outputs)
    )
    return FloatNetwork(inputs, nodes, tuple(range(inputs, inputs + outputs)))
