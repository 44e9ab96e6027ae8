# SPDX-License-Identifier: MIT
"""The walkers' vector environment against Gymnasium's SyncVectorEnv of environments with a fresh world for each episode."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import Box2D
import gymnasium
import numpy as np
import numpy.typing as npt
import pytest
from gymnasium.envs.box2d.bipedal_walker import BipedalWalker
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import bitneat.sim.walker
from bitneat.errors import BitneatError
from bitneat.sim import WalkerVectorEnv
from bitneat.sim.walker.binding import LANE_WIDTHS, ffi, library

Floats = npt.NDArray[np.float32]
Step = tuple[Any, Any, Any, Any, dict[str, Any]]

LIMIT = 60
"""Short enough that with random actions about as many episodes are truncated as fall."""
STEPS = {1: 400, 3: 300, 17: 200}
"""How many are compared, by the number of environments."""


class FreshWalker(BipedalWalker):
    """Gymnasium's, with a new world for each episode."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.world = Box2D.b2World()
        self.terrain = []
        self.hull = None
        return super().reset(seed=seed, options=options)


def original(num_envs: int, hardcore: bool, mode: AutoresetMode, limit: int = LIMIT) -> Any:
    def make() -> Any:
        return TimeLimit(FreshWalker(hardcore=hardcore), limit)

    return SyncVectorEnv([make] * num_envs, autoreset_mode=mode)


def random_actions(num_envs: int, seed: int) -> Iterator[Floats]:
    """Some beyond the limits, some of them infinite, and some zeros of either sign."""
    rng = np.random.default_rng(seed)
    special = np.array([0.0, -0.0, np.inf, -np.inf, 1.0, -1.0], np.float32)
    while True:
        actions = rng.uniform(-1.3, 1.3, (num_envs, 4)).astype(np.float32)
        chosen = rng.random(actions.shape) < 0.05
        actions[chosen] = rng.choice(special, chosen.sum())
        yield actions


def assert_same_bits(ours: Any, theirs: Any) -> None:
    """Equal in type, shape and every bit; of dictionaries the order of the keys too."""
    assert type(ours) is type(theirs)
    if isinstance(ours, dict):
        assert list(ours) == list(theirs)
        for key, value in ours.items():
            assert_same_bits(value, theirs[key])
    elif isinstance(ours, tuple):
        for mine, other in zip(ours, theirs, strict=True):
            assert_same_bits(mine, other)
    elif isinstance(ours, np.ndarray):
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
        if ours.dtype == object:
            for mine, other in zip(ours, theirs, strict=True):
                assert_same_bits(mine, other)
        else:
            assert ours.tobytes() == theirs.tobytes()
    else:
        assert ours == theirs


def later_seeds(num_envs: int) -> list[int | None]:
    return [None if index % 3 == 1 else 1000 + 7 * index for index in range(num_envs)]


@pytest.mark.parametrize("num_envs", sorted(STEPS))
@pytest.mark.parametrize("hardcore", [False, True], ids=["normal", "hardcore"])
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
def test_every_bit_is_gymnasiums(mode: AutoresetMode, hardcore: bool, num_envs: int) -> None:
    envs = WalkerVectorEnv(num_envs, hardcore, max_episode_steps=LIMIT, autoreset_mode=mode)
    oracle = original(num_envs, hardcore, mode)
    both = (envs, oracle)
    steps = STEPS[num_envs]
    ends = np.zeros(2, np.int64)
    assert_same_bits(*(e.reset(seed=42) for e in both))
    for count, actions in zip(range(steps), random_actions(num_envs, num_envs), strict=False):
        ours, theirs = (e.step(actions) for e in both)
        assert_same_bits(ours, theirs)
        terminated, truncated = ours[2], ours[3]
        ends += terminated.sum(), truncated.sum()
        done = terminated | truncated
        if count == steps // 2:
            seeds = later_seeds(num_envs)
            ours, theirs = (e.reset(seed=seeds) for e in both)
        elif count == steps // 3:
            ours, theirs = (e.reset() for e in both)
        elif mode is AutoresetMode.DISABLED and done.any():
            seed = 5000 + count if count % 2 else None
            ours, theirs = (e.reset(seed=seed, options={"reset_mask": done}) for e in both)
        else:
            continue
        assert_same_bits(ours, theirs)
    assert ends.min() > 0
    assert envs.np_random_seed == oracle.np_random_seed
    states = [[rng.bit_generator.state for rng in e.np_random] for e in both]
    assert states[0] == states[1]


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
def test_an_episode_can_terminate_in_its_last_step(mode: AutoresetMode) -> None:
    actions = [next(random_actions(3, seed)) for seed in range(200)]
    pilot = WalkerVectorEnv(3)
    pilot.reset(seed=3)
    falls = [step for step, action in enumerate(actions, 1) if pilot.step(action)[2][0]]
    limit = falls[0]
    envs = WalkerVectorEnv(3, max_episode_steps=limit, autoreset_mode=mode)
    oracle = original(3, False, mode, limit)
    for e in (envs, oracle):
        e.reset(seed=3)
    for step in range(1, limit + 1):
        ours, theirs = (e.step(actions[step - 1]) for e in (envs, oracle))
        assert_same_bits(ours, theirs)
        assert (ours[2][0], ours[3][0]) == (step == limit, step == limit)


@pytest.mark.parametrize(("limit", "hardcore"), [(None, False), (2000, True)])
def test_an_episode_is_truncated_at_gymnasiums_limit(limit: int | None, hardcore: bool) -> None:
    expected = 1600 if limit is None else limit
    num_envs = 8
    envs = WalkerVectorEnv(num_envs, hardcore, max_episode_steps=limit)
    envs.reset(seed=0)
    still = np.random.default_rng(1).uniform(-1, 1, (num_envs, 4)).astype(np.float32)
    alive = np.ones(num_envs, np.bool_)
    for step in range(1, expected + 1):
        _, _, terminated, truncated, _ = envs.step(still)
        assert not (truncated & alive).any() or step == expected
        alive &= ~terminated
    assert alive.any()
    assert (truncated[alive]).all()


def test_no_lanes_and_threads_change_a_bit() -> None:
    def run(lanes: int | None, threads: int | None) -> list[bytes]:
        envs = WalkerVectorEnv(17, True, max_episode_steps=LIMIT, lanes=lanes, threads=threads)
        seen: list[npt.NDArray[Any]] = [envs.reset(seed=9)[0]]
        for _, actions in zip(range(150), random_actions(17, 4), strict=False):
            seen += envs.step(actions)[:4]
        return [array.tobytes() for array in seen]

    expected = run(None, None)
    for lanes in LANE_WIDTHS:
        for threads in (1, 3):
            assert run(lanes, threads) == expected


def test_without_a_seed_every_environment_has_random_numbers_of_its_own() -> None:
    ground = [WalkerVectorEnv(2).reset()[0].tobytes() for _ in range(2)]
    assert ground[0] != ground[1]
    envs = WalkerVectorEnv(2)
    first, second = envs.np_random_seed
    assert first != second
    again = WalkerVectorEnv(2)
    np.testing.assert_array_equal(envs.reset()[0], again.reset(seed=[first, second])[0])
    np.testing.assert_array_equal(envs.reset()[0], again.reset(seed=(None, None))[0])


def test_numpy_numbers_are_seeds_too() -> None:
    envs = WalkerVectorEnv(3)
    expected = envs.reset(seed=7)[0]
    for seed in (np.int64(7), [7, 8, 9], (7, 8, 9), np.array([7, 8, 9])):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0], expected)  # type: ignore[arg-type]


def test_the_spaces_and_the_spec_are_gymnasiums() -> None:
    envs, oracle = WalkerVectorEnv(5), SyncVectorEnv([lambda: gymnasium.make("BipedalWalker-v3")] * 5)
    for name in ("observation_space", "single_observation_space", "action_space", "single_action_space"):
        ours, theirs = getattr(envs, name), getattr(oracle, name)
        assert ours == theirs
        assert ours.low.tobytes() + ours.high.tobytes() == theirs.low.tobytes() + theirs.high.tobytes()
    assert envs.spec is not None
    assert (envs.spec.id, envs.spec.max_episode_steps, envs.spec.kwargs) == ("BipedalWalker-v3", 1600, {})
    observation, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observation)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_metadata_say_what_it_does(mode: AutoresetMode) -> None:
    for given in (mode, mode.value):
        assert WalkerVectorEnv(2, autoreset_mode=given).metadata["autoreset_mode"] is mode
    assert WalkerVectorEnv(2).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_its_spec_makes_others_like_it() -> None:
    envs = WalkerVectorEnv(2, True, max_episode_steps=33)
    assert envs.spec is not None
    again = gymnasium.make_vec(envs.spec, num_envs=2)
    assert isinstance(again, WalkerVectorEnv)
    np.testing.assert_array_equal(envs.reset(seed=1)[0], again.reset(seed=1)[0])
    one = gymnasium.make(envs.spec)
    assert one.get_wrapper_attr("hardcore")
    assert one.spec is not None
    assert one.spec.max_episode_steps == 33
    assert gymnasium.spec("BipedalWalker-v3").vector_entry_point is None


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
def test_gymnasiums_statistics_count_the_episodes(mode: AutoresetMode) -> None:
    envs = RecordEpisodeStatistics(WalkerVectorEnv(3, max_episode_steps=LIMIT, autoreset_mode=mode))
    envs.reset(seed=2)
    totals: list[list[float]] = [[] for _ in range(3)]
    found = 0
    for _, actions in zip(range(300), random_actions(3, 0), strict=False):
        restarting = envs.unwrapped._ended.copy()  # type: ignore[attr-defined]
        _, rewards, terminated, truncated, infos = envs.step(actions)
        for index in np.flatnonzero(~restarting):
            totals[index].append(rewards[index])
        done = terminated | truncated
        assert done.any() == ("episode" in infos)
        for index in np.flatnonzero(done):
            assert infos["_episode"][index]
            assert infos["episode"]["l"][index] == len(totals[index])
            assert infos["episode"]["r"][index] == pytest.approx(sum(totals[index]))
            totals[index] = []
            found += 1
        if mode is AutoresetMode.DISABLED and done.any():
            envs.reset(options={"reset_mask": done})
    assert found > 10
    assert len(envs.return_queue) == found


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.value)
def test_what_it_returned_stays_as_it_was(mode: AutoresetMode) -> None:
    envs = WalkerVectorEnv(3, max_episode_steps=5, autoreset_mode=mode)
    kept: list[tuple[Any, bytes]] = []

    def keep(*values: Any) -> None:
        for value in values:
            if isinstance(value, dict):
                keep(*value.values())
            elif value.dtype == object:
                keep(*(v for v in value if v is not None))
            else:
                kept.append((value, value.tobytes()))

    keep(*envs.reset(seed=0))
    for _, actions in zip(range(12), random_actions(3, 5), strict=False):
        step = envs.step(actions)
        keep(*step)
        if mode is AutoresetMode.DISABLED and step[3].any():
            keep(*envs.reset(options={"reset_mask": step[3]}))
    assert all(array.tobytes() == content for array, content in kept)
    for array, _ in kept:
        array[...] = 0  # what a caller writes into it is of no consequence
    again = WalkerVectorEnv(3, max_episode_steps=5)
    np.testing.assert_array_equal(envs.reset(seed=8)[0], again.reset(seed=8)[0])


def test_actions_are_taken_as_float32() -> None:
    envs = WalkerVectorEnv(3)
    rng = np.random.default_rng(0)
    doubles = rng.uniform(-1, 1, (3, 4))
    doubles[0] = 1e300, -1e300, 1.0, 0.0
    expected = np.clip(doubles, -1, 1).astype(np.float32)
    seen = []
    for actions in (expected, doubles, doubles.tolist(), np.asfortranarray(doubles), doubles.astype(">f8")):
        envs.reset(seed=0)
        seen.append([array.tobytes() for array in envs.step(actions)[:4]])
    assert seen == seen[:1] * 5
    assert envs.step(np.ones((3, 4), np.int64))[0].dtype == np.float32


def test_a_mask_leaves_the_others_alone_and_the_callers_options_whole() -> None:
    envs = WalkerVectorEnv(3)
    envs.reset(seed=0)
    actions = np.full((3, 4), 0.5, np.float32)
    before = envs.step(actions)[0]
    options = {"reset_mask": np.array([False, True, False])}
    after, _ = envs.reset(seed=[None, 77, -0], options=options)
    assert list(options) == ["reset_mask"]
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(after[1], WalkerVectorEnv(1).reset(seed=77)[0][0])
    assert envs.np_random_seed == (0, 77, 2)


def test_hardcore_can_be_set_for_the_next_episode() -> None:
    envs, oracle = WalkerVectorEnv(3), original(3, False, AutoresetMode.NEXT_STEP, 1600)
    for e in (envs, oracle):
        e.reset(seed=6)
        e.set_attr("hardcore", [True, False, True])
        assert e.get_attr("hardcore") == e.call("hardcore") == (True, False, True)
    for seed in (None, 8):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0], oracle.reset(seed=seed)[0])
    for _, actions in zip(range(40), random_actions(3, 1), strict=False):
        assert_same_bits(envs.step(actions)[0], oracle.step(actions)[0])
    envs.set_attr("hardcore", False)
    assert envs.get_attr("hardcore") == (False, False, False)
    assert envs.get_attr("spec") == (envs.spec,) * 3


def with_nan(index: int) -> Any:
    actions = np.zeros((3, 4))
    actions[index, 2] = np.nan
    return actions


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (with_nan(0), "a NaN for environment 0"),
        (with_nan(2), "a NaN for environment 2"),
        (np.zeros((3, 5)), "4 numbers for environment 0, got float64 of shape (5,)"),
        (np.zeros(12), "4 numbers for environment 0, got float64 of shape ()"),
        (np.zeros((2, 4)), "none for environment 2"),
        (np.zeros((4, 4)), "environment 3, which there is not"),
        ([[0] * 4, [0] * 4, [0] * 3], "4 numbers for environment 2, got int64 of shape (3,)"),
        ([[0] * 4, "left", [0] * 4], "4 numbers for environment 1"),
        (np.zeros((3, 4), complex), "4 numbers for environment 0, got complex128"),
        ([[0] * 4, [0, None, 0, 0], [0] * 4], "4 numbers for environment 1, got object"),
        (None, "none for environment 0"),
    ],
)
def test_wrong_actions_are_refused_and_nothing_moves(actions: Any, message: str) -> None:
    envs, other = WalkerVectorEnv(3), WalkerVectorEnv(3)
    for e in (envs, other):
        e.reset(seed=0)
    with pytest.raises(BitneatError) as caught:
        envs.step(actions)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    good = next(random_actions(3, 0))
    np.testing.assert_array_equal(envs.step(good)[0], other.step(good)[0])


def test_an_ignored_action_may_be_anything() -> None:
    envs = WalkerVectorEnv(3, max_episode_steps=1)
    envs.reset(seed=0)
    assert envs.step(np.zeros((3, 4)))[3].all()
    _, rewards, terminated, truncated, _ = envs.step(with_nan(1))
    assert not np.any([rewards, terminated, truncated])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WalkerVectorEnv(0), "num_envs: expected a whole number from 1"),
        (lambda: WalkerVectorEnv(2.0), "num_envs"),  # type: ignore[arg-type]
        (lambda: WalkerVectorEnv(2, max_episode_steps=0), "max_episode_steps"),
        (lambda: WalkerVectorEnv(2, lanes=3), "lanes: expected one of 1, 4, 8, 16"),
        (lambda: WalkerVectorEnv(2, threads=0), "threads: expected a whole number from 1 to 256"),
        (lambda: WalkerVectorEnv(2, autoreset_mode="Later"), "autoreset_mode: expected one of 'NextStep'"),
        (lambda: WalkerVectorEnv(2).step(np.zeros((2, 4))), "reset environment 0 first"),
        (lambda: WalkerVectorEnv(2).reset(seed=-1), "seed of environment 0: expected a number of at least 0"),
        (lambda: WalkerVectorEnv(2).reset(seed=[1, -1]), "seed of environment 1"),
        (lambda: WalkerVectorEnv(2).reset(seed=[1]), "seed: expected 2, one for each environment, got 1"),
        (lambda: WalkerVectorEnv(2).reset(seed=1.5), "seed: expected a number"),  # type: ignore[arg-type]
        (lambda: WalkerVectorEnv(2).reset(options={"reset_mask": [True, True]}), "reset_mask: expected a NumPy array"),
        (lambda: WalkerVectorEnv(2).reset(options={"reset_mask": np.ones(2)}), "got an array of float64"),
        (lambda: WalkerVectorEnv(2).reset(options={"reset_mask": np.ones(3, bool)}), "of shape (3,)"),
        (lambda: WalkerVectorEnv(2).reset(options={"reset_mask": np.zeros(2, bool)}), "at least one environment"),
        (lambda: WalkerVectorEnv(2).get_attr("gravity"), "no attribute 'gravity'"),
        (lambda: WalkerVectorEnv(2).set_attr("gravity", 1), "nothing but 'hardcore'"),
        (lambda: WalkerVectorEnv(2).set_attr("hardcore", [True]), "hardcore: expected 2 values, got 1"),
        (lambda: WalkerVectorEnv(2).call("jump", 3), "no method 'jump'"),
    ],
)
def test_what_makes_no_sense_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(BitneatError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_environment_that_a_mask_left_out_must_be_reset_too() -> None:
    envs = WalkerVectorEnv(2)
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(BitneatError, match="reset environment 1 first"):
        envs.step(np.zeros((2, 4)))


def test_without_autoreset_an_ended_episode_takes_no_step() -> None:
    envs = WalkerVectorEnv(2, max_episode_steps=2, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 4)))
    envs.reset(options={"reset_mask": np.array([True, False])})
    assert envs.step(np.zeros((2, 4)))[3].tolist() == [False, True]
    with pytest.raises(BitneatError, match="episode of environment 1 has ended"):
        envs.step(np.zeros((2, 4)))


def test_closing_frees_the_memory() -> None:
    envs = WalkerVectorEnv(2)
    envs.reset()
    envs.close()
    envs.close()
    assert envs.closed
    assert envs._memory is None
    uses: list[Callable[[], Any]] = [
        envs.reset,
        lambda: envs.step(np.zeros((2, 4))),
        lambda: envs.get_attr("np_random"),
        lambda: envs.set_attr("hardcore", True),
    ]
    for use in uses:
        with pytest.raises(BitneatError, match="closed"):
            use()


def test_a_thousand_walkers_fit_in_64_mib() -> None:
    assert library().simulator_environment_size() * 1024 < 64 * 2**20
    start = WalkerVectorEnv(3)._environments
    assert int(ffi().cast("uintptr_t", start)) % 64 == 0


def test_the_class_is_loaded_when_it_is_asked_for() -> None:
    assert bitneat.sim.walker.WalkerVectorEnv is WalkerVectorEnv
    assert bitneat.sim.walker.run_episodes([], []) is not None
    code = "import sys, bitneat.sim, bitneat.sim.walker; print({'gymnasium', 'numpy', 'cffi'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
    for module in (bitneat.sim, bitneat.sim.walker):
        with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
            module.Nothing  # noqa: B018
