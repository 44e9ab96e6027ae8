# SPDX-License-Identifier: MIT
"""The settings of each method: those that rl-baselines3-zoo publishes, where it has any for BipedalWalker-v3.

What is not named here has the library's default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class ArsSettings:
    """Augmented random search with a linear policy without bias, observations normalised.

    Numbers of perturbations and the offset are the zoo's for BipedalWalker-v3. Its standard deviation of 0.0075 and learning rate
    of 0.02 are for a network of 16 hidden nodes; with them a linear policy still fell after 8.5 million steps.
    """

    n_delta: int = 64
    n_top: int = 32
    learning_rate: float = 0.05
    delta_std: float = 0.1
    alive_bonus_offset: float = -0.1
    """Added to the reward of every step in training."""


@dataclass(frozen=True)
class PpoSettings:
    """Proximal policy optimisation; observations and rewards normalised. All are the zoo's for BipedalWalker-v3."""

    n_envs: int = 32
    n_steps: int = 2048
    """Of each environment between two updates; fewer where the budget is less."""
    batch_size: int = 64
    n_epochs: int = 10
    learning_rate: float = 3e-4
    gamma: float = 0.999
    gae_lambda: float = 0.95
    clip_range: float = 0.18
    ent_coef: float = 0.0
    hidden: tuple[int, ...] = (64, 64)
    """Of tanh: the library's default."""
    clip_observation: float = 10.0
    log_std_init: float = 0.0
    """Logarithm of the actions' standard deviation at the start."""


HARDCORE_PPO = PpoSettings(
    n_envs=256, n_steps=128, batch_size=4096, n_epochs=5, gamma=0.99, clip_range=0.2, ent_coef=0.001, log_std_init=-0.5
)
"""For BipedalWalkerHardcore-v3. The zoo's (16 walkers, batches of 64, 10 epochs) take 10^8 steps to 122, and many hours."""


@dataclass(frozen=True)
class DqnSettings:
    """Deep Q-learning over a table of 81 actions.

    The zoo has none for this walker, whose actions are no finite set. These are its for LunarLander-v2, but for
    the hidden layers: they are the library's default, and as many as PPO has.
    """

    learning_rate: float = 6.3e-4
    batch_size: int = 128
    buffer_size: int = 50_000
    learning_starts: int = 0
    gamma: float = 0.99
    target_update_interval: int = 250
    train_freq: int = 4
    gradient_steps: int = -1
    """As many as steps were taken."""
    exploration_fraction: float = 0.12
    exploration_final_eps: float = 0.1
    hidden: tuple[int, ...] = (64, 64)
    """Of ReLU."""


Settings = ArsSettings | PpoSettings | DqnSettings

METHODS: Mapping[str, type[ArsSettings] | type[PpoSettings] | type[DqnSettings]] = {
    "ars": ArsSettings,
    "ppo": PpoSettings,
    "dqn": DqnSettings,
}
"""The methods by name, with their settings."""

HARDCORE_STEPS = 100_000_000
"""Budget of PPO in BipedalWalkerHardcore-v3."""

DEFAULT_STEPS: Mapping[str, int] = {"ars": 20_000_000, "ppo": 5_000_000, "dqn": 1_000_000}
"""Budgets in steps of the environment, where none is given."""
