# SPDX-License-Identifier: MIT
"""A student that goes on by itself: proximal policy optimisation (stable-baselines3), before its weights become integers.

Imitation ends where a small network cannot follow its teacher; from there on the reward says what of the teacher's walk it can do
without. The policy is `bitneat.distill.student.Student` with real weights: with integers, each of which moves the actions by much,
the same training made students worse. Observations are not normalised, since the controller gets them as they are.

Importing this needs PyTorch and stable-baselines3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from bitneat.baselines.stable import (
    random_state,
    recent_mean,
    restart_seed,
    restore_random,
    silence,
)
from bitneat.baselines.vecenv import WalkerVecEnv
from bitneat.distill.student import Student

_LEAST_RATE = 0.02
"""Of the learning rate, at the end."""


@dataclass(frozen=True)
class ReinforceSettings:
    """How to go on; what is not named here has the library's default."""

    steps: int = 0
    """Of the environment; none leaves the student as it is."""
    walkers: int = 256
    steps_an_update: int = 128
    """Of each walker."""
    batch: int = 1024
    epochs: int = 6
    learning_rate: float = 3e-4
    """At the start; it falls to a fiftieth of it."""
    gamma: float = 0.99
    clip_range: float = 0.2
    entropy: float = 0.001
    log_std: float = -1.5
    """Logarithm of the actions' standard deviation at the start."""
    learn_std: bool = True
    """Whether the standard deviation is trained, too."""
    fall: float = -60.0
    """What a fall counts in training. At the official -100 a student that mostly falls may learn to stand still."""
    stall_steps: int = 0
    """As of `WalkerVecEnv`: to stand still is as bad as to fall."""
    stall_gain: float = 3.0
    """As of `WalkerVecEnv`; a whole course is worth 300."""
    critic_first: int = 10
    """Updates in which only the critic learns, which knows nothing at first."""
    settle_part: float = 0.125
    """Of the steps, so many more after each layer that has become integers but the last: the layers above learn to live with it."""
    settle_rate: float = 1e-4
    """The learning rate at the start of those."""

    @classmethod
    def going_on(cls, steps: int) -> ReinforceSettings:
        """For a student that walks already, and has more to lose.

        Its critic learns longer before it does, its rate is lower, and its noise stays as it is: where that was trained it all but
        vanished, and the same steps of the weights became too large for it. It looks further ahead, and must not stand still.
        """
        return cls(
            steps,
            batch=2048,
            learning_rate=1e-4,
            gamma=0.995,
            log_std=-2.3,
            learn_std=False,
            stall_steps=120,
            critic_first=75,
        )

    def steps_with(self, rounded_layers: int) -> int:
        """How many to take with so many layers of integers."""
        return math.ceil(self.steps * self.settle_part) if rounded_layers else self.steps


class _Extractor(nn.Module):
    """The student as actor, and a critic of its own."""

    def __init__(self, student: Student, inputs: int) -> None:
        super().__init__()
        self.actor = student
        self.critic = nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = student.num_outputs, 64

    def forward(self, features: Any) -> tuple[Any, Any]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Any) -> Any:
        return self.actor.before_clamping(features)

    def forward_critic(self, features: Any) -> Any:
        return self.critic(features)


class _Policy(ActorCriticPolicy):
    """The actor's outputs are the actions' means as they are."""

    def __init__(self, *arguments: Any, student: Student, **options: Any) -> None:
        self._student = [student]  # in a list, so that it is no submodule yet
        super().__init__(*arguments, ortho_init=False, **options)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Extractor(self._student[0], self.features_dim)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


class Reinforcement:
    """A training of a student, which it changes in place; layers of integers stay as they are.

    In one that is restored episodes begin anew; all else goes on.
    """

    def __init__(self, student: Student, hardcore: bool, settings: ReinforceSettings, seed: int) -> None:
        self.student, self.hardcore, self._settings = student, hardcore, settings
        student.quantize(False)
        walkers = WalkerVecEnv(
            settings.walkers,
            hardcore=hardcore,
            fall_value=settings.fall,
            stall_steps=settings.stall_steps,
            stall_gain=settings.stall_gain,
        )
        self._env = VecNormalize(walkers, norm_obs=False, gamma=settings.gamma)
        self._model = PPO(
            _Policy,
            self._env,
            n_steps=settings.steps_an_update,
            batch_size=settings.batch,
            n_epochs=settings.epochs,
            learning_rate=settings.learning_rate,
            gamma=settings.gamma,
            clip_range=settings.clip_range,
            ent_coef=settings.entropy,
            policy_kwargs={"log_std_init": settings.log_std, "student": student},
            seed=seed,
            device="cpu",
        )
        silence(self._model)
        self._model.policy.log_std.requires_grad_(settings.learn_std)
        self._updates = 0
        self._begun = 0

    @property
    def steps(self) -> int:
        """Of the environment so far."""
        return int(self._model.num_timesteps)

    @property
    def _part(self) -> float:
        """How much is done of the steps to take with as many layers of integers as there are."""
        return (self.steps - self._begun) / max(self._settings.steps_with(self.student.rounded_layers), 1)

    @property
    def done(self) -> bool:
        """Whether all steps are taken that are to be taken with as many layers of integers as there are."""
        return self._part >= 1.0

    @property
    def settled(self) -> bool:
        """Whether no layer is to be rounded before the last."""
        return self._settings.settle_part == 0.0 or self.student.rounded_layers >= len(self.student.layers) - 1

    def adopt(self, rounded: Student) -> None:
        """Go on with the student as it has become by rounding a layer."""
        self.student.adopt(rounded)
        self._begun = self.steps

    @property
    def recent(self) -> float | None:
        """Mean official reward of the latest episodes, explored ones; None if none has ended."""
        return recent_mean(self._model)

    def advance(self) -> None:
        """One update."""
        settings = self._settings
        for layer in self.student.layers:
            layer.requires_grad_(self._updates >= settings.critic_first and not layer.quantized)
        first = settings.settle_rate if self.student.rounded_layers else settings.learning_rate
        rate = first * max(1.0 - self._part, _LEAST_RATE)
        self._model.lr_schedule = lambda progress: rate  # the library's own knows nothing of later calls of learn
        chunk = settings.walkers * settings.steps_an_update
        self._model.learn(chunk, log_interval=None, reset_num_timesteps=False)
        self._updates += 1

    def state(self) -> dict[str, Any]:
        """All that `restore` needs: tensors and plain data."""
        returns = self._env.ret_rms
        return {
            "counts": [self.steps, int(self._model._n_updates), self._updates, self._begun],
            "student": self.student.state(),
            "rounded_layers": self.student.rounded_layers,
            "parameters": self._model.get_parameters(),
            "returns": [float(x) for x in (returns.mean, returns.var, returns.count)],
            "random": random_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        self._model.num_timesteps, self._model._n_updates, self._updates, self._begun = state["counts"]
        student = Student.from_state(
            state["student"], self.student.hidden, self.student.num_outputs, self.student.planes
        )
        for layer in list(student.layers)[: state["rounded_layers"]]:
            layer.quantized = True
        self.student.adopt(student)
        self._model.set_parameters(state["parameters"], device="cpu")
        returns = self._env.ret_rms
        returns.mean, returns.var = (np.array(x) for x in state["returns"][:2])
        returns.count = state["returns"][2]
        restore_random(state["random"])
        self._env.seed(restart_seed(self._model.seed, self.steps))

    def close(self) -> None:
        """Let go of the walkers."""
        self._env.close()
