# SPDX-License-Identifier: MIT
"""Environments and episodes: what is refused, what is derived, and that the fast loop is the plain one to the bit."""

from __future__ import annotations

import math
import random
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from bitneat.champion import EnvironmentSpec
from bitneat.controller import BoxAction, DiscreteAction, Encoder, Reference
from bitneat.errors import BitneatError
from bitneat.runtime import RuntimeController
from bitneat.sim import bipedal
from bitneat.sim.environment import EpisodeRunner, Shaping, allow_imports, default_inputs, inspect, make
from tests.sim.strange import register
from tests.strategies import random_controller

register()

ENVIRONMENTS = {
    "BipedalWalker-v3": (24, 4, 1600),
    "BipedalWalkerHardcore-v3": (24, 4, 2000),
    "LunarLander-v3": (8, 4, 1000),
    "CartPole-v1": (4, 2, 500),
    "Acrobot-v1": (6, 3, 500),
    "Pendulum-v1": (3, 1, 200),
    "MountainCarContinuous-v0": (2, 1, 999),
}


@pytest.mark.parametrize(("name", "shape"), ENVIRONMENTS.items())
def test_spaces_of_the_supported_environments_are_read(name: str, shape: tuple[int, int, int]) -> None:
    info = inspect(EnvironmentSpec(name))
    assert (info.num_inputs, info.action.num_outputs, info.max_steps) == shape


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("NoSuchEnvironment-v0", "environment NoSuchEnvironment-v0: "),
        ("CartPole-v77", "environment CartPole-v77: "),
        ("no_such_module:Some-v0", "an id with ':' imports a module; name the module with --import"),
        ("bitneat/Dict-v0", "its observation is a Dict space, expected a Box"),
        ("bitneat/Image-v0", r"its observation is an image of shape \(8, 8, 3\)"),
        ("bitneat/Unbounded-v0", "its action is an unbounded Box"),
        ("bitneat/MultiBinary-v0", "its action is a MultiBinary space"),
        ("bitneat/Far-v0", "a Discrete space whose start 1099511627776 does not fit 32 bits"),
        ("bitneat/Broken-v0", "cannot be made: KeyError: 'no"),
        ("bitneat/Quitting-v0", "cannot be made: SystemExit: 0"),
        ("bitneat/Missing-v0", "a dependency is missing: pip install"),
    ],
)
def test_environments_that_no_controller_can_serve_are_refused_in_one_line(name: str, message: str) -> None:
    with pytest.raises(BitneatError, match=message) as caught:
        inspect(EnvironmentSpec(name))
    assert "\n" not in str(caught.value)


def test_a_wrong_argument_or_import_is_refused() -> None:
    with pytest.raises(BitneatError, match=r"CartPole-v1: .*wings"):
        inspect(EnvironmentSpec("CartPole-v1", {"wings": 2}))
    allow_imports(["no_such_module"])
    with pytest.raises(BitneatError, match="--import no_such_module: No module named"):
        inspect(EnvironmentSpec("CartPole-v1", {}, ("no_such_module",)))


def test_a_module_is_imported_only_if_the_user_named_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "stranger_module.py").write_text("raise SystemExit(0)")
    monkeypatch.syspath_prepend(str(tmp_path))
    spec = EnvironmentSpec("CartPole-v1", {}, ("stranger_module",))
    with pytest.raises(BitneatError, match="environment CartPole-v1: needs --import stranger_module"):
        make(spec)
    allow_imports(["stranger_module"])
    with pytest.raises(BitneatError, match="--import stranger_module: SystemExit: 0"):
        make(spec)


@pytest.mark.parametrize("kind", ["NaNReward", "InfReward"])
def test_rewards_that_are_no_numbers_are_refused(kind: str) -> None:
    spec = EnvironmentSpec(f"bitneat/{kind}-v0")
    info = inspect(spec)
    controller = random_controller(random.Random(1), size="small", num_inputs=2, num_outputs=2)
    with pytest.raises(BitneatError, match=r"a reward of seed 3 is (nan|inf)"):
        EpisodeRunner(spec, controller, info.action, RuntimeController(controller))(3, 20)


def test_a_box_with_an_axis_below_one_is_refused() -> None:
    with pytest.raises(BitneatError, match="an axis without components"):
        BoxAction((0.0, 0.0), (1.0, 1.0), (-1, -2), "float32")


def test_limits_follow_finite_bounds_and_small_ranges_are_scaled_up() -> None:
    inputs = default_inputs(inspect(EnvironmentSpec("MountainCarContinuous-v0")), 8)
    assert [(entry.scale, entry.limit) for entry in inputs] == [(0, 308), (3, 144)]
    cartpole = default_inputs(inspect(EnvironmentSpec("CartPole-v1")), 8)
    assert [entry.limit for entry in cartpole] == [1229, 32767, 215, 32767]
    walker = default_inputs(inspect(EnvironmentSpec("BipedalWalker-v3")), 8)
    assert {entry.scale for entry in walker} == {0}
    assert walker[0].limit == math.ceil(math.pi * 256)


def test_wide_bounds_are_scaled_down_into_the_range_of_signals() -> None:
    inputs = default_inputs(inspect(EnvironmentSpec("bitneat/Wide-v0")), 8)
    assert inputs[0].scale < 0
    assert inputs[0].limit <= 32767
    assert math.ldexp(1000.0, 8 + inputs[0].scale) <= 32767


def plain_episode(spec: EnvironmentSpec, controller, action, seed: int, max_steps: int) -> tuple[float, int]:  # type: ignore[no-untyped-def]
    """The loop as docs/semantics.md says it, on the reference and an untouched Gymnasium."""
    environment = gymnasium.make(spec.id, **spec.kwargs)
    reference, encode = Reference(controller), Encoder(controller)
    observation, _ = environment.reset(seed=seed)
    total, steps, terminated, truncated = 0.0, 0, False, False
    while not (terminated or truncated) and steps < max_steps:
        outputs = np.array(reference.step(encode(np.reshape(observation, -1))), dtype=np.int16)
        chosen = action.decode(outputs, controller.frac_bits)
        observation, reward, terminated, truncated, _ = environment.step(chosen)
        total += float(reward)
        steps += 1
    return total, steps


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("simulator", ["gymnasium", "auto"])
def test_episodes_equal_the_plain_loop_to_the_bit(name: str, simulator: str) -> None:
    spec = EnvironmentSpec(name)
    info = inspect(spec)
    rng = random.Random(f"{name}")
    for seed in range(4):
        controller = random_controller(
            rng, size="small", num_inputs=info.num_inputs, num_outputs=info.action.num_outputs
        )
        run = EpisodeRunner(spec, controller, info.action, RuntimeController(controller), simulator)
        result = run(seed, 150)
        assert (result.reward, result.steps) == plain_episode(spec, controller, info.action, seed, 150)
        assert result.shaped == result.reward


@pytest.mark.parametrize("simulator", ["gymnasium", "auto"])
def test_an_episode_does_not_depend_on_those_before_it(simulator: str) -> None:
    spec = EnvironmentSpec("BipedalWalker-v3")
    info = inspect(spec)
    controller = random_controller(random.Random(3), num_inputs=24, num_outputs=4)
    run = EpisodeRunner(spec, controller, info.action, RuntimeController(controller), simulator)
    once = [run(seed, 200) for seed in range(6)]
    assert [run(seed, 200) for seed in reversed(range(6))] == once[::-1]


@pytest.mark.parametrize("name", ["BipedalWalker-v3", "BipedalWalkerHardcore-v3"])
def test_the_lean_walker_is_gymnasiums_to_the_bit(name: str) -> None:
    spec = EnvironmentSpec(name)
    assert bipedal.serves(spec), "another Gymnasium: check LeanWalker against it and add its digests"
    lean = bipedal.make(spec, range(24))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        plain = make(spec)
        np.testing.assert_array_equal(plain.reset(seed=seed)[0], lean.reset(seed=seed)[0])
        action = np.zeros(4, np.float32)
        for step in range(250):
            if step % (seed + 1) == 0:
                kind = rng.integers(3)
                action = np.array([rng.uniform(-1, 1, 4), rng.integers(-1, 2, 4), np.zeros(4)][kind], np.float32)
            observation, reward, terminated, _, _ = plain.step(action)
            other, other_reward, other_terminated, _, _ = lean.step(action)
            assert observation.tobytes() == other.tobytes(), f"seed {seed}, step {step}"
            assert (float(reward), terminated) == (other_reward, other_terminated), f"seed {seed}, step {step}"
            if terminated:
                break


def test_the_lean_walker_serves_nothing_else() -> None:
    assert not bipedal.serves(EnvironmentSpec("CartPole-v1"))
    assert not bipedal.serves(EnvironmentSpec("BipedalWalker-v3", {"render_mode": "human"}))


def test_shaping_changes_the_searchs_reward_alone() -> None:
    spec = EnvironmentSpec("BipedalWalker-v3")
    info = inspect(spec)
    controller = random_controller(random.Random(1), num_inputs=24, num_outputs=4)
    run = EpisodeRunner(spec, controller, info.action, RuntimeController(controller), "auto")
    official = run(0, 1600)
    assert official.terminated
    shaped = run(0, 1600, Shaping(fall_reward=-100, fall_value=-7))
    assert shaped.reward == official.reward
    assert shaped.shaped == pytest.approx(official.reward + 93)
    stalled = run(0, 1600, Shaping(stall_steps=5, stall_gain=50))
    assert stalled.stalled
    assert stalled.steps == 5
    assert run(0, 1600, Shaping(max_steps=9)).steps == 9


def test_a_nan_in_an_observation_is_an_error() -> None:
    spec = EnvironmentSpec("bitneat/NaN-v0")
    info = inspect(spec)
    controller = random_controller(random.Random(1), num_inputs=2, num_outputs=info.action.num_outputs)
    run = EpisodeRunner(spec, controller, info.action, RuntimeController(controller))
    with pytest.raises(BitneatError, match="observation 2 of seed 0 holds a NaN"):
        run(0, 10)


def test_actions_have_the_shape_type_and_start_of_their_space() -> None:
    box = inspect(EnvironmentSpec("bitneat/Matrix-v0"))
    assert isinstance(box.action, BoxAction)
    assert box.num_inputs == 6
    controller = random_controller(random.Random(2), num_inputs=6, num_outputs=4)
    EpisodeRunner(EnvironmentSpec("bitneat/Matrix-v0"), controller, box.action, RuntimeController(controller))(0, 20)
    discrete = inspect(EnvironmentSpec("bitneat/Started-v0"))
    assert discrete.action == DiscreteAction(3, 5)
    controller = random_controller(random.Random(2), num_inputs=2, num_outputs=3)
    EpisodeRunner(EnvironmentSpec("bitneat/Started-v0"), controller, discrete.action, RuntimeController(controller))(
        0, 20
    )
