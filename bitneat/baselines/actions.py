# SPDX-License-Identifier: MIT
"""A finite set of the walker's actions, for methods that choose one of so many."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

LEVELS = (-1.0, 0.0, 1.0)
"""Of the torque that one joint's motor is asked for."""


def action_table(joints: int = 4, levels: tuple[float, ...] = LEVELS) -> npt.NDArray[np.float32]:
    """Every combination of levels, (len(levels) ** joints, joints); the last joint changes fastest."""
    return np.array(list(product(levels, repeat=joints)), np.float32)
