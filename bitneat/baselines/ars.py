# SPDX-License-Identifier: MIT
"""Augmented random search, by sb3-contrib."""

from __future__ import annotations

import pickle

import numpy as np
import numpy.typing as npt

from bitneat.baselines.candidates import Candidates
from bitneat.baselines.dense import DenseNetwork
from bitneat.baselines.method import Floats, Method, State
from bitneat.baselines.settings import ArsSettings
from bitneat.baselines.stable import (
    array,
    folded,
    moments_state,
    normalized,
    random_state,
    restore_moments,
    restore_random,
    saved,
    silence,
)


def start(settings: ArsSettings, seed: int) -> Method:
    """A training at its beginning. One that is restored goes on as if it had not stopped."""
    return _Ars(settings, seed)


class _Ars:
    def __init__(self, settings: ArsSettings, seed: int) -> None:
        from sb3_contrib import ARS

        # All episodes are those of the candidates; the library wants an environment for its spaces
        # and statistics, and resets it, which must not count.
        self._env = normalized(1, norm_reward=False, clip_obs=np.inf)
        self._env.training = False
        self.model = ARS(
            "LinearPolicy",
            self._env,
            n_delta=settings.n_delta,
            n_top=settings.n_top,
            learning_rate=settings.learning_rate,
            delta_std=settings.delta_std,
            alive_bonus_offset=settings.alive_bonus_offset,
            seed=seed,
            device="cpu",
        )
        silence(self.model)
        self._candidates = Candidates(seed, 2 * settings.n_delta, self._env.obs_rms, self._env.epsilon)

    @property
    def steps(self) -> int:
        return self._candidates.steps

    @property
    def episodes(self) -> int:
        return self._candidates.episodes

    @property
    def recent(self) -> float | None:
        returns = self._candidates.returns
        return float(returns.mean()) if len(returns) else None

    def advance(self) -> None:
        # One step more than there were is one update more.
        self.model.learn(1, log_interval=None, reset_num_timesteps=False, async_eval=self._candidates)
        self.model.num_timesteps = self.steps

    def state(self) -> State:
        c = self._candidates
        return {
            "weights": self.model.weights,
            "counts": [c.updates, c.episodes, c.steps],
            "normalization": moments_state(self._env),
            "random": random_state(),
        }

    def restore(self, state: State) -> None:
        self.model.weights = state["weights"]
        self.model.policy.load_from_vector(state["weights"])
        c = self._candidates
        c.updates, c.episodes, c.steps = state["counts"]
        self.model._n_updates, self.model.num_timesteps = c.updates, c.steps
        restore_moments(self._env, state["normalization"])
        restore_random(state["random"])

    def dense(self) -> DenseNetwork:
        weights = array(self.model.policy.action_net[0].weight)
        return folded(DenseNetwork((weights,), (np.zeros(len(weights), np.float32),)), self._env)

    def act(self, which: npt.NDArray[np.int32], observations: Floats) -> Floats:
        actions: Floats = self.model.predict(self._env.normalize_obs(observations), deterministic=True)[0]
        return actions

    def files(self) -> dict[str, bytes]:
        return {"model.zip": saved(self.model), "vecnormalize.pkl": pickle.dumps(self._env)}

    def close(self) -> None:
        self._env.close()
