# SPDX-License-Identifier: MIT
"""bitneat: evolve ternary neural controllers and deploy them as C that only adds and subtracts.

The functions are those of `bitneat.api`, imported when they are first used, so that a command line starts quickly.
"""

from importlib import import_module
from typing import Any

from bitneat.version import __version__

_API = (
    "Agent", "Environment", "Evolved", "evaluate", "generate", "load", "load_any", "pack", "resume", "save", "size", "unpack",
)  # fmt: skip
_ELSEWHERE = {
    "BitneatError": "bitneat.errors",
    "Champion": "bitneat.champion",
    "Controller": "bitneat.controller",
    "EnvironmentSpec": "bitneat.champion",
    "FloatChampion": "bitneat.champion",
}
_CALLABLE = ("evolve", "verify")
"""Packages that are functions, too; see `bitneat.callable`."""

__all__ = ["__version__", *_API, *_ELSEWHERE, *_CALLABLE]  # noqa: PLE0604 - all are strings


def __getattr__(name: str) -> Any:
    if name in _CALLABLE:
        return import_module(f"bitneat.{name}")
    if name in _API or name in _ELSEWHERE:
        return getattr(import_module(_ELSEWHERE.get(name, "bitneat.api")), name)
    raise AttributeError(f"module 'bitneat' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
