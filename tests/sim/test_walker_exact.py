# SPDX-License-Identifier: MIT
"""The native walker is Gymnasium's to the bit, whatever the policy, and whatever shares the work with it.

Policies, recordings and the comparison are in tests/sim/walkers.py; a difference comes with the command that replays it.
"""

from __future__ import annotations

import dataclasses
import itertools
import random

import numpy as np
import pytest

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Controller, Signal
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import EpisodeRunner, Shaping, used_inputs
from bitneat.sim.walker.binding import LANE_WIDTHS
from bitneat.sim.walker.episodes import ACTION, evaluate, run_episodes
from tests.sim.walkers import FULL, POLICIES, Episode, NativeWalkers, Record, champion, compare, record
from tests.strategies import random_controller

SHORT = 250
"""Enough for most policies to fall, and for the others to have walked some way."""

HARDCORE = (False, True)


def assert_equal(records: list[Record], **options: int | None) -> None:
    differences = compare(records, **options)
    assert not differences, "\n".join(map(str, differences[:5]))


@pytest.mark.parametrize("policy", POLICIES)
def test_every_policy_gives_gymnasiums_bits(policy: str, budget: int) -> None:
    for start in range(0, 16 * budget, 16):
        seeds = range(start, start + 16)
        # An odd batch, so that lanes are empty; and each width comes with each policy's turn.
        records = [record(Episode(policy, seed, SHORT, bool(seed % 2))) for seed in seeds]
        lanes = LANE_WIDTHS[(start // 16 + list(POLICIES).index(policy)) % len(LANE_WIDTHS)]
        assert_equal(records[:5], lanes=lanes)
        assert_equal(records[5:], lanes=None)


WHOLE = [
    (Episode("runner", 3, FULL), "finish"),
    (Episode("runner", 4, FULL), "finish"),
    (Episode("heuristic", 6, FULL), "finish"),
    (Episode("heuristic", 24, FULL, hardcore=True), "limit"),
    (Episode("champion", 1, FULL), "limit"),
    (Episode("champion", 21, FULL, hardcore=True), "limit"),
    (Episode("stand", 0, FULL), "limit"),
    (Episode("full", 8, FULL), "limit"),
    (Episode("slow-sine", 8, FULL, hardcore=True), "limit"),
    (Episode("random", 1, FULL), "limit"),
    (Episode("runner", 0, FULL, hardcore=True), "limit"),
    (Episode("zero", 0, FULL), "fall"),
    (Episode("huge", 0, FULL, hardcore=True), "fall"),
    (Episode("bang", 16, FULL), "left"),
    (Episode("fast-sine", 14, FULL, hardcore=True), "left"),
    (Episode("held-bang", 52, FULL, hardcore=True), "left"),
]
"""Whole episodes, and how Gymnasium ends them."""


@pytest.mark.parametrize(("episode", "ending"), WHOLE, ids=lambda value: getattr(value, "policy", None))
def test_whole_episodes_end_as_gymnasiums_do(episode: Episode, ending: str) -> None:
    recorded = record(episode)
    assert recorded.ending == ending, "choose another seed for this ending"
    assert_equal([recorded])
    if ending in ("fall", "left"):
        assert recorded.rewards[-1] == -100.0
    if episode.policy == "full":
        # At rest, to the bit: the walker has fallen asleep, and wakes in the next step.
        assert (recorded.observations[:, 1:4] == 0.0).all(axis=1).sum() > 20


@pytest.mark.long
@pytest.mark.parametrize("hardcore", HARDCORE)
@pytest.mark.parametrize("policy", POLICIES)
def test_more_whole_episodes(policy: str, hardcore: bool, budget: int) -> None:
    for start in range(1000, 1000 + 5 * budget, 5):
        assert_equal([record(Episode(policy, seed, FULL, hardcore)) for seed in range(start, start + 5)])


def test_a_difference_names_its_place_and_replays() -> None:
    recorded = record(Episode("random", 7, 30))
    recorded.observations[12, 4] = np.nextafter(recorded.observations[12, 4], np.float32(9))
    recorded.observations[12, 8] = -0.0
    recorded.rewards[11] += 1e-9
    [difference] = compare([recorded])
    text = str(difference)
    assert "policy random, seed 7, hardcore False, step 12" in text
    assert "4 hip angle 1: native 0x" in text
    assert "8 contact 1: native 0x" in text
    assert "reward: native 0x" in text
    assert text.endswith("python -m tests.sim.walkers random 7 30")


def test_the_lanes_and_threads_and_company_of_an_episode_change_no_bit(budget: int) -> None:
    episodes = [
        (Episode("held", seed, 20 + seed % 70, bool(seed % 3)), np.random.default_rng(seed).uniform(-1.5, 1.5, (90, 4)))
        for seed in range(240 * budget)
    ]
    wanted = _interleaved(episodes, np.random.default_rng(0), slots=1, lanes=1, threads=1)
    assert len(wanted) == len(episodes)
    for number, (lanes, threads) in enumerate(itertools.product(LANE_WIDTHS, (1, 3))):
        rng = np.random.default_rng(1 + number)
        got = _interleaved(episodes, rng, slots=int(rng.integers(2, 70)), lanes=lanes, threads=threads)
        assert got == wanted


def _interleaved(
    episodes: list[tuple[Episode, np.ndarray]],  # type: ignore[type-arg]
    rng: np.random.Generator,
    *,
    slots: int,
    lanes: int,
    threads: int,
) -> dict[int, bytes]:
    """Run episodes in slots that are used again, in any order; each call steps some of them. All bits, by seed."""
    walkers = NativeWalkers(slots, lanes=lanes, threads=threads)
    waiting = [episodes[i] for i in rng.permutation(len(episodes))]
    running: dict[int, tuple[Episode, np.ndarray, list[bytes]]] = {}  # type: ignore[type-arg]
    done: dict[int, bytes] = {}
    while waiting or running:
        free = [slot for slot in range(slots) if slot not in running][: len(waiting)]
        if free:
            for slot in free:
                running[slot] = (*waiting.pop(), [])
            first = walkers.reset(free, [(running[slot][0].seed, running[slot][0].hardcore) for slot in free])
            for slot, row in zip(free, first, strict=True):
                running[slot][2].append(row.tobytes())
        which = [int(slot) for slot in rng.permutation(list(running)) if len(running) < 3 or rng.random() < 0.8]
        answer = walkers.step(which, np.array([running[s][1][len(running[s][2]) - 1] for s in which]).reshape(-1, 4))
        for row, slot in enumerate(which):
            episode, _, bits = running[slot]
            ended = bool(answer.terminated[row])
            bits.append(answer.observations[row].tobytes() + answer.rewards[row].tobytes() + bytes([ended]))
            if ended or len(bits) > episode.steps:
                done[episode.seed] = b"".join(bits)
                del running[slot]
    return done


# Whole episodes of controllers, in C alone.


def some_controllers(count: int, seed: int) -> list[Controller]:
    """The champion and its kin, which walk, and random ones: with and without state, reading all rays, few and none."""
    rng = random.Random(seed)
    blind = dataclasses.replace(champion(), nodes=(), outputs=tuple(Signal(i) for i in (4, 6, 9, 2)))
    chosen = [champion(), blind]
    while len(chosen) < count:
        if len(chosen) % 2:
            nodes, fan_in, pure = rng.choice(
                ((0, 1, True), (5, 2, False), (12, 3, False), (30, 64, True), (30, 9, False))
            )
            sizes = {"num_inputs": 24, "num_nodes": nodes, "num_outputs": 4, "max_fan_in": fan_in}
            chosen.append(random_controller(rng, feed_forward=pure, **sizes))
        else:
            chosen.append(_relative(champion(), rng))
    return chosen


def _relative(controller: Controller, rng: random.Random) -> Controller:
    """With an output or two taken from somewhere else: most still stand, and some walk."""
    outputs = list(controller.outputs)
    for _ in range(rng.randint(0, 2)):
        outputs[rng.randrange(4)] = Signal(rng.randrange(24 + len(controller.nodes)))
    return dataclasses.replace(controller, outputs=tuple(outputs))


def test_the_controllers_here_are_of_all_kinds() -> None:
    controllers = some_controllers(20, 1)
    rays = [len([i for i in used_inputs(c) if i >= 14]) for c in controllers]
    assert min(rays) == 0
    assert max(rays) == 10
    assert any(0 < count < 5 for count in rays)
    assert sum(any(link.delay for node in c.nodes for link in node.links) for c in controllers) > 3


@pytest.mark.parametrize("hardcore", HARDCORE)
def test_episodes_of_controllers_do_not_depend_on_lanes_threads_or_order(hardcore: bool, budget: int) -> None:
    controllers, seeds = some_controllers(20, 1), list(range(12 * budget))
    shaping = Shaping(-100.0, -10.0, 50.0, 300, 120, 0.01)
    wanted = evaluate(controllers, seeds, FULL, shaping, hardcore=hardcore, lanes=1, threads=1)
    assert len({episode.steps for row in wanted for episode in row}) > 20
    for number, (lanes, threads) in enumerate(itertools.product(LANE_WIDTHS, (1, 2, 5))):
        rng = random.Random(number)
        rows, columns = (rng.sample(range(n), rng.randint(1, n)) for n in (len(controllers), len(seeds)))
        got = evaluate(
            [controllers[i] for i in rows],
            [seeds[i] for i in columns],
            FULL,
            shaping,
            hardcore=hardcore,
            lanes=lanes,
            threads=threads,
        )
        assert got == [[wanted[i][j] for j in columns] for i in rows]


SHAPINGS = (
    Shaping(),
    Shaping(fall_reward=-100.0, fall_value=-7.5),
    Shaping(fall_reward=-100.0, fall_value=0.0, finish_bonus=123.0, max_steps=70),
    Shaping(stall_steps=25, stall_gain=0.05),
    Shaping(-100.0, -20.0, 40.0, 120, 40, 1.0),
)


@pytest.mark.parametrize("hardcore", HARDCORE)
@pytest.mark.parametrize("shaping", SHAPINGS, ids=range(len(SHAPINGS)))
def test_episodes_of_controllers_are_those_of_gymnasium(shaping: Shaping, hardcore: bool, budget: int) -> None:
    controllers, seeds = some_controllers(8 * budget, 2 + SHAPINGS.index(shaping)), [0, 5, 91, 2**40]
    spec = EnvironmentSpec("BipedalWalker-v3", {"hardcore": hardcore})
    got = evaluate(controllers, seeds, 160, shaping, hardcore=hardcore)
    for controller, row in zip(controllers, got, strict=True):
        run = EpisodeRunner(spec, controller, ACTION, RuntimeController(controller), "gymnasium")
        assert row == [run(seed, 160, shaping) for seed in seeds]


def test_the_bonus_for_the_end_of_the_terrain_is_that_of_gymnasium() -> None:
    """No controller here gets that far, so the end comes another way: a termination that is not what counts as a fall."""
    controllers, seeds = some_controllers(6, 9), [3, 4]
    shaping = Shaping(fall_reward=-99.0, finish_bonus=77.0, max_steps=300)
    got = evaluate(controllers, seeds, FULL, shaping)
    assert any(episode.terminated and episode.shaped > episode.reward for row in got for episode in row)
    for controller, row in zip(controllers, got, strict=True):
        run = EpisodeRunner(EnvironmentSpec("BipedalWalker-v3"), controller, ACTION, RuntimeController(controller))
        assert row == [run(seed, FULL, shaping) for seed in seeds]


def test_the_champions_whole_episodes_are_those_recorded() -> None:
    seeds = [7, 8]
    rewards, steps = run_episodes([champion()], seeds)
    for seed, reward, count in zip(seeds, rewards[0], steps[0], strict=True):
        recorded = record(Episode("champion", seed, FULL))
        total = 0.0
        for each in recorded.rewards:
            total += float(each)
        assert (reward, count) == (total, len(recorded.actions))
