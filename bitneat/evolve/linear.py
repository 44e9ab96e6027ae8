# SPDX-License-Identifier: MIT
"""Linear policies by evolution strategy, in the controller's own integers, as a start for `bitneat.evolve.polish`.

A linear policy has one weight for each input and output and a constant. Its landscape is smooth, so that an evolution strategy
learns to walk where topology search still falls; and rounded to a multiple of 2^-r it is a controller: each weight is a sum of few
signed powers of two, and all links of one power into one output are a node of ternary weights, whose gain is the power.

The strategy is CMA-ES with a diagonal covariance (Ros and Hansen 2008, "A simple modification in CMA-ES achieving linear time and
space complexity"; the constants are those of Hansen's tutorial, the learning rates of the covariance times (n + 2) / 3). It
computes element by element, in an order of its own and not of a library for matrices, whose order depends on the processor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.digits import halved, signed_powers
from bitneat.controller.ir import ACCUMULATOR_MAX, GAIN_RANGE
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.randomness import SELECTION_START
from bitneat.sim.environment import Shaping

Floats = npt.NDArray[np.float64]

RESOLUTION = 4
"""The search rounds weights to multiples of 2^-4."""
_LARGEST = 8.0
"""Weights beyond are cut off."""
_FIRST_STEP = 0.3


@dataclass(frozen=True)
class LinearRow:
    """What a generation came to."""

    generation: int
    best: float
    median: float
    step_size: float
    episodes: int
    steps: int


class LinearSearch:
    """The state of the strategy.

    Args:
        inputs: of the controllers.
        num_outputs: of the controllers.
        frac_bits: F of the controllers.
        seed: of all randomness.
        population: policies in a generation.
        episodes: on the same seeds for each of them, new ones in every generation.
        fall_reward: the reward of a last step that is a fall; NaN if there is none. A fall costs nothing until the median of a
            generation exceeds ``walks_at``, since before that standing still would be best.
        walks_at: see ``fall_reward``.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        num_outputs: int,
        frac_bits: int,
        seed: int,
        *,
        population: int = 64,
        episodes: int = 4,
        fall_reward: float = math.nan,
        walks_at: float = math.inf,
    ) -> None:
        self.inputs = tuple(inputs)
        self.num_outputs = num_outputs
        self.frac_bits = frac_bits
        self.generation = 0
        self.falls_count = False
        self._fall_reward, self._walks_at = fall_reward, walks_at
        self._episodes = episodes
        self._random = np.random.Generator(np.random.PCG64(np.random.SeedSequence([0x11EA, seed])))
        size = num_outputs * (len(self.inputs) + 1)
        self._mean, self._path, self._step_path = np.zeros(size), np.zeros(size), np.zeros(size)
        self._variance = np.ones(size)
        self._step = _FIRST_STEP
        self._constants = _Constants(size, population)

    def advance(self, evaluator: Evaluator) -> LinearRow:
        """Run one generation."""
        k = self._constants
        deviation = np.sqrt(self._variance)
        steps = self._random.standard_normal((k.population, self._mean.size)) * deviation
        seeds = [int(s) for s in self._random.choice(SELECTION_START, self._episodes, replace=False)]
        controllers = [self.shifted(self._mean + self._step * step) for step in steps]
        results = evaluator.evaluate(controllers, seeds, self._shaping())
        scores = [math.fsum(e.shaped for e in row) / len(row) for row in results]
        order = sorted(range(k.population), key=lambda i: -scores[i])
        self._learn(steps[order[: k.parents]], deviation)
        median = scores[order[k.population // 2]]
        self.falls_count = self.falls_count or median > self._walks_at
        self.generation += 1
        return LinearRow(
            self.generation,
            scores[order[0]],
            median,
            self._step,
            k.population * len(seeds),
            sum(e.steps for row in results for e in row),
        )

    def _learn(self, best: Floats, deviation: Floats) -> None:
        k = self._constants
        mean_step = _weighted(k.weights, best)
        self._mean = self._mean + self._step * mean_step
        pull = math.sqrt(k.step_rate * (2 - k.step_rate) * k.parents_effective)
        self._step_path = (1 - k.step_rate) * self._step_path + pull * mean_step / deviation
        length = math.sqrt(math.fsum(float(v) ** 2 for v in self._step_path))
        expected = math.sqrt(1 - (1 - k.step_rate) ** (2 * (self.generation + 1)))
        grows = 1.0 if length / expected < (1.4 + 2 / (self._mean.size + 1)) * k.normal_length else 0.0
        pull = math.sqrt(k.path_rate * (2 - k.path_rate) * k.parents_effective)
        self._path = (1 - k.path_rate) * self._path + grows * pull * mean_step
        self._variance = (
            (1 - k.rank_one - k.rank_many) * self._variance
            + k.rank_one * self._path * self._path
            + k.rank_many * _weighted(k.weights, best * best)
        )
        self._step *= math.exp(k.step_rate / k.damping * (length / k.normal_length - 1))

    def _shaping(self) -> Shaping:
        return Shaping(fall_reward=self._fall_reward, fall_value=self._fall_reward if self.falls_count else 0.0)

    def shifted(self, weights: Floats | None = None, resolution: int = RESOLUTION) -> Controller:
        """The policy (the mean of the search if not given) with a link for each signed power of two of a weight; not ternary.

        Weights of so many inputs that their sum could go beyond the accumulator are halved, toward zero, until it cannot.
        """
        nodes = []
        for row in self._rounded(weights, resolution):
            *numbers, constant = (int(weight) for weight in row)
            links = _shifts(numbers)
            while self._total(links) + (abs(constant) << self.frac_bits) > ACCUMULATOR_MAX:
                numbers, constant = [halved(weight) for weight in numbers], halved(constant)
                links = _shifts(numbers)
            nodes.append(Node(tuple(sorted(links)), constant << self.frac_bits, -resolution, "clamped"))
        first = len(self.inputs)
        outputs = tuple(Signal(first + i) for i in range(self.num_outputs))
        return Controller(self.inputs, tuple(nodes), outputs, self.frac_bits)

    def ternary(self, resolution: int) -> Controller:
        """The mean of the search as a ternary controller: for each output a node for each power of two, and their sum.

        The constant is rounded to -1, 0 or 1. A gain that could carry a sum beyond the accumulator is lowered.
        """
        planes: list[Node] = []
        sums = []
        first = len(self.inputs)
        for row in self._rounded(None, resolution):
            powers: dict[int, list[Link]] = {}
            for i, weight in enumerate(row[:-1]):
                for k, sign in signed_powers(int(weight)):
                    powers.setdefault(k, []).append(Link(i, 0, 0, sign))
            links = []
            for k in sorted(powers):
                links.append(Link(first + len(planes), 0, 0, 1))
                gain = min(max(k - resolution, GAIN_RANGE[0]), GAIN_RANGE[1])
                while gain > 0 and self._total(powers[k]) << gain > ACCUMULATOR_MAX:
                    gain -= 1
                planes.append(Node(tuple(sorted(powers[k])), 0, gain, "identity"))
            bias = min(max(round(int(row[-1]) / (1 << resolution)), -1), 1)
            sums.append(Node(tuple(links), bias << self.frac_bits, 0, "clamped"))
        outputs = tuple(Signal(first + len(planes) + i) for i in range(self.num_outputs))
        return Controller(self.inputs, (*planes, *sums), outputs, self.frac_bits).canonical

    def _total(self, links: Sequence[Link]) -> int:
        """The largest magnitude that a sum of links from inputs can have."""
        return sum(self.inputs[link.source].limit << link.shift for link in links)

    def _rounded(self, weights: Floats | None, resolution: int) -> npt.NDArray[np.int64]:
        chosen = self._mean if weights is None else weights
        largest = _LARGEST * (1 << resolution)
        units = np.clip(np.rint(chosen * (1 << resolution)), -largest, largest)
        return units.astype(np.int64).reshape(self.num_outputs, len(self.inputs) + 1)

    def to_data(self) -> dict[str, Any]:
        """Everything a checkpoint needs, as plain data."""
        state = self._random.bit_generator.state
        return {
            "generation": self.generation,
            "falls_count": self.falls_count,
            "random": [state["state"]["state"], state["state"]["inc"], state["has_uint32"], state["uinteger"]],
            "mean": self._mean.tolist(),
            "variance": self._variance.tolist(),
            "path": self._path.tolist(),
            "step_path": self._step_path.tolist(),
            "step": self._step,
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue where `to_data` was taken.

        Raises:
            BitneatError: if an array has a wrong length or holds what is no number. Whatever else is wrong raises whatever it may.
        """
        arrays = [np.array(data[name], np.float64) for name in ("mean", "variance", "path", "step_path")]
        if any(a.shape != self._mean.shape or not np.isfinite(a).all() for a in arrays) or (arrays[1] <= 0).any():
            raise BitneatError(f"linear search: expected {self._mean.size} finite numbers in each array")
        state, increment, has_uint32, uinteger = map(int, data["random"])
        self._random.bit_generator.state = {
            "bit_generator": "PCG64",
            "state": {"state": state, "inc": increment},
            "has_uint32": has_uint32,
            "uinteger": uinteger,
        }
        self._mean, self._variance, self._path, self._step_path = arrays
        self._step = float(data["step"])
        self.generation, self.falls_count = int(data["generation"]), bool(data["falls_count"])


class _Constants:
    """Of the strategy, for a number of variables and a population; in the notation of Hansen's tutorial on the right."""

    def __init__(self, variables: int, population: int) -> None:
        n = variables
        self.population = population  # lambda
        self.parents = population // 2  # mu
        raw = [math.log(self.parents + 0.5) - math.log(i) for i in range(1, self.parents + 1)]
        self.weights = [w / math.fsum(raw) for w in raw]
        self.parents_effective = 1 / math.fsum(w * w for w in self.weights)  # mu_eff
        m = self.parents_effective
        self.step_rate = (m + 2) / (n + m + 5)  # c_sigma
        self.damping = 1 + self.step_rate + 2 * max(0.0, math.sqrt((m - 1) / (n + 1)) - 1)  # d_sigma
        self.path_rate = (4 + m / n) / (n + 4 + 2 * m / n)  # c_c
        faster = (n + 2) / 3
        self.rank_one = faster * 2 / ((n + 1.3) ** 2 + m)  # c_1
        self.rank_many = min(1 - self.rank_one, faster * 2 * (m - 2 + 1 / m) / ((n + 2) ** 2 + m))  # c_mu
        self.normal_length = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))


def _shifts(weights: Sequence[int]) -> list[Link]:
    """A link for each signed power of two of the weight of each input."""
    return [Link(i, 0, k, sign) for i, weight in enumerate(weights) for k, sign in signed_powers(weight)]


def _weighted(weights: Sequence[float], rows: Floats) -> Floats:
    """The weighted sum of rows, one after the other: a matrix product's order would be the library's."""
    total = np.zeros(rows.shape[1])
    for weight, row in zip(weights, rows, strict=True):
        total = total + weight * row
    return total
