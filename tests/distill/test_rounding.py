# SPDX-License-Identifier: MIT
"""Rows of integers against the best that there are, and against rounding each weight by itself."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from bitneat.distill.rounding import Reals, RoundedRow, round_row


def samples(rng: np.random.Generator, size: int) -> Reals:
    """Inputs that are correlated and far from 0, and a column of ones: (500, size)."""
    common = rng.normal(size=(500, 2))
    inputs = 1.5 + common @ rng.normal(size=(2, size - 1)) + 0.2 * rng.normal(size=(500, size - 1))
    return np.concatenate((inputs, np.ones((500, 1))), axis=1)


def error(integers: Reals, exponent: int, target: Reals, gram: Reals) -> float:
    difference = integers * 2.0**exponent - target
    return float(difference @ gram @ difference)


def keeps_its_promises(found: RoundedRow, target: Reals, gram: Reals, planes: int) -> bool:
    integers = np.abs(found.integers)
    allowed = 1 | int(np.bitwise_or.reduce(integers[:-1]))
    return (
        integers.max() < 1 << planes
        and not integers[-1] & ~allowed
        and found.error == pytest.approx(error(found.integers, found.exponent, target, gram))
    )


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("planes", [1, 2])
def test_few_weights_are_rounded_as_well_as_can_be(planes: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = samples(rng, 5)
    target, gram = rng.normal(0.0, 0.5, 5), columns.T @ columns / 500
    found = round_row(target, gram, planes, rng)
    assert keeps_its_promises(found, target, gram, planes)
    largest = (1 << planes) - 1
    best = min(
        error(np.array(integers), exponent, target, gram)
        for integers in product(range(-largest, largest + 1), repeat=5)
        if not abs(integers[-1]) & ~(1 | int(np.bitwise_or.reduce(np.abs(integers[:-1]))))
        for exponent in range(-5, 2)
    )
    assert found.error == pytest.approx(best)


@pytest.mark.parametrize("seed", range(4))
def test_sums_of_many_weights_change_much_less_than_by_rounding_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = samples(rng, 25)
    target, gram = rng.normal(0.0, 0.3, 25), columns.T @ columns / 500
    found = round_row(target, gram, 3, rng)
    assert keeps_its_promises(found, target, gram, 3)
    alone = min(
        error(np.clip(np.round(target / 2.0**exponent), -7, 7), exponent, target, gram) for exponent in range(-7, 3)
    )
    assert found.error < 0.2 * alone


def test_a_bias_has_no_plane_that_no_weight_has() -> None:
    target, gram = np.array([0.02, -0.02, 0.02, 3.0]), np.eye(4)  # so that no weight makes good what the bias lacks
    found = round_row(target, gram, 3, np.random.default_rng(0))
    assert keeps_its_promises(found, target, gram, 3)
    assert found.integers[-1] > 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("unit", [1e-14, 1e8])
def test_the_unit_of_the_inputs_does_not_matter(unit: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = samples(rng, 40)
    target, gram = rng.normal(0.0, 0.3, 40), columns.T @ columns / 500
    found, other = (round_row(target, factor * gram, 2, np.random.default_rng(0)) for factor in (1.0, unit))
    assert found.exponent == other.exponent
    assert np.array_equal(found.integers, other.integers)
