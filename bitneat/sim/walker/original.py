# SPDX-License-Identifier: MIT
"""What the native walker stands for: the environments it serves, and the Gymnasium it was written after."""

from __future__ import annotations

import hashlib
import inspect
from functools import cache

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.sim import bipedal
from bitneat.sim.walker.binding import library

_KNOWN_SOURCE = "bbc717eeff5f564e20fca9f2dfd414bdeb896c9e440e8e3a80dfa2d56cd52592"
"""SHA-256 of those parts of Gymnasium 1.4's source that `bipedal.serves` does not look at, but the C repeats."""


def obstacle(spec: EnvironmentSpec) -> str | None:
    """Why the native walker cannot take the place of an environment, in one line; None if it can."""
    if not bipedal.is_walker(spec):
        wrong = "" if spec.id not in bipedal.IDS else f" with {', '.join(f'{k}={v!r}' for k, v in spec.kwargs.items())}"
        return f"serves {' and '.join(bipedal.IDS)}, with no argument but hardcore=True or False, not {spec.id}{wrong}"
    if not bipedal.serves(spec) or _digest() != _KNOWN_SOURCE:
        return f"{spec.id} is not the one of Gymnasium 1.4, after which the native walker was written"
    try:
        library()
    except BitneatError as error:
        return str(error)
    return None


@cache
def _digest() -> str:
    """Of everything before the class (constants, shapes, the contact listener), and of the ground's making."""
    from gymnasium.envs.box2d import bipedal_walker as original

    source = inspect.getsource(original)
    parts = [source[source.find("\nFPS = ") : source.find("\nclass BipedalWalker(")]]
    parts += [
        inspect.getsource(getattr(original.BipedalWalker, name)) for name in ("_generate_terrain", "_generate_clouds")
    ]
    return hashlib.sha256("".join(parts).encode()).hexdigest()
