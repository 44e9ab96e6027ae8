# SPDX-License-Identifier: MIT
"""Random input vectors over the whole declared domain, which an episode only sees a part of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller

SEQUENCE = 100
"""Steps from reset to reset, for controllers with state."""


def random_vectors(controller: Controller, seed: int, count: int) -> npt.NDArray[np.int16]:
    """Input vectors (count, inputs), each within the limits: extremes first, then of every magnitude.

    A third is uniform over the domain, a third is small or large by its number of bits, a third stands at the places where
    something changes: 0, ±1, ±One and next to it, ±the limit.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    limits = np.array([entry.limit for entry in controller.inputs], dtype=np.int64)
    shape = (count, len(limits))
    uniform = rng.integers(-limits, limits, size=shape, endpoint=True)
    magnitude = (1 << rng.integers(0, 16, size=(count, 1))) - 1
    sized = rng.integers(-magnitude, magnitude, size=shape, endpoint=True)
    one = controller.one
    marks = np.array([0, 1, one - 1, one, one + 1, 32767])
    marked = rng.choice(marks, size=shape) * rng.choice((-1, 1), size=shape)
    kinds = rng.integers(0, 3, size=(count, 1))
    vectors = np.select([kinds == 0, kinds == 1], [uniform, sized], marked)
    extremes = np.array([limits, -limits, 0 * limits])[:count]
    vectors[: len(extremes)] = extremes
    clipped: npt.NDArray[np.int16] = np.clip(vectors, -limits, limits).astype(np.int16)
    return clipped
