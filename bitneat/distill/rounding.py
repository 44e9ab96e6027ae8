# SPDX-License-Identifier: MIT
"""Rounding of a node's weights to integers, each so that it makes good what the others do.

Rounding each weight by itself keeps the weights; what should be kept are the sums. With inputs that are correlated and whose means
are far from 0, as distances measured by a lidar are, errors of weights add up in every sum alike. So weights are rounded one after
the other, each error is passed on to those that are still real (optimal brain surgeon: Hassibi and Stork 1993; for quantization
Frantar and Alistarh 2022), and then one or two integers are changed as long as that makes the error of the sum smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bitneat.controller.ir import GAIN_RANGE

Reals = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_ORDERS = 16
"""So many orders of rounding are tried for each row: what comes first is rounded worst."""


@dataclass(frozen=True)
class RoundedRow:
    """A node's weights and, last, its bias: ``integers * 2**exponent``."""

    integers: Integers
    exponent: int
    error: float
    """``d @ gram @ d`` of the difference to the target."""


def round_row(target: Reals, gram: Reals, planes: int, rng: np.random.Generator) -> RoundedRow:
    """Find integers of at most ``2**planes - 1`` and a power of two that make a small error of the sum.

    A plane of the bias needs a weight that has the plane, too (`Student.controller`), but for the lowest.

    Args:
        target: (n,) real weights and, last, the bias.
        gram: (n, n), mean products of the inputs, of which the last is 1.
        planes: p.
        rng: for the orders.
    """
    size = len(target)
    finest = math.log2(max(float(np.abs(target[:-1]).max()), 1e-9) / ((1 << planes) - 1))
    best: RoundedRow | None = None
    for possible in sorted(
        {min(max(math.floor(finest) + more, GAIN_RANGE[0]), GAIN_RANGE[1]) for more in range(-1, 3)}
    ):
        row = _Row(target, gram, (1 << planes) - 1, 2.0**possible)
        for attempt in range(_ORDERS):
            order = rng.permutation(size) if attempt else np.argsort(-np.diag(gram), kind="stable")
            integers = row.passed_on(order)
            row.descend(integers)
            row.fit_bias(integers)
            error = row.error(integers)
            if best is None or error < best.error:
                best = RoundedRow(integers, possible, error)
    assert best is not None
    return best


@dataclass(frozen=True)
class _Row:
    """What integers times ``scale`` should come near to."""

    target: Reals
    gram: Reals
    largest: int
    scale: float

    def error(self, integers: Integers) -> float:
        difference = integers * self.scale - self.target
        return float(difference @ self.gram @ difference)

    def passed_on(self, order: Integers) -> Integers:
        """Round in an order, each error passed on to those that come later."""
        size = len(self.target)
        damped = self.gram + 1e-6 * np.trace(self.gram) / size * np.eye(size)
        # Upper triangular; its row i says how those after i make good an error of i.
        factor = np.linalg.cholesky(np.linalg.inv(damped[np.ix_(order, order)])).T
        left = self.target[order].copy()
        integers = np.zeros(size, dtype=np.int64)
        for i, place in enumerate(order):
            integers[place] = int(np.clip(np.round(left[i] / self.scale), -self.largest, self.largest))
            left[i:] -= (left[i] - integers[place] * self.scale) / factor[i, i] * factor[i, i:]
        return integers

    def descend(self, integers: Integers) -> None:
        """Change one or two integers by one, those that lessen the error most, as long as that does."""
        places = np.tile(np.arange(len(integers)), 2)
        signs = np.repeat([1, -1], len(integers))
        both = 2 * self.scale**2 * self.gram[np.ix_(places, places)] * np.outer(signs, signs)
        both[places[:, None] == places] = np.inf
        slope = self.gram @ (integers * self.scale - self.target)
        # Below it, rounding might make the changes go in circles.
        least = 1e-9 * self.scale**2 * float(np.trace(self.gram))
        while True:
            alone = 2 * slope[places] * signs * self.scale + np.diag(self.gram)[places] * self.scale**2
            alone[np.abs(integers[places] + signs) > self.largest] = np.inf
            pairs = alone[:, None] + alone + both
            one, pair = int(alone.argmin()), divmod(int(pairs.argmin()), len(places))
            moves = [one] if alone[one] <= pairs[pair] else list(pair)
            if min(alone[one], pairs[pair]) > -least:
                return
            for move in moves:
                integers[places[move]] += signs[move]
                slope += self.gram[:, places[move]] * signs[move] * self.scale

    def fit_bias(self, integers: Integers) -> None:
        """Take the best bias of those that the weights' planes allow."""
        planes = 1 | int(np.bitwise_or.reduce(np.abs(integers[:-1])))
        allowed = np.array([k for k in range(-self.largest, self.largest + 1) if not abs(k) & ~planes], dtype=np.int64)
        slope = float(self.gram[-1] @ (integers * self.scale - self.target))
        steps = (allowed - integers[-1]) * self.scale
        integers[-1] = allowed[int(np.argmin(2 * slope * steps + self.gram[-1, -1] * steps**2))]
