# SPDX-License-Identifier: MIT
"""``bn_open`` and ``bn_validate`` take any bytes: what they accept runs under the sanitizers, and Python reads it the same."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.fuzz.agreement import build, compare, mutated, valid_blobs


@pytest.fixture(scope="module")
def checker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("validate"))


def test_every_blob_that_is_packed_is_valid(checker: Path) -> None:
    blobs = valid_blobs(range(200))
    assert compare(checker, blobs) == len(blobs)


def test_changed_blobs_are_judged_alike_and_what_is_accepted_runs(checker: Path, budget: int) -> None:
    rng = random.Random(20)
    blobs = valid_blobs(range(100))
    changed = [mutated(rng.choice(blobs), rng) for _ in range(4000 * budget)]
    count = compare(checker, changed)
    assert 0 < count < len(changed)


def test_noise_is_judged_alike(checker: Path, budget: int) -> None:
    rng = random.Random(21)
    noise = [bytes([rng.randrange(5) << 3 | 1]) + rng.randbytes(rng.randint(0, 40)) for _ in range(4000 * budget)]
    compare(checker, noise)
