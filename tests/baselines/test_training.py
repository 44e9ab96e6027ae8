# SPDX-License-Identifier: MIT
"""Trainings of a few hundred steps.

Those that need the libraries run where bitneat[baselines] is installed: ``make test-baselines``.
"""

import json
import random
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest

from bitneat import Agent
from bitneat.baselines import BaselineResult, TrainingProgress, load_result, train
from bitneat.baselines.evaluation import network_policy, score
from bitneat.baselines.settings import ArsSettings, DqnSettings, PpoSettings, Settings
from bitneat.baselines.training import CHECKPOINT, POLICY, RESULT, RUN
from bitneat.champion import FloatChampion, load, load_any
from bitneat.errors import BitneatError
from bitneat.evolve.randomness import report_seeds
from bitneat.network import decode
from bitneat.sim.walker.episodes import ACTION

TINY: dict[str, Settings] = {
    "ars": ArsSettings(n_delta=2, n_top=1),
    "ppo": PpoSettings(n_envs=4, batch_size=32, hidden=(8, 6)),
    "dqn": DqnSettings(batch_size=16, buffer_size=300, hidden=(5,)),
}
STEPS = {"ars": 400, "ppo": 600, "dqn": 400}


def small(method: str, folder: Path, seed: int = 0, progress: Any = None, **changes: Any) -> BaselineResult:
    settings = replace(TINY[method], **changes)
    return train(method, STEPS[method], seed, folder, progress, settings=settings, report_episodes=2)


@pytest.fixture
def libraries() -> None:
    for name in ("torch", "stable_baselines3", "sb3_contrib"):
        pytest.importorskip(name, reason="needs bitneat[baselines]")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, BaselineResult]]:
    for name in ("torch", "stable_baselines3", "sb3_contrib"):
        pytest.importorskip(name, reason="needs bitneat[baselines]")
    found = {}
    for method in TINY:
        folder = tmp_path_factory.mktemp("trained") / method
        found[method] = (folder, small(method, folder))
    return found


@pytest.mark.parametrize("method", TINY)
def test_a_training_keeps_to_its_budget_and_scores_a_policy(
    method: str, trained: dict[str, tuple[Path, BaselineResult]]
) -> None:
    _, result = trained[method]
    assert result.steps >= STEPS[method]
    assert (result.system, result.heldout.episodes) == (method, 2)
    weights = {"ars": 24 * 4, "ppo": 24 * 8 + 8 * 6 + 6 * 4, "dqn": 24 * 5 + 5 * 81}[method]
    nodes = {"ars": 4, "ppo": 8 + 6 + 4, "dqn": 5 + 81}[method]
    assert (result.links, result.nodes, result.parameters) == (weights, nodes, weights + nodes)
    assert result.float_bytes == 4 * result.parameters
    assert (result.actions is None) == (method != "dqn")


@pytest.mark.parametrize("method", TINY)
def test_a_second_call_reads_the_result_and_trains_nothing(
    method: str, trained: dict[str, tuple[Path, BaselineResult]]
) -> None:
    folder, result = trained[method]
    told: list[TrainingProgress] = []
    again = small(method, folder, progress=told.append)
    assert told == []
    assert again.to_data() == result.to_data() == load_result(folder).to_data()
    assert again.policy == result.policy


@pytest.mark.parametrize("method", TINY)
def test_the_same_seed_gives_the_same_policy_and_another_one_another(
    method: str, trained: dict[str, tuple[Path, BaselineResult]], tmp_path: Path
) -> None:
    random.seed(method)  # what the caller's generators hold must not matter
    same = small(method, tmp_path / "same")
    other = small(method, tmp_path / "other", seed=1)
    assert same.policy == trained[method][1].policy != other.policy


@pytest.mark.parametrize("method", TINY)
def test_training_leaves_the_callers_random_numbers_alone(method: str, libraries: None, tmp_path: Path) -> None:
    import torch

    def drawn() -> list[float]:
        return [random.random(), float(np.random.rand()), float(torch.rand(1))]  # noqa: NPY002

    def seeded() -> None:
        random.seed(1)
        np.random.seed(1)  # noqa: NPY002
        torch.manual_seed(1)

    seeded()
    expected = drawn()
    seeded()
    small(method, tmp_path / "run")
    assert drawn() == expected


@pytest.mark.parametrize("method", TINY)
def test_the_float_network_acts_as_the_librarys_saved_model_does_on_gymnasiums_observations(
    method: str, trained: dict[str, tuple[Path, BaselineResult]]
) -> None:
    folder, result = trained[method]
    model, normalise = loaded(method, folder)
    env = gymnasium.make("BipedalWalker-v3")
    random_actions = np.random.default_rng(8)
    compared = 0
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        over = False
        while not over:
            normal = normalise(observation)
            chosen = model.predict(normal, deterministic=True)[0]
            outputs = result.policy.step(observation)
            if result.actions is not None:
                values = np.sort(outputs)
                if values[-1] - values[-2] > 1e-4:  # float32 may break a tie otherwise
                    assert outputs.index(max(outputs)) == int(chosen)
            elif np.abs(normal).max() < 10.0:
                np.testing.assert_allclose(decode(ACTION, outputs), chosen, atol=1e-4)
                compared += 1
            action = random_actions.uniform(-1.0, 1.0, 4).astype(np.float32)
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
    env.close()
    assert method == "dqn" or compared > 50


def loaded(method: str, folder: Path) -> tuple[Any, Any]:
    """The library's model as anybody loads it, and the normalisation that belongs to it."""
    import pickle

    from sb3_contrib import ARS
    from stable_baselines3 import DQN, PPO

    model = {"ars": ARS, "ppo": PPO, "dqn": DQN}[method].load(folder / "model.zip", device="cpu")
    if method == "dqn":
        return model, lambda observation: observation
    return model, pickle.loads((folder / "vecnormalize.pkl").read_bytes()).normalize_obs


def test_a_policy_of_four_outputs_is_a_champion_file(trained: dict[str, tuple[Path, BaselineResult]]) -> None:
    for method in ("ars", "ppo"):
        champion = load_any(trained[method][0] / "champion.pkl")
        assert isinstance(champion, FloatChampion)
        assert champion.network == trained[method][1].policy
    assert not (trained["dqn"][0] / "champion.pkl").exists()


class StoppedError(Exception):
    """A training is interrupted."""


def stopped_after(count: int) -> Any:
    told: list[TrainingProgress] = []

    def tell(progress: TrainingProgress) -> None:
        told.append(progress)
        if len(told) == count:
            raise StoppedError

    return tell


def test_ars_goes_on_after_an_interruption_to_the_same_policy(libraries: None, tmp_path: Path) -> None:
    def run(folder: Path, progress: Any = None) -> BaselineResult:
        return train("ars", 15_000, 3, folder, progress, settings=TINY["ars"], report_episodes=2)

    whole = run(tmp_path / "whole")
    with pytest.raises(StoppedError):
        run(tmp_path / "halves", stopped_after(3))
    assert (tmp_path / "halves" / CHECKPOINT).exists()
    told: list[TrainingProgress] = []
    halves = run(tmp_path / "halves", told.append)
    assert len(told) > 1, "nothing was left to do"
    assert (halves.policy, halves.steps, halves.episodes) == (whole.policy, whole.steps, whole.episodes)
    assert halves.heldout == whole.heldout
    assert (tmp_path / "halves" / "history.csv").read_bytes() == (tmp_path / "whole" / "history.csv").read_bytes()
    assert not (tmp_path / "halves" / CHECKPOINT).exists()


@pytest.mark.parametrize(("method", "steps"), [("ppo", 1200), ("dqn", 20_400)])
def test_ppo_and_dqn_go_on_from_their_checkpoint_to_the_budget(
    method: str, steps: int, libraries: None, tmp_path: Path
) -> None:
    changes: dict[str, Any] = {"n_steps": 80} if method == "ppo" else {"train_freq": 200, "gradient_steps": 1}
    settings = replace(TINY[method], **changes)

    def run(progress: Any = None) -> BaselineResult:
        return train(method, steps, 3, tmp_path, progress, settings=settings, report_episodes=2)

    with pytest.raises(StoppedError):
        run(stopped_after(3))
    told: list[TrainingProgress] = []
    result = run(told.append)
    rows = [row.split(",") for row in (tmp_path / "history.csv").read_text().split()[1:]]
    counts = [(int(steps), int(episodes)) for steps, episodes, _ in rows]
    assert counts == sorted(counts)
    assert (result.steps, result.episodes) == counts[-1]
    assert result.steps - told[0].steps < steps, "began anew"


def test_a_damaged_checkpoint_is_named(libraries: None, tmp_path: Path) -> None:
    with pytest.raises(StoppedError):
        small("ars", tmp_path, progress=stopped_after(1))
    (tmp_path / CHECKPOINT).write_bytes(b"nothing")
    with pytest.raises(BitneatError, match=r"checkpoint\.pt: damaged"):
        small("ars", tmp_path)


def test_a_folder_of_another_training_is_refused_with_what_differs(tmp_path: Path) -> None:
    data = {"format": "bitneat-baseline", "version": 1, "method": "ars", "steps": 400, "seed": 5}
    (tmp_path / RUN).write_text(json.dumps({**data, "report_episodes": 2, "settings": {}}))
    with pytest.raises(BitneatError, match="holds another training, whose seed is 5, not 0"):
        small("ars", tmp_path)
    (tmp_path / RUN).write_text("[]")
    with pytest.raises(BitneatError, match=r"baseline\.json: damaged"):
        small("ars", tmp_path)


def test_a_damaged_result_is_named(tmp_path: Path) -> None:
    with pytest.raises(BitneatError, match=r"result\.json: cannot read"):
        load_result(tmp_path)
    (tmp_path / RESULT).write_text("{}")
    (tmp_path / POLICY).write_bytes(b"")
    with pytest.raises(BitneatError, match=r"result\.json: damaged"):
        load_result(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sac", 10, 0), "expected one of ars, ppo, dqn, got 'sac'"),
        (("ars", 0, 0), "steps: expected a whole number"),
        (("ars", 10, -1), "seed: expected a whole number"),
        (("ars", 10, 2**29 + 1), "seed: expected a whole number"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(BitneatError, match=message):
        train(*arguments, tmp_path)


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "sb3_contrib"])
def test_a_missing_library_is_one_line_that_says_what_to_install(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(BitneatError, match=r"not installed; pip install 'bitneat\[baselines\]'$"):
        small("ars", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_the_librarys_environment_tells_ends_as_the_librarys_own_does(libraries: None) -> None:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    from bitneat.baselines.vecenv import WalkerVecEnv

    ours = WalkerVecEnv(2)
    # Fresh environments at each episode's start are what ours are, so the comparison ends with the first end of each.
    theirs = DummyVecEnv([lambda: Monitor(gymnasium.make("BipedalWalker-v3", max_episode_steps=1600))] * 2)
    for env in (ours, theirs):
        env.seed(4)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    draw = np.random.default_rng(2)
    ended = [False, False]
    while not all(ended):
        actions: npt.NDArray[Any] = draw.uniform(-1.0, 1.0, (2, 4)).astype(np.float32)
        left, right = ours.step(actions), theirs.step(actions)
        for index in (i for i in range(2) if not ended[i]):
            assert left[1][index] == right[1][index]
            assert left[2][index] == right[2][index]
            ended[index] = bool(left[2][index])
            if not ended[index]:
                np.testing.assert_array_equal(left[0][index], right[0][index])
                continue
            mine, other = left[3][index], right[3][index]
            np.testing.assert_array_equal(mine["terminal_observation"], other["terminal_observation"])
            assert mine["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert mine["episode"]["l"] == other["episode"]["l"]
            assert mine["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)


def test_an_episode_that_only_the_time_limit_ends_is_told_as_truncated(libraries: None) -> None:
    from bitneat.baselines.vecenv import WalkerVecEnv

    # At rest a walker falls after some 120 steps.
    for limit, truncated in ((100, True), (200, False)):
        env = WalkerVecEnv(1, max_episode_steps=limit)
        env.seed(1)
        env.reset()
        while not env.episodes:
            infos = env.step(np.zeros((1, 4), np.float32))[3]
        assert infos[0]["TimeLimit.truncated"] == truncated
        assert (infos[0]["episode"]["l"] == limit) == truncated


def test_a_fall_counts_what_it_is_told_and_all_else_as_it_is(libraries: None) -> None:
    from bitneat.baselines.vecenv import WalkerVecEnv

    rewards = []
    for env in (WalkerVecEnv(2, hardcore=True, fall_value=-20.0), WalkerVecEnv(2, hardcore=True)):
        env.seed(3)
        env.reset()
        steps = [env.step(np.ones((2, 4), np.float32)) for _ in range(300)]
        rewards.append(np.array([step[1] for step in steps]))
        told = [info["episode"]["r"] for step in steps for info in step[3] if info]
        assert told
        assert max(told) < -90  # the official reward
    falls = rewards[1] == -100.0
    assert 0 < falls.sum() < 30
    assert (rewards[0][falls] == -20.0).all()
    assert (rewards[0][~falls] == rewards[1][~falls]).all()


def test_a_walker_that_stands_for_too_long_ends_as_one_that_falls(libraries: None) -> None:
    from bitneat.baselines.vecenv import WalkerVecEnv

    plain = WalkerVecEnv(2)
    ours = WalkerVecEnv(2, fall_value=-30.0, stall_steps=40, stall_gain=3.0)
    for env in (plain, ours):
        env.seed(6)
        env.reset()
    still = np.zeros((2, 4), np.float32)
    steps = [(plain.step(still), ours.step(still)) for _ in range(40)]
    for left, right in steps[:-1]:
        np.testing.assert_array_equal(left[0], right[0])
        np.testing.assert_array_equal(left[1], right[1])
        assert not left[2].any()
        assert not right[2].any()
    left, right = steps[-1]
    assert not left[2].any()
    assert right[2].all()
    assert right[1].tolist() == [-30.0, -30.0]
    assert ours.episodes == 2
    for index in range(2):
        np.testing.assert_array_equal(right[3][index]["terminal_observation"], left[0][index])
        assert right[3][index]["TimeLimit.truncated"] is False
        assert right[3][index]["episode"]["l"] == 40
        assert right[3][index]["episode"]["r"] == pytest.approx(
            sum(float(step[0][1][index]) for step in steps), abs=1e-5
        )
        assert not np.array_equal(right[0][index], left[0][index])  # of the next episode
    assert not any(ours.step(still)[2].any() for _ in range(39))
    assert ours.step(still)[2].all()


def test_a_walker_that_gets_on_does_not_stand(libraries: None) -> None:
    from bitneat.baselines.vecenv import WalkerVecEnv

    walker = Agent(load(Path(__file__).parents[2] / "examples" / "champions" / "walker.pkl"))
    lengths = []
    for gain in (10.0, 1000.0):
        env = WalkerVecEnv(1, stall_steps=150, stall_gain=gain)
        env.seed(1)
        observations = env.reset()
        walker.reset()
        while not env.episodes:
            observations, _, _, infos = env.step(np.array([walker.act(observations[0])], np.float32))
        lengths.append(infos[0]["episode"]["l"])
    assert lengths[0] > 500
    assert lengths[1] == 150


def test_a_discrete_action_is_a_row_of_the_table(libraries: None) -> None:
    from bitneat.baselines.actions import action_table
    from bitneat.baselines.vecenv import WalkerVecEnv

    table = action_table()
    discrete, continuous = WalkerVecEnv(3, table), WalkerVecEnv(3)
    for env in (discrete, continuous):
        env.seed(9)
        env.reset()
    for chosen in np.random.default_rng(3).integers(81, size=(20, 3)):
        np.testing.assert_array_equal(discrete.step(chosen)[0], continuous.step(table[chosen])[0])


def test_the_hardcore_walker_is_trained_for_and_scored_on_its_own_ground(libraries: None, tmp_path: Path) -> None:
    from bitneat.baselines.stable import normalized

    for hardcore in (False, True):
        walkers = normalized(2, hardcore).venv._envs
        assert (walkers.spec.kwargs.get("hardcore", False), walkers.spec.max_episode_steps) == (
            hardcore,
            2000 if hardcore else 1600,
        )
    settings = replace(TINY["ppo"], n_envs=64, batch_size=64)
    easy = train("ppo", 600, 0, tmp_path / "easy", settings=settings, report_episodes=3)
    hard = train("ppo", 600, 0, tmp_path / "hard", settings=settings, report_episodes=3, hardcore=True)
    assert json.loads((tmp_path / "hard" / RUN).read_text())["hardcore"] is True
    champion = load_any(tmp_path / "hard" / "champion.pkl")
    assert champion.environment is not None
    assert champion.environment.id == "BipedalWalkerHardcore-v3"
    assert isinstance(champion, FloatChampion)
    again, _ = score(network_policy(champion.network), report_seeds(3), hardcore=True)
    assert again == hard.heldout != easy.heldout
    with pytest.raises(BitneatError, match="holds another training"):
        train("ppo", 600, 0, tmp_path / "easy", settings=settings, report_episodes=3, hardcore=True)
