# SPDX-License-Identifier: MIT
"""Walkers that are thrown about: the velocities of their bodies are set from outside, in Gymnasium and in the C alike.

No policy moves that fast. So this is where limits of speed are met, and several impacts in one step, and dozens of contacts.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import cffi
import gymnasium
import numpy as np
import pytest
from gymnasium.envs.box2d import bipedal_walker as original

from bitneat.native.build import shared_library
from bitneat.sim.walker import binding as native
from tests.sim.walkers import POLICIES, NativeWalkers, Rng, differing

STEPS = 120


@cache
def throwing() -> tuple[Any, Any]:
    """The simulator's library with a function to set velocities, and what cffi needs to call that."""
    sources, includes = native.sources()
    added = Path(__file__).with_name("throw.c")
    path = shared_library([*sources, added], name="walker-throw", include_dirs=includes, flags=native.FLAGS)
    declared = cffi.FFI()
    declared.cdef("void throw_body(void *environments, int32_t body, float x, float y, float turn);")
    library = native.ffi().dlopen(str(path))
    library.simulator_open()
    return library, declared.dlopen(str(path))


def throws(rng: Rng, size: float, bodies: list[Any]) -> list[tuple[int, float, float, float]]:
    """New velocities of some bodies: body, x, y and turn."""
    kind, (x, y) = rng.integers(6), rng.normal(0, size, 2)
    turn = rng.normal(0, size / 2)
    middle = bodies[0].worldCenter
    result = []
    for index, body in enumerate(bodies):
        if kind == 0:  # all together
            new = (x, y, 0.0)
        elif kind == 1:  # down
            new = (0.2 * x, -abs(y), 0.0)
        elif kind == 2:  # spinning as one
            away = body.worldCenter - middle
            new = (x - turn * away[1], y + turn * away[0], turn)
        elif kind == 3:  # limbs this way and that
            new = (*np.add((x, y), rng.normal(0, size / 4, 2)), rng.normal(0, size))
        elif kind == 4:  # turned where they are
            new = (*body.linearVelocity, rng.normal(0, 3 * size))
        elif rng.random() < 0.5:
            new = (*rng.normal(0, size, 2), rng.normal(0, size))
        else:
            continue
        result.append((index, *(float(np.float32(v)) for v in new)))
    return result


def first_difference(seed: int, size: float, *, hardcore: bool, lanes: int) -> tuple[int, tuple[str, ...]] | None:
    """Throw a walker about, at random but the same each time; the step of the first difference, and what differs."""
    library, thrower = throwing()
    rng = np.random.default_rng([0x7468726F, seed])
    walkers = NativeWalkers(1, library=library, lanes=lanes)
    walker = gymnasium.make("BipedalWalker-v3", disable_env_checker=True, hardcore=hardcore).unwrapped
    assert isinstance(walker, original.BipedalWalker)
    policy = POLICIES[rng.choice(list(POLICIES))](rng)
    observation, _ = walker.reset(seed=seed)
    walkers.reset([0], [(seed, hardcore)])
    for step in range(STEPS):
        if rng.random() < 0.08:
            bodies = [walker.hull, *walker.legs]
            for index, x, y, turn in throws(rng, size, bodies):
                bodies[index].linearVelocity, bodies[index].angularVelocity = (x, y), turn
                thrower.throw_body(walkers.environments, index, x, y, turn)
        action = policy(observation)
        observation, reward, terminated, _, _ = walker.step(action)
        answer = walkers.step([0], action[None])
        fields = differing(answer.observations[0], observation)
        if float(reward) != answer.rewards[0] or terminated != bool(answer.terminated[0]):
            fields += (f"reward {answer.rewards[0]!r}, Gymnasium {reward!r}, terminated {terminated}",)
        if fields:
            return step, fields
        if terminated:
            return None
    return None


@pytest.mark.parametrize("hardcore", [False, True])
@pytest.mark.parametrize("size", [3.0, 10.0, 30.0, 100.0])
def test_thrown_walkers_are_gymnasiums_to_the_bit(size: float, hardcore: bool, budget: int) -> None:
    for seed in range(16 * budget):
        options = {"hardcore": hardcore, "lanes": 16 if seed % 4 == 0 else 1}
        found = first_difference(seed, size, **options)  # type: ignore[arg-type]
        assert found is None, f"first_difference({seed}, {size}, **{options}): step {found[0]}: {'; '.join(found[1])}"
