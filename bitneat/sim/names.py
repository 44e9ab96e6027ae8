# SPDX-License-Identifier: MIT
"""What the components of observations and actions are called, for environments whose documentation says so."""

from __future__ import annotations

from bitneat.champion import EnvironmentSpec

_LEG = ("hip {0} angle", "hip {0} speed", "knee {0} angle", "knee {0} speed", "leg {0} contact")
_WALKER = (
    *("hull angle", "hull angular speed", "horizontal speed", "vertical speed"),
    *(name.format(leg) for leg in (1, 2) for name in _LEG),
    *(f"lidar {ray}" for ray in range(10)),
)
_LANDER = ("x", "y", "x speed", "y speed", "angle", "angular speed", "left leg contact", "right leg contact")

_OBSERVATIONS: dict[str, tuple[str, ...]] = {
    "BipedalWalker": _WALKER,
    "BipedalWalkerHardcore": _WALKER,
    "LunarLander": _LANDER,
    "LunarLanderContinuous": _LANDER,
    "CartPole": ("cart position", "cart speed", "pole angle", "pole angular speed"),
    "Acrobot": (
        "cos of joint 1",
        "sin of joint 1",
        "cos of joint 2",
        "sin of joint 2",
        "joint 1 speed",
        "joint 2 speed",
    ),
    "Pendulum": ("cos of angle", "sin of angle", "angular speed"),
    "MountainCar": ("position", "speed"),
    "MountainCarContinuous": ("position", "speed"),
}
_ACTIONS: dict[str, tuple[tuple[str, ...], ...]] = {
    "BipedalWalker": (("hip 1", "knee 1", "hip 2", "knee 2"),),
    "BipedalWalkerHardcore": (("hip 1", "knee 1", "hip 2", "knee 2"),),
    "LunarLander": (("nothing", "left engine", "main engine", "right engine"), ("main engine", "side engines")),
    "LunarLanderContinuous": (("main engine", "side engines"),),
    "CartPole": (("left", "right"),),
    "Acrobot": (("torque -1", "torque 0", "torque 1"),),
    "Pendulum": (("torque",),),
    "MountainCar": (("left", "nothing", "right"),),
    "MountainCarContinuous": (("force",),),
}
"""By number of outputs where an environment has both kinds of action."""


def input_names(spec: EnvironmentSpec | None, count: int) -> tuple[str, ...]:
    """A name for each of ``count`` inputs: the environment's own, or ``input 0`` and so on."""
    known = _OBSERVATIONS.get(_family(spec), ())
    return known if len(known) == count else tuple(f"input {i}" for i in range(count))


def output_names(spec: EnvironmentSpec | None, count: int) -> tuple[str, ...]:
    """A name for each of ``count`` outputs: the environment's own, or ``output 0`` and so on."""
    known = [names for names in _ACTIONS.get(_family(spec), ()) if len(names) == count]
    return known[0] if known else tuple(f"output {i}" for i in range(count))


def _family(spec: EnvironmentSpec | None) -> str:
    """The id without its version: versions of one environment have the same components here."""
    return "" if spec is None else spec.id.rpartition("-v")[0]
