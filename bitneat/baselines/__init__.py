# SPDX-License-Identifier: MIT
"""Baselines by libraries for reinforcement learning, on the same walker and by the same protocol (needs ``bitneat[baselines]``).

Nothing here imports those libraries before `train` is called. See docs/baselines.md.
"""

from bitneat.baselines.result import BaselineResult
from bitneat.baselines.settings import METHODS, ArsSettings, DqnSettings, PpoSettings
from bitneat.baselines.training import TrainingProgress, train

__all__ = ["METHODS", "ArsSettings", "BaselineResult", "DqnSettings", "PpoSettings", "TrainingProgress", "train"]
