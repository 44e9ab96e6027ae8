# SPDX-License-Identifier: MIT
"""Simulators: Gymnasium environments, and episodes of a controller in them."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bitneat.sim.walker import WalkerVectorEnv
else:

    def __getattr__(name: str) -> object:
        # Gymnasium is loaded when the class is first asked for.
        if name != "WalkerVectorEnv":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module(f"{__name__}.walker").WalkerVectorEnv


__all__ = ["WalkerVectorEnv"]
