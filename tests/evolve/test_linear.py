# SPDX-License-Identifier: MIT
"""The linear start: its arithmetic, its strategy on a known landscape, and its checkpoints."""

import json
import math
import random
from collections.abc import Sequence

import numpy as np
import pytest

from bitneat.controller import Controller, Input, Reference
from bitneat.errors import BitneatError
from bitneat.evolve.linear import LinearSearch
from bitneat.sim.environment import EpisodeResult, Shaping

INPUTS = (Input(0, 2047),) * 3
TARGET = np.array([[1.5, -0.75, 0.25, 0.5], [-2.0, 0.0, 1.0, -1.0]])


class Landscape:
    """The reward is high where a policy's links are near the target's; a fall is told by the shaping."""

    def __init__(self) -> None:
        self.fall_values: list[float] = []

    def evaluate(
        self, controllers: Sequence[Controller], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        assert shaping is not None
        self.fall_values.append(shaping.fall_value)
        return [[EpisodeResult(r, r, 5, True, False) for r in [self.reward(c)] * len(seeds)] for c in controllers]

    def reward(self, controller: Controller) -> float:
        error = 0.0
        for node, row in zip(controller.nodes, TARGET, strict=True):
            weights = [0.0, 0.0, 0.0, node.bias * 2.0**node.gain / 256]
            for link in node.links:
                weights[link.source] += link.sign * 2.0 ** (link.shift + node.gain)
            error += sum((a - b) ** 2 for a, b in zip(weights, row, strict=True))
        return -error

    def close(self) -> None:
        pass


def test_the_strategy_comes_near_the_target() -> None:
    search = LinearSearch(INPUTS, 2, 8, seed=3, population=16, episodes=1)
    rows = [search.advance(Landscape()) for _ in range(120)]
    assert Landscape().reward(search.shifted()) > -0.1
    assert rows[-1].best > rows[0].best
    assert rows[-1].step_size < 0.2


def test_ternary_and_shifted_policies_act_alike() -> None:
    search = LinearSearch(INPUTS, 2, 8, seed=3, population=16, episodes=1)
    for _ in range(120):
        search.advance(Landscape())
    ternary, shifted = search.ternary(2), search.shifted(resolution=2)
    assert ternary.is_ternary
    assert not shifted.is_ternary
    generator = random.Random(1)
    for _ in range(300):
        inputs = [generator.randint(-400, 400) for _ in INPUTS]
        exact = np.clip(TARGET[:, :3] @ np.array(inputs) + 256 * TARGET[:, 3], -256, 256)
        # Each power of two is rounded on its own, and the ternary constant to an integer.
        assert Reference(shifted).step(inputs) == pytest.approx(exact, abs=100)
        assert Reference(ternary).step(inputs) == pytest.approx(Reference(shifted).step(inputs), abs=140)


@pytest.mark.parametrize(
    ("count", "weight", "shifted", "ternary"),
    [(500, 8.0, 8, 8), (700, 8.0, 4, 8), (700, -7.5, -3.75, -7.5), (16000, 8.0, 0.25, 4)],
)
def test_a_policy_of_very_many_inputs_has_weights_that_fit_the_accumulator(
    count: int, weight: float, shifted: float, ternary: float
) -> None:
    search = LinearSearch((Input(0, 32767),) * count, 1, 8, seed=1, population=4)
    search._mean = np.array([weight] * count + [0.0])
    inputs = [16] + [0] * (count - 1)
    assert Reference(search.shifted()).step(inputs) == [16 * shifted]
    assert Reference(search.ternary(4)).step(inputs) == [16 * ternary]


def test_falls_count_once_the_median_walks() -> None:
    landscape = Landscape()
    search = LinearSearch(INPUTS, 2, 8, seed=3, population=16, episodes=1, fall_reward=-100.0, walks_at=-3.0)
    while not search.falls_count:
        search.advance(landscape)
    search.advance(landscape)
    assert landscape.fall_values[0] == 0.0
    assert landscape.fall_values[-1] == -100.0


def test_a_checkpoint_continues_bit_for_bit() -> None:
    whole = LinearSearch(INPUTS, 2, 8, seed=5, population=16)
    for _ in range(6):
        whole.advance(Landscape())
    first = LinearSearch(INPUTS, 2, 8, seed=5, population=16)
    for _ in range(3):
        first.advance(Landscape())
    second = LinearSearch(INPUTS, 2, 8, seed=99, population=16)
    second.restore(json.loads(json.dumps(first.to_data())))
    for _ in range(3):
        second.advance(Landscape())
    assert second.to_data() == whole.to_data()


@pytest.mark.parametrize(("key", "value"), [("mean", [1.0]), ("variance", [0.0] * 8), ("path", [math.inf] * 8)])
def test_a_damaged_checkpoint_is_refused(key: str, value: list[float]) -> None:
    search = LinearSearch(INPUTS, 2, 8, seed=5, population=16)
    with pytest.raises(BitneatError, match="expected 8 finite numbers"):
        search.restore({**search.to_data(), key: value})
