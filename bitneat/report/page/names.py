# SPDX-License-Identifier: MIT
"""What the components of Gymnasium's observations and actions are called, in the order of its documentation."""

from __future__ import annotations

from bitneat.sim.bipedal import IDS

_WALKER = (
    *("hull angle", "hull turn", "velocity x", "velocity y"),
    *(f"{what} {leg}" for leg in (1, 2) for what in ("hip angle", "hip speed", "knee angle", "knee speed", "contact")),
    *(f"ray {ray}" for ray in range(10)),
)
_OBSERVATIONS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(IDS, _WALKER),
    **dict.fromkeys(("CartPole-v0", "CartPole-v1"), ("position", "velocity", "pole angle", "pole turn")),
    **dict.fromkeys(
        ("LunarLander-v3", "LunarLanderContinuous-v3"),
        ("x", "y", "velocity x", "velocity y", "angle", "turn", "contact 1", "contact 2"),
    ),
    "Pendulum-v1": ("cos angle", "sin angle", "turn"),
    **dict.fromkeys(("MountainCar-v0", "MountainCarContinuous-v0"), ("position", "velocity")),
    "Acrobot-v1": ("cos angle 1", "sin angle 1", "cos angle 2", "sin angle 2", "turn 1", "turn 2"),
}
_ACTIONS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(IDS, ("hip 1", "knee 1", "hip 2", "knee 2")),
    **dict.fromkeys(("CartPole-v0", "CartPole-v1"), ("push left", "push right")),
    "LunarLander-v3": ("none", "left engine", "main engine", "right engine"),
    "LunarLanderContinuous-v3": ("main engine", "side engines"),
    "Pendulum-v1": ("torque",),
    "MountainCar-v0": ("push left", "none", "push right"),
    "MountainCarContinuous-v0": ("force",),
    "Acrobot-v1": ("torque -1", "none", "torque +1"),
}


def observation_names(environment_id: str, count: int) -> tuple[str, ...]:
    """A name for each component; ``obs[i]`` where none is known."""
    return _named(_OBSERVATIONS.get(environment_id, ()), "obs", count)


def action_names(environment_id: str, count: int) -> tuple[str, ...]:
    """A name for each output; ``action[i]`` where none is known."""
    return _named(_ACTIONS.get(environment_id, ()), "action", count)


def _named(known: tuple[str, ...], what: str, count: int) -> tuple[str, ...]:
    # An environment may have been registered anew under a familiar id.
    return known if len(known) == count else tuple(f"{what}[{index}]" for index in range(count))
