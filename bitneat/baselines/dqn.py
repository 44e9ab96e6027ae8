# SPDX-License-Identifier: MIT
"""Deep Q-learning over a table of actions, by stable-baselines3."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bitneat.baselines.actions import action_table
from bitneat.baselines.dense import DenseNetwork
from bitneat.baselines.method import Floats, Method, State
from bitneat.baselines.settings import DqnSettings
from bitneat.baselines.stable import (
    layers_of,
    random_state,
    recent_mean,
    restart_seed,
    restore_random,
    saved,
    silence,
)

_CHUNK = 10_000
"""Steps between two looks at it."""
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def start(settings: DqnSettings, steps: int, seed: int) -> Method:
    """A training of ``steps`` steps at its beginning.

    In one that is restored the episode begins anew; all else goes on, the replay buffer too.
    """
    return _Dqn(settings, steps, seed)


class _Dqn:
    def __init__(self, settings: DqnSettings, steps: int, seed: int) -> None:
        from stable_baselines3 import DQN

        from bitneat.baselines.vecenv import WalkerVecEnv

        self._table = action_table()
        self._env = WalkerVecEnv(1, self._table)
        self._settings, self._budget = settings, steps
        self.model = DQN(
            "MlpPolicy",
            self._env,
            learning_rate=settings.learning_rate,
            batch_size=settings.batch_size,
            buffer_size=settings.buffer_size,
            learning_starts=settings.learning_starts,
            gamma=settings.gamma,
            target_update_interval=settings.target_update_interval,
            train_freq=settings.train_freq,
            gradient_steps=settings.gradient_steps,
            exploration_fraction=settings.exploration_fraction,
            exploration_final_eps=settings.exploration_final_eps,
            policy_kwargs={"net_arch": list(settings.hidden)},
            seed=seed,
            device="cpu",
        )
        silence(self.model)
        # The library's schedule runs to the end of one call of `learn`; this one to the end of the budget.
        self.model.exploration_schedule = self._exploration
        self._episodes_before = 0

    def _exploration(self, _: float) -> float:
        done = self.steps / (self._settings.exploration_fraction * self._budget)
        return 1.0 + min(done, 1.0) * (self._settings.exploration_final_eps - 1.0)

    @property
    def steps(self) -> int:
        return int(self.model.num_timesteps)

    @property
    def episodes(self) -> int:
        return self._episodes_before + self._env.episodes

    @property
    def recent(self) -> float | None:
        return recent_mean(self.model)

    def advance(self) -> None:
        chunk = min(_CHUNK, self._budget - self.steps)
        self.model.learn(chunk, log_interval=None, reset_num_timesteps=False)

    def state(self) -> State:
        import torch

        buffer = self.model.replay_buffer
        filled = buffer.buffer_size if buffer.full else buffer.pos
        return {
            "counts": [self.steps, int(self.model._n_updates), self.episodes, int(self.model._n_calls)],
            "parameters": self.model.get_parameters(),
            "buffer": {name: torch.from_numpy(getattr(buffer, name)[:filled]) for name in _BUFFER},
            "position": [int(buffer.pos), int(buffer.full)],
            "random": random_state(),
        }

    def restore(self, state: State) -> None:
        model, buffer = self.model, self.model.replay_buffer
        model.num_timesteps, model._n_updates, self._episodes_before, model._n_calls = state["counts"]
        model.set_parameters(state["parameters"], device="cpu")
        for name in _BUFFER:
            values = state["buffer"][name].numpy()
            getattr(buffer, name)[: len(values)] = values
        buffer.pos, buffer.full = state["position"][0], bool(state["position"][1])
        model.exploration_rate = self._exploration(0.0)
        restore_random(state["random"])
        restart = restart_seed(model.seed, self.steps)
        self._env.seed(restart)
        model.action_space.seed(restart)

    def dense(self) -> DenseNetwork:
        layers = [layer for layer in self.model.policy.q_net.q_net if hasattr(layer, "weight")]
        return layers_of(layers, "relu", clipped=False)

    def act(self, which: npt.NDArray[np.int32], observations: Floats) -> Floats:
        actions: Floats = self._table[self.model.predict(observations, deterministic=True)[0]]
        return actions

    def files(self) -> dict[str, bytes]:
        return {"model.zip": saved(self.model, exclude=["exploration_schedule"])}

    def close(self) -> None:
        self._env.close()
