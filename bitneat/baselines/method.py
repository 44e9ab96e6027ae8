# SPDX-License-Identifier: MIT
"""What every method of training offers to `bitneat.baselines.training`.

A `Method`'s state is a dict of tensors, numbers and lists of these, which ``torch.load(weights_only=True)`` reads without running
anything.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bitneat.baselines.dense import DenseNetwork

Floats = npt.NDArray[np.float32]
State = dict[str, Any]


class Method(Protocol):
    """A training under way."""

    model: Any
    """The library's object."""

    @property
    def steps(self) -> int:
        """Of the environment so far."""

    @property
    def episodes(self) -> int:
        """Ended so far."""

    @property
    def recent(self) -> float | None:
        """Mean reward of the latest episodes, explored ones; None if none has ended."""

    def advance(self) -> None:
        """Train on a little more."""

    def state(self) -> State:
        """All that `restore` needs."""

    def restore(self, state: State) -> None:
        """Go on where `state` was taken."""

    def dense(self) -> DenseNetwork:
        """The deterministic policy, normalisation folded in."""

    def act(self, which: npt.NDArray[np.int32], observations: Floats) -> Floats:
        """The same by the library: observations (n, 24) to actions (n, 4)."""

    def files(self) -> dict[str, bytes]:
        """What the library keeps of a training, by name of file."""

    def close(self) -> None:
        """Let go of the walkers."""
