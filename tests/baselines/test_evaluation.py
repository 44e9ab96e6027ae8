# SPDX-License-Identifier: MIT
"""Scores against `FloatNetwork.step` and Gymnasium, one episode after the other."""

import random

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest

from bitneat.baselines.actions import action_table
from bitneat.baselines.evaluation import HeldOut, batched, network_policy, score
from bitneat.network import ACTIVATIONS, FloatNetwork, FloatNode, decode
from bitneat.sim.walker.episodes import ACTION
from tests.baselines.test_dense import random_dense


def any_network(seed: int, outputs: int) -> FloatNetwork:
    draw = random.Random(seed)
    nodes = []
    for index in range(20):
        links = tuple((source, draw.gauss(0, 1)) for source in range(24 + index) if draw.random() < 0.3)
        nodes.append(FloatNode(links, draw.gauss(0, 1), draw.gauss(1, 0.3), draw.choice(list(ACTIVATIONS))))
    return FloatNetwork(24, tuple(nodes), tuple(draw.randrange(44) for _ in range(outputs)))


def in_gymnasium(network: FloatNetwork, seed: int, table: npt.NDArray[np.float32] | None) -> tuple[float, int]:
    env = gymnasium.make("BipedalWalker-v3")
    observation, _ = env.reset(seed=seed)
    total, steps, over = 0.0, 0, False
    while not over:
        outputs = network.step(observation)
        action = decode(ACTION, outputs) if table is None else table[outputs.index(max(outputs))]
        observation, reward, terminated, truncated, _ = env.step(action)
        total, steps, over = total + float(reward), steps + 1, terminated or truncated
    env.close()
    return total, steps


@pytest.mark.parametrize("seed", range(8))
def test_many_observations_at_once_give_the_bits_of_one_by_one(seed: int) -> None:
    network = any_network(seed, 4)
    observations = np.random.default_rng(seed).normal(0.0, 1.0, (9, 24)).astype(np.float32)
    assert batched(network)(observations).tolist() == [network.step(row) for row in observations]


@pytest.mark.parametrize("activation", list(ACTIVATIONS))
def test_numpys_functions_are_the_same_but_for_the_last_bits(activation: str) -> None:
    network = FloatNetwork(1, (FloatNode(((0, 1.0),), 0.0, 1.0, activation),), (1,))
    observations = np.concatenate((np.linspace(-5.0, 5.0, 1001), [-1e4, 1e4]))[:, None]
    assert batched(network, exact=False)(observations) == pytest.approx(batched(network)(observations), abs=1e-14)


@pytest.mark.parametrize("hidden", ["tanh", "relu"])
def test_layers_give_the_same_bits_too(hidden: str) -> None:
    network = random_dense((24, 9, 7, 4), hidden).to_network()
    observations = np.random.default_rng(1).normal(0.0, 1.0, (9, 24)).astype(np.float32)
    assert batched(network)(observations).tolist() == [network.step(row) for row in observations]


def test_the_score_of_a_network_is_gymnasiums() -> None:
    network = random_dense((24, 6, 4)).to_network()
    seeds = (2, 9)
    expected = [in_gymnasium(network, seed, None) for seed in seeds]
    held_out, steps = score(network_policy(network), seeds, threads=1)
    assert (held_out.min, held_out.max) == (min(r for r, _ in expected), max(r for r, _ in expected))
    assert steps == sum(s for _, s in expected)


def test_a_network_that_chooses_from_a_table_takes_the_first_row_with_the_largest_output() -> None:
    table = action_table()
    network = random_dense((24, 5, 81), "relu", clipped=False, seed=4).to_network()
    reward, steps = in_gymnasium(network, 6, table)
    held_out, taken = score(network_policy(network, table), [6], threads=1)
    assert (held_out.mean, taken) == (reward, steps)


def test_a_score_counts_the_part_of_the_episodes_with_300_or_more() -> None:
    held_out = HeldOut.of([300.0, 299.9, 310.0, -100.0])
    assert held_out.solved == 0.5
    assert held_out.mean == pytest.approx(202.475)
    assert held_out.std == pytest.approx(float(np.std([300.0, 299.9, 310.0, -100.0])))
    assert HeldOut(**held_out.to_data()) == held_out
