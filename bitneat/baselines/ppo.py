# SPDX-License-Identifier: MIT
"""Proximal policy optimisation, by stable-baselines3."""

from __future__ import annotations

import math
import pickle

import numpy as np
import numpy.typing as npt

from bitneat.baselines.dense import DenseNetwork
from bitneat.baselines.method import Floats, Method, State
from bitneat.baselines.settings import PpoSettings
from bitneat.baselines.stable import (
    folded,
    layers_of,
    moments_state,
    normalized,
    random_state,
    recent_mean,
    restart_seed,
    restore_moments,
    restore_random,
    saved,
    silence,
)


def start(settings: PpoSettings, steps: int, seed: int, hardcore: bool = False) -> Method:
    """A training of ``steps`` steps at its beginning. In one that is restored episodes begin anew; all else goes on."""
    return _Ppo(settings, steps, seed, hardcore)


class _Ppo:
    def __init__(self, settings: PpoSettings, steps: int, seed: int, hardcore: bool) -> None:
        from stable_baselines3 import PPO
        from torch import nn

        self._env = normalized(settings.n_envs, hardcore, gamma=settings.gamma, clip_obs=settings.clip_observation)
        self._chunk = _rollout(settings, steps) * settings.n_envs
        hidden = list(settings.hidden)
        self.model = PPO(
            "MlpPolicy",
            self._env,
            n_steps=self._chunk // settings.n_envs,
            batch_size=settings.batch_size,
            n_epochs=settings.n_epochs,
            learning_rate=settings.learning_rate,
            gamma=settings.gamma,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip_range,
            ent_coef=settings.ent_coef,
            policy_kwargs={
                "net_arch": {"pi": hidden, "vf": hidden},
                "activation_fn": nn.Tanh,
                "log_std_init": settings.log_std_init,
            },
            seed=seed,
            device="cpu",
        )
        silence(self.model)
        self._episodes_before = 0

    @property
    def steps(self) -> int:
        return int(self.model.num_timesteps)

    @property
    def episodes(self) -> int:
        return self._episodes_before + int(self._env.venv.episodes)

    @property
    def recent(self) -> float | None:
        return recent_mean(self.model)

    def advance(self) -> None:
        self.model.learn(self._chunk, log_interval=None, reset_num_timesteps=False)

    def state(self) -> State:
        return {
            "counts": [self.steps, int(self.model._n_updates), self.episodes],
            "parameters": self.model.get_parameters(),
            "normalization": moments_state(self._env),
            "random": random_state(),
        }

    def restore(self, state: State) -> None:
        self.model.num_timesteps, self.model._n_updates, self._episodes_before = state["counts"]
        self.model.set_parameters(state["parameters"], device="cpu")
        restore_moments(self._env, state["normalization"])
        restore_random(state["random"])
        self._env.seed(restart_seed(self.model.seed, self.steps))

    def dense(self) -> DenseNetwork:
        policy = self.model.policy
        layers = [*(layer for layer in policy.mlp_extractor.policy_net if hasattr(layer, "weight")), policy.action_net]
        return folded(layers_of(layers, "tanh", clipped=True), self._env)

    def act(self, which: npt.NDArray[np.int32], observations: Floats) -> Floats:
        actions: Floats = self.model.predict(self._env.normalize_obs(observations), deterministic=True)[0]
        return actions

    def files(self) -> dict[str, bytes]:
        return {"model.zip": saved(self.model), "vecnormalize.pkl": pickle.dumps(self._env)}

    def close(self) -> None:
        self._env.close()


def _rollout(settings: PpoSettings, steps: int) -> int:
    """Steps of each environment between two updates: fewer where the budget is less, but whole batches."""
    unit = settings.batch_size // math.gcd(settings.batch_size, settings.n_envs)
    return min(settings.n_steps, unit * math.ceil(steps / (unit * settings.n_envs)))
