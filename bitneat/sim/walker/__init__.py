# SPDX-License-Identifier: MIT
"""BipedalWalker in C: bit for bit Gymnasium's, several walkers at a time. See docs/simulator.md."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bitneat.sim.walker.episodes import run_episodes
    from bitneat.sim.walker.vector import WalkerVectorEnv
else:

    def __getattr__(name: str) -> object:
        # Gymnasium and the controllers are loaded when one of these is first asked for.
        homes = {"WalkerVectorEnv": "vector", "run_episodes": "episodes"}
        if name not in homes:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{homes[name]}"), name)


__all__ = ["WalkerVectorEnv", "run_episodes"]
