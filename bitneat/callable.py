# SPDX-License-Identifier: MIT
"""Packages that can be called: `bitneat.evolve(...)` and `bitneat.verify(...)` are functions of the package's own name.

Importing ``bitneat.evolve.run`` binds the package to the name ``bitneat.evolve``, whatever else stood there, so that a function
of that name would be there or not by what was imported before it. A package that passes calls on is right either way.
"""

from __future__ import annotations

import inspect
import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class _CallablePackage(ModuleType):
    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self._function(*arguments, **named)

    @property
    def _function(self) -> Any:
        # By its name: what a package may import does not grow by what it passes calls on to.
        return getattr(import_module("bitneat.api"), self.__name__.rpartition(".")[2])

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self._function)


def make_callable(package: str) -> None:
    """Let a package, which is being imported, be called as the function of its name in `bitneat.api`."""
    sys.modules[package].__class__ = _CallablePackage
