# SPDX-License-Identifier: MIT
"""Baselines by libraries for reinforcement learning, on the same walker and by the same protocol (needs ``bitneat[baselines]``).

Nothing here imports those libraries before `train` is called. See docs/baselines.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bitneat.baselines.result import BaselineResult
    from bitneat.baselines.training import TrainingProgress, load_result, train
else:

    def __getattr__(name: str) -> object:
        # NumPy and Gymnasium are loaded when one of these is first asked for.
        homes = {
            "BaselineResult": "result",
            "TrainingProgress": "training",
            "load_result": "training",
            "train": "training",
        }
        if name not in homes:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{homes[name]}"), name)


__all__ = ["BaselineResult", "TrainingProgress", "load_result", "train"]
