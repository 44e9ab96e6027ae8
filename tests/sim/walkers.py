# SPDX-License-Identifier: MIT
"""Recorded episodes of Gymnasium's BipedalWalker under many policies, and their comparison with the native simulator.

To replay one episode, and see where and how the two part::

    python -m tests.sim.walkers POLICY SEED STEPS [--hardcore] [--lanes N]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.envs.box2d import bipedal_walker as original

from bitneat import champion as champions
from bitneat.controller import Controller, Encoder
from bitneat.runtime import RuntimeController
from bitneat.sim.walker import binding as native
from bitneat.sim.walker.binding import library as native_library
from bitneat.sim.walker.episodes import ACTION

ROOT = Path(__file__).resolve().parents[2]
FULL = 1600
"""The time limit of the environment: Gymnasium cuts off there, so nothing is recorded beyond it."""

NAMES = (
    *("hull angle", "hull turn", "velocity x", "velocity y"),
    *(f"{what} {leg}" for leg in (1, 2) for what in ("hip angle", "hip speed", "knee angle", "knee speed", "contact")),
    *(f"ray {i}" for i in range(10)),
)

Floats = npt.NDArray[np.float32]
Policy = Callable[[Floats], Floats]
"""From an observation to an action; made anew for each episode."""

Rng = np.random.Generator


@dataclass(frozen=True)
class Episode:
    """What to record: equal values give equal recordings."""

    policy: str
    seed: int
    steps: int
    hardcore: bool = False

    @property
    def replay(self) -> str:
        """The command that shows where the simulators part in this episode."""
        mode = " --hardcore" if self.hardcore else ""
        return f"python -m tests.sim.walkers {self.policy} {self.seed} {self.steps}{mode}"


@dataclass(frozen=True)
class Record:
    """What Gymnasium did: row i + 1 of the observations follows action i, row 0 the reset."""

    episode: Episode
    actions: Floats
    observations: Floats
    rewards: npt.NDArray[np.float64]
    terminated: bool
    ending: str
    """fall, left, finish, limit (Gymnasium's) or cut (ours)."""


def record(episode: Episode) -> Record:
    """Run an episode in a fresh Gymnasium environment: one that is used again remembers its broad phase."""
    environment = gymnasium.make("BipedalWalker-v3", disable_env_checker=True, hardcore=episode.hardcore)
    policy = POLICIES[episode.policy](np.random.default_rng([0x77616C6B, episode.seed]))
    observation, _ = environment.reset(seed=episode.seed)
    actions, observations, rewards = [], [observation], []
    terminated = truncated = False
    with np.errstate(over="ignore", under="ignore"):
        while not (terminated or truncated) and len(actions) < episode.steps:
            action = policy(observation)
            assert action.dtype == np.float32
            assert action.shape == (4,)
            # A copy, since some policies write into what they gave.
            actions.append(action.copy())
            observation, reward, terminated, truncated, _ = environment.step(action)
            observations.append(observation)
            rewards.append(float(reward))
    walker = environment.unwrapped
    assert isinstance(walker, original.BipedalWalker)
    if terminated:
        ending = "left" if walker.hull.position[0] < 0 else "fall" if walker.game_over else "finish"
    else:
        ending = "limit" if truncated else "cut"
    return Record(
        episode, np.array(actions), np.array(observations), np.array(rewards, np.float64), bool(terminated), ending
    )


@dataclass(frozen=True)
class Difference:
    """The first step at which the native walker departs from a record."""

    episode: Episode
    step: int
    """Of the observation's row; 0 is the reset."""
    fields: tuple[str, ...]

    def __str__(self) -> str:
        e = self.episode
        head = f"policy {e.policy}, seed {e.seed}, hardcore {e.hardcore}, step {self.step}"
        return "\n  ".join((head, *self.fields, e.replay))


def compare(
    records: Sequence[Record], *, library: Any = None, lanes: int | None = None, threads: int = 1
) -> list[Difference]:
    """Replay the actions of all records side by side; at most one difference for each."""
    return list(_compare(records, NativeWalkers(len(records), library=library, lanes=lanes, threads=threads)))


def _compare(records: Sequence[Record], walkers: NativeWalkers) -> Iterable[Difference]:
    alive = []
    first = walkers.reset(range(len(records)), [(r.episode.seed, r.episode.hardcore) for r in records])
    for i, r in enumerate(records):
        fields = differing(first[i], r.observations[0])
        if fields:
            yield Difference(r.episode, 0, fields)
        else:
            alive.append(i)
    step = 0
    while True:
        alive = [i for i in alive if step < len(records[i].actions)]
        if not alive:
            return
        answer = walkers.step(alive, np.array([records[i].actions[step] for i in alive]))
        parted = set()
        for row, i in enumerate(alive):
            r = records[i]
            fields = differing(answer.observations[row], r.observations[step + 1])
            reward = answer.rewards[row]
            if reward.tobytes() != r.rewards[step].tobytes():
                fields += (f"reward: native {_bits(reward)}, Gymnasium {_bits(r.rewards[step])}",)
            ended = r.terminated and step + 1 == len(r.actions)
            if bool(answer.terminated[row]) != ended:
                fields += (f"terminated: native {bool(answer.terminated[row])}, Gymnasium {ended}",)
            if fields:
                parted.add(i)
                yield Difference(r.episode, step + 1, fields)
        alive = [i for i in alive if i not in parted]
        step += 1


def differing(got: Floats, wanted: Floats) -> tuple[str, ...]:
    """The components of two observations whose bits differ, in words."""
    if got.tobytes() == wanted.tobytes():
        return ()
    where = np.flatnonzero(got.view(np.uint32) != wanted.view(np.uint32))
    return tuple(f"{i} {NAMES[i]}: native {_bits(got[i])}, Gymnasium {_bits(wanted[i])}" for i in where)


def _bits(value: Any) -> str:
    kind = np.uint32 if value.dtype == np.float32 else np.uint64
    return f"0x{int(value.view(kind)):0{2 * value.dtype.itemsize}x} ({value!s})"


@dataclass(frozen=True)
class Step:
    """The rows of a step, in the order of the walkers asked for."""

    observations: Floats
    rewards: npt.NDArray[np.float64]
    terminated: npt.NDArray[np.uint8]


class NativeWalkers:
    """The C step API, without the vector environment above it. ``library`` may be another build of it."""

    def __init__(self, count: int, *, library: Any = None, lanes: int | None = None, threads: int = 1) -> None:
        self._library = library or native_library()
        self._lanes = native.lane_width(lanes)
        self._threads = threads
        # Some vectors in it may have to be aligned, which cffi's own memory is to 16 bytes only.
        size = self._library.simulator_environment_size() * count
        memory = np.zeros(size + 64, np.uint8)
        offset = -memory.ctypes.data % 64
        self._memory = memory[offset : offset + size]
        self.environments = native.ffi().from_buffer(self._memory)

    def reset(self, which: Sequence[int], seeds: Sequence[tuple[int, bool]]) -> Floats:
        """Put each of the walkers ``which`` on the ground of its seed (in hardcore mode, or not)."""
        for index, (seed, hardcore) in zip(which, seeds, strict=True):
            state = native.random_state(np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed))))
            self._library.simulator_seed(self.environments, index, state, int(hardcore))
        observations = np.empty((len(seeds), 24), np.float32)
        self._library.simulator_reset(
            self.environments,
            _pointer("int32_t", np.array(which, np.int32)),
            len(seeds),
            _pointer("float", observations),
            self._lanes,
            self._threads,
        )
        return observations

    def step(self, which: Sequence[int], actions: Floats) -> Step:
        """Let the walkers ``which`` take a step."""
        count = len(which)
        result = Step(np.empty((count, 24), np.float32), np.empty(count), np.empty(count, np.uint8))
        done = self._library.simulator_step(
            self.environments,
            _pointer("int32_t", np.array(which, np.int32)),
            count,
            _pointer("float", np.ascontiguousarray(actions, np.float32)),
            _pointer("float", result.observations),
            _pointer("double", result.rewards),
            _pointer("uint8_t", result.terminated),
            self._lanes,
            self._threads,
        )
        assert done, "too many contacts"
        return result


def _pointer(kind: str, array: npt.NDArray[Any]) -> Any:
    return native.ffi().from_buffer(f"{kind}[]", array)


# The policies. Each takes the episode's generator and gives a function of the observation.


def _action(values: Any) -> Floats:
    return np.asarray(values, np.float32).reshape(4)


def _random(rng: Rng) -> Policy:
    return lambda _: _action(rng.uniform(-1, 1, 4))


def _bang(rng: Rng) -> Policy:
    return lambda _: _action(rng.choice([-1.0, 1.0], 4))


def _full(rng: Rng) -> Policy:
    action = _action(rng.choice([-1.0, 1.0], 4))
    return lambda _: action


def _held(low: int, high: int, draw: Callable[[Rng], Any]) -> Callable[[Rng], Policy]:
    """Random actions that are held for a random number of steps each."""

    def make(rng: Rng) -> Policy:
        left, action = 0, np.zeros(4, np.float32)

        def act(_: Floats) -> Floats:
            nonlocal left, action
            if left == 0:
                left, action = int(rng.integers(low, high + 1)), _action(draw(rng))
            left -= 1
            return action

        return act

    return make


def _tiny(rng: Rng) -> Policy:
    sizes = (1e-45, 1e-40, 1e-38, 1e-30, 1e-8, 1e-3, 0.0)
    return lambda _: _action(rng.choice(sizes, 4) * rng.choice([-1.0, 1.0], 4))


def _huge(rng: Rng) -> Policy:
    sizes = (np.inf, 3.4e38, 1e30, 100.0, 1.0000001, 1.0, 0.99999994)
    held = _held(1, 12, lambda rng: rng.choice(sizes, 4) * rng.choice([-1.0, 1.0], 4))
    return held(rng)


def _zero(_: Rng) -> Policy:
    return lambda _: np.zeros(4, np.float32)


def _minus_zero(_: Rng) -> Policy:
    return lambda _: np.full(4, -0.0, np.float32)


def _sine(most_frequency: float) -> Callable[[Rng], Policy]:
    def make(rng: Rng) -> Policy:
        frequency = rng.uniform(0.2, most_frequency)
        phase, size, shift = rng.uniform(0, 2 * math.pi, 4), rng.uniform(0, 1.5, 4), rng.uniform(-0.5, 0.5, 4)
        step = 0

        def act(_: Floats) -> Floats:
            nonlocal step
            step += 1
            return _action(size * np.sin(2 * math.pi * frequency * step / 50 + phase) + shift)

        return act

    return make


def _pose(targets: Callable[[Rng, int], Any], gain: float = 4.0) -> Callable[[Rng], Policy]:
    """Drives the joints to angles that may change with time."""

    def make(rng: Rng) -> Policy:
        step = 0

        def act(o: Floats) -> Floats:
            nonlocal step
            wanted = np.asarray(targets(rng, step))
            step += 1
            angle = np.array([o[4], o[6] - 1, o[9], o[11] - 1])
            speed = np.array([o[5], o[7], o[10], o[12]])
            return _action(np.clip(gain * (wanted - angle) - 0.3 * speed, -1, 1))

        return act

    return make


def _crouch(_: Rng, step: int) -> Any:
    return (0.5, -1.2, 0.5, -1.2) if step % 160 < 80 else (0.0, -0.2, 0.0, -0.2)


def _jump(rng: Rng, step: int) -> Any:
    return (1.0, -1.55, 1.0, -1.55) if step % 60 < 40 else (-0.6, -0.1, -0.6, -0.1)


def _stand(_: Rng, step: int) -> Any:
    return (0.45, -0.4, -0.35, -0.3)


def _somersault(rng: Rng) -> Policy:
    """Throws itself over its back or its front with all there is."""
    side = rng.choice([-1.0, 1.0])
    start = int(rng.integers(5, 40))
    step = 0

    def act(_: Floats) -> Floats:
        nonlocal step
        step += 1
        return _action((0, -1, 0, -1) if step < start else (side, 1, side, 1))

    return act


def _heuristic(noise: float) -> Callable[[Rng], Policy]:
    def make(rng: Rng) -> Policy:
        walk = original.BipedalWalkerHeuristics()
        walk.a = np.zeros(4)

        def act(observation: Floats) -> Floats:
            action = walk.step_heuristic(observation)
            return _action(np.clip(action + noise * rng.standard_normal(4), -1, 1) if noise else action)

        return act

    return make


RUNNER = np.array(
    (
        (
            0.4,
            12.7,
            4.9,
            -10.7,
            -5.5,
            0,
            -0.7,
            -0.1,
            -0.2,
            -1.4,
            0.7,
            0.1,
            0.4,
            0,
            -3.8,
            2,
            -17.9,
            -4.2,
            -11,
            2.9,
            -11,
            0.7,
            3.4,
            6.3,
            2.8,
        ),
        (
            0,
            2,
            -0.4,
            -1.9,
            0.5,
            -1.5,
            -3.3,
            -0.6,
            0.9,
            2.4,
            0.9,
            1.5,
            0.2,
            -1.3,
            -7.4,
            1.2,
            -16.6,
            -0.6,
            -7.9,
            1.4,
            -6.1,
            -1.8,
            1.6,
            -6.1,
            15.1,
        ),
        (
            -0.7,
            17.1,
            -2.2,
            -0.1,
            -0.8,
            -0.4,
            -3.9,
            0.1,
            0.4,
            -1.1,
            -1.4,
            -0.7,
            -0.6,
            -0.2,
            -7.3,
            -0.4,
            2.4,
            -5.7,
            5.9,
            5.6,
            -3.3,
            4.5,
            -1.6,
            13.5,
            -13.2,
        ),
        (
            4.5,
            13.6,
            -4.9,
            -6.3,
            -0.9,
            -0.3,
            -1.8,
            0.1,
            0.1,
            2.2,
            -0.4,
            -2.6,
            -0.2,
            -0.8,
            -1.8,
            -8.2,
            -5.4,
            -6.1,
            4.6,
            6.8,
            3.4,
            -0.3,
            0.1,
            8.9,
            -9.8,
        ),
    )
)
"""A linear policy, its constant last, found by random search in the native walker: it reaches the end within 1100 steps."""


def _runner(noise: float) -> Callable[[Rng], Policy]:
    def make(rng: Rng) -> Policy:
        def act(observation: Floats) -> Floats:
            action = RUNNER[:, :24] @ observation.astype(np.float64) + RUNNER[:, 24]
            return _action(np.clip(action, -1, 1) + noise * rng.standard_normal(4))

        return act

    return make


@cache
def champion() -> Controller:
    """The committed champion."""
    return champions.load(ROOT / "examples/walker/champion.json").controller


def driven(controller: Controller) -> Policy:
    """A controller with the encoder and decoder of the semantics, and the C runtime in between."""
    encode, runtime = Encoder(controller), RuntimeController(controller)
    runtime.reset()
    return lambda observation: _action(ACTION.decode(np.array(runtime.step(encode(observation))), controller.frac_bits))


POLICIES: dict[str, Callable[[Rng], Policy]] = {
    "random": _random,
    "bang": _bang,
    "full": _full,
    "held": _held(10, 40, lambda rng: rng.uniform(-1, 1, 4)),
    "held-bang": _held(5, 40, lambda rng: rng.choice([-1.0, 0.0, 1.0], 4)),
    "tiny": _tiny,
    "huge": _huge,
    "zero": _zero,
    "minus-zero": _minus_zero,
    "slow-sine": _sine(1.0),
    "fast-sine": _sine(6.0),
    "stand": _pose(_stand),
    "crouch": _pose(_crouch),
    "jump": _pose(_jump, 20.0),
    "somersault": _somersault,
    "heuristic": _heuristic(0.0),
    "shaken-heuristic": _heuristic(0.2),
    "runner": _runner(0.0),
    "shaken-runner": _runner(0.7),
    "champion": lambda _: driven(champion()),
}


def main() -> None:
    """Record one episode and say where the native simulator departs from it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("policy", choices=POLICIES)
    parser.add_argument("seed", type=int)
    parser.add_argument("steps", type=int)
    parser.add_argument("--hardcore", action="store_true")
    parser.add_argument("--lanes", type=int)
    arguments = parser.parse_args()
    recorded = record(Episode(arguments.policy, arguments.seed, arguments.steps, arguments.hardcore))
    print(f"{len(recorded.actions)} steps, {recorded.ending}, reward {recorded.rewards.sum():.2f}")
    for difference in compare([recorded], lanes=arguments.lanes):
        print(difference)


if __name__ == "__main__":
    main()
