# SPDX-License-Identifier: MIT
"""`bitneat bench sim`: what it measures is what it says, and a controller that walks."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from bitneat.bench import simulator
from bitneat.bench.simulator import Comparison, bare_work, record
from bitneat.bench.walking import NUM_LINKS, SEEDS, BatchPolicy, champion, fifty_links
from bitneat.champion import load
from bitneat.cli.main import main
from bitneat.controller import Encoder, Reference
from bitneat.controller.passes import optimize
from bitneat.runtime import Population
from bitneat.sim.environment import used_inputs
from bitneat.sim.walker.episodes import ACTION, run_episodes
from tests.conftest import ROOT


def test_the_shipped_controller_is_the_example() -> None:
    assert champion() == load(ROOT / "examples" / "walker" / "champion.json").controller


def test_the_measured_controller_has_50_links_that_nothing_removes_and_reads_every_input() -> None:
    controller = fifty_links()
    assert controller.num_links == NUM_LINKS
    assert controller.canonical == controller
    assert optimize(controller).num_links >= NUM_LINKS
    assert controller.is_ternary
    assert not controller.is_recurrent
    assert used_inputs(controller) == list(range(24))


def test_it_computes_what_the_champion_does() -> None:
    original, padded = champion(), fifty_links()
    limits = [entry.limit for entry in original.inputs]
    draw = np.random.default_rng(3)
    small = draw.integers(-3, 4, (5000, 24))
    large = draw.integers(np.negative(limits), np.add(limits, 1), (20000, 24))
    inputs = np.concatenate([small, large]).astype(np.int16)
    ours, expected = (Population([controller]).run([inputs])[0] for controller in (padded, original))
    assert np.array_equal(ours, expected)
    rows = inputs[4900:5100].tolist()
    assert Reference(padded).run(rows) == Reference(original).run(rows)


def test_the_padding_is_at_work() -> None:
    reference = Reference(fifty_links())
    draw = np.random.default_rng(4)
    seen: set[tuple[int, ...]] = set()
    for row in draw.integers(-256, 257, (200, 24)).tolist():
        reference.step(row)
        seen.add(tuple(reference.signals))
    moving = [len({signals[index] for signals in seen}) for index in range(24, reference.controller.num_signals)]
    assert min(moving) > 1


def test_it_walks_every_measured_episode_to_the_end_as_the_champion_does() -> None:
    rewards, steps = run_episodes([champion(), fifty_links()], SEEDS)
    assert np.array_equal(rewards[0], rewards[1])
    assert (steps == simulator.EPISODE_STEPS).all()
    assert rewards.min() > 150
    assert len(set(SEEDS)) == len(SEEDS) == 96


def test_a_batch_acts_as_one_controller_does() -> None:
    controller = fifty_links()
    encoder, reference = Encoder(controller), Reference(controller)
    observations = np.random.default_rng(5).normal(0, 2, (300, 24)).astype(np.float32)
    expected = [
        ACTION.decode(np.array(reference.step(encoder(row).tolist()), np.int16), controller.frac_bits)
        for row in observations
    ]
    actions = BatchPolicy(controller)(observations)
    assert actions.dtype == np.float32
    assert np.array_equal(actions, np.array(expected))


def test_the_bare_loop_walks_the_recorded_path(monkeypatch: pytest.MonkeyPatch) -> None:
    controller, limit, rewards = fifty_links(), 120, []

    class Telling(gymnasium.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:
            result = super().step(action)
            rewards.append(float(result[1]))
            return result

    recordings = record(controller, SEEDS[:2], limit)
    make = simulator.make
    monkeypatch.setattr(simulator, "make", lambda spec: Telling(make(spec)))
    steps, seconds = bare_work(recordings)
    assert steps == 2 * limit == len(rewards)
    assert seconds > 0
    ours, _ = run_episodes([controller], SEEDS[:2], limit)
    for episode, expected in enumerate(ours[0]):
        total = 0.0
        for reward in rewards[episode * limit : (episode + 1) * limit]:
            total += reward
        assert total == expected


@pytest.fixture
def short_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "EPISODE_STEPS", 30)
    monkeypatch.setattr(simulator, "_VECTOR_WALKERS", 32)


RATIOS = {
    "gymnasium_ratio",
    "gymnasium_ratio_with_controller",
    "gymnasium_ratio_all_cores",
    "envpool_ratio",
    "envpool_ratio_all_cores",
}


def numbers(data: Any) -> Iterator[Any]:
    if isinstance(data, dict):
        for value in data.values():
            yield from numbers(value)
    else:
        yield data


@pytest.mark.usefixtures("short_turns")
def test_the_command_gives_a_table_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulator, "_envpool", lambda: (None, "it is not installed"))
    out = tmp_path / "bench.json"
    assert main(["bench", "sim", "--repetitions", "1", "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    found = json.loads(out.read_text())
    general = {"machine", "repetitions", "measurements"}
    assert set(found) == general | {"links", "lanes", "cores", "steps_per_second", *RATIOS}
    assert f"native walker: {found['lanes']} lane" in printed
    assert "EnvPool was not measured: it is not installed" in printed
    rates = found["steps_per_second"]
    assert set(rates) == {"bitneat", "gymnasium", "envpool"}
    assert rates["envpool"] is found["envpool_ratio"] is found["envpool_ratio_all_cores"] is None
    by_lanes = rates["bitneat"].pop("by_lanes")
    assert set(by_lanes) == {"1", "4", "8", "16"}
    assert by_lanes[str(found["lanes"])] == rates["bitneat"]["one_core"]
    assert all((rate is None) == (int(width) > found["lanes"]) for width, rate in by_lanes.items())
    assert all(rate > 0 for side in ("bitneat", "gymnasium") for rate in numbers(rates[side]))
    assert found["gymnasium_ratio"] == rates["bitneat"]["one_core"] / rates["gymnasium"]["one_core"]
    for line in found["measurements"]:
        assert f"| {line['what']} " in printed


class FakeEnvPool:
    """As many walkers as asked for, that say what they see."""

    def __init__(self) -> None:
        self.made: list[tuple[int, int]] = []

    def make_gymnasium(self, task: str, *, num_envs: int, num_threads: int, seed: int) -> Any:
        assert task == "BipedalWalker-v3"
        self.made.append((num_envs, num_threads))
        from bitneat.sim.walker.vector import WalkerVectorEnv

        return WalkerVectorEnv(num_envs)


@pytest.mark.usefixtures("short_turns")
def test_envpool_takes_its_turns_where_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = FakeEnvPool()
    monkeypatch.setattr(simulator, "_envpool", lambda: (fake, "EnvPool 1"))
    comparison = simulator.compare(1)
    assert fake.made == [(16, 1), (16 * comparison.cores, comparison.cores)]
    data = comparison.to_data()
    assert all(rate > 0 for rate in numbers(data["steps_per_second"]["envpool"]))
    assert data["envpool_ratio"] > 0
    assert data["envpool_ratio_all_cores"] > 0
    assert not comparison.notes
    assert sum("EnvPool" in line.compared_with for line in comparison.measurements()) == 2


@pytest.mark.parametrize(
    ("lanes", "goals"),
    [
        (16, [">= 100000, at least 60000", ">= 20, at least 12", ">= 8", ">= 35000"]),
        (8, [">= 35000"]),
        (4, []),
    ],
)
def test_the_goals_are_those_of_the_lane_width(lanes: int, goals: list[str]) -> None:
    speeds = {16: 90_000.0, 8: 50_000.0, 4: 30_000.0, 1: 10_000.0}
    rates = {f"bitneat, {width} lanes": [speed] for width, speed in speeds.items() if width < lanes}
    rates |= {"bitneat": [speeds[lanes]], "gymnasium": [4000.0], "envpool": [12_000.0]}
    lines = Comparison(50, lanes, 2, "EnvPool 1", rates).measurements()
    assert [line.goal for line in lines if line.goal] == goals
    assert [line.met for line in lines if line.goal] == {16: [False, True, False, True], 8: [True], 4: []}[lanes]


def test_ratios_are_of_the_same_turn() -> None:
    comparison = Comparison(50, 16, 2, "", {"bitneat": [10.0, 40.0, 90.0], "gymnasium": [1.0, 8.0, 3.0]})
    assert comparison.ratio("bitneat", "gymnasium") == 10.0
    assert comparison.rate("bitneat") == 40.0
    assert comparison.ratio("bitneat", "envpool") is None
