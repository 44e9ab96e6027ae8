# SPDX-License-Identifier: MIT
"""What the trainings share of dealing with stable-baselines3, which is imported when it is first needed."""

from __future__ import annotations

import io
import random
import statistics
from typing import Any

import numpy as np

from bitneat.baselines.candidates import episode_seeds
from bitneat.baselines.dense import DenseNetwork
from bitneat.baselines.method import Floats, State

_WINDOW = 100
"""Episodes whose mean is shown."""


def normalized(num_envs: int, hardcore: bool = False, **options: Any) -> Any:
    """Walkers in the library's wrapper that normalises observations and rewards, with its ``options``."""
    from stable_baselines3.common.vec_env import VecNormalize

    from bitneat.baselines.vecenv import WalkerVecEnv

    return VecNormalize(WalkerVecEnv(num_envs, hardcore=hardcore), **options)


def silence(model: Any) -> None:
    """Let the library log nothing."""
    from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))


def recent_mean(model: Any) -> float | None:
    """The mean reward of the latest episodes; None if none has ended."""
    rewards = [float(info["r"]) for info in model.ep_info_buffer or ()][-_WINDOW:]
    return statistics.fmean(rewards) if rewards else None


def saved(model: Any, exclude: list[str] | None = None) -> bytes:
    """The library's own file of a model."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=exclude)
    return buffer.getvalue()


def array(tensor: Any) -> Floats:
    """A copy of a tensor."""
    return np.array(tensor.detach().numpy(), np.float32)


def layers_of(layers: list[Any], hidden: str, clipped: bool) -> DenseNetwork:
    """PyTorch's linear layers as a network."""
    weights = tuple(array(layer.weight) for layer in layers)
    return DenseNetwork(weights, tuple(array(layer.bias) for layer in layers), hidden, clipped)


def folded(dense: DenseNetwork, env: Any) -> DenseNetwork:
    """The network without the normalisation of ``env``, for plain observations; nothing is clipped."""
    return dense.folded(env.obs_rms.mean, np.sqrt(env.obs_rms.var + env.epsilon))


def moments_state(env: Any) -> State:
    """The statistics of `normalized`."""
    import torch

    return {
        name: [torch.tensor(moments.mean), torch.tensor(moments.var), float(moments.count)]
        for name, moments in (("observations", env.obs_rms), ("returns", env.ret_rms))
    }


def restore_moments(env: Any, state: State) -> None:
    """Take what `moments_state` gave."""
    for name, moments in (("observations", env.obs_rms), ("returns", env.ret_rms)):
        mean, variance, moments.count = state[name]
        # In place: others hold the same object.
        moments.mean, moments.var = mean.numpy(), variance.numpy()


def random_state() -> State:
    """The states of Python's, NumPy's and PyTorch's global generators, all of which the libraries draw from."""
    import torch

    name, keys, *rest = np.random.get_state()  # noqa: NPY002 - the libraries draw from it
    version, numbers, gauss = random.getstate()
    return {
        "torch": torch.get_rng_state(),
        "numpy": [name, torch.from_numpy(np.array(keys, np.int64)), *rest],
        "python": [version, list(numbers), gauss],
    }


def restore_random(state: State) -> None:
    """Take what `random_state` gave."""
    import torch

    name, keys, *rest = state["numpy"]
    version, numbers, gauss = state["python"]
    torch.set_rng_state(state["torch"])
    np.random.set_state((name, keys.numpy().astype(np.uint32), *rest))  # noqa: NPY002
    random.setstate((version, tuple(numbers), gauss))


def restart_seed(seed: int, steps: int) -> int:
    """For the episodes after an interruption: other ones than at the start, below the selection seeds."""
    return episode_seeds(seed, steps, 1)[0] // 2
