# SPDX-License-Identifier: MIT
"""What a baseline's training came to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.baselines.actions import action_table
from bitneat.baselines.dense import DenseNetwork
from bitneat.baselines.evaluation import HeldOut
from bitneat.network import FloatNetwork


@dataclass(frozen=True, eq=False)
class BaselineResult:
    """A trained policy, its budget and its score; ``heldout_…`` are over the report seeds."""

    system: str
    """``ars``, ``ppo`` or ``dqn``."""
    seed: int
    steps: int
    """Steps of the environment that training took; the budget and at most one update's more."""
    episodes: int
    """Episodes that training finished."""
    dense: DenseNetwork
    """The deterministic policy in float32, normalisation of the observation folded in."""
    policy: FloatNetwork
    """The same as nodes and links. DQN's has an output for each of 81 actions, see `actions`."""
    heldout: HeldOut
    """The score of ``policy``."""
    by_library: HeldOut
    """The score of the library's own object in the same episodes."""
    settings: Mapping[str, Any]
    versions: Mapping[str, str]

    @property
    def actions(self) -> npt.NDArray[np.float32] | None:
        """The table of actions, (81, 4), that a policy chooses from; None for one whose four outputs are the action."""
        return action_table() if self.system == "dqn" else None

    @property
    def heldout_mean(self) -> float:
        """Mean official reward."""
        return self.heldout.mean

    @property
    def heldout_std(self) -> float:
        """Standard deviation of the episodes' rewards."""
        return self.heldout.std

    @property
    def parameters(self) -> int:
        """Weights and biases of the policy."""
        return self.dense.parameters

    @property
    def float_bytes(self) -> int:
        """What they take in float32."""
        return self.dense.float_bytes

    @property
    def links(self) -> int:
        """Of the policy's network: its weights."""
        return self.policy.num_links

    @property
    def nodes(self) -> int:
        """Of the policy's network, outputs included, inputs not."""
        return len(self.policy.nodes)

    def to_data(self) -> dict[str, Any]:
        """All but the policy's numbers, as plain data."""
        return {
            "system": self.system,
            "seed": self.seed,
            "steps": self.steps,
            "episodes": self.episodes,
            "held_out": self.heldout.to_data(),
            "library_held_out": self.by_library.to_data(),
            "parameters": self.parameters,
            "float_bytes": self.float_bytes,
            "links": self.links,
            "nodes": self.nodes,
            "hidden": self.dense.hidden,
            "settings": dict(self.settings),
            "versions": dict(self.versions),
        }
