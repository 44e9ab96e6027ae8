# SPDX-License-Identifier: MIT
"""What `run_episodes` takes and refuses, and that no failure passes for a result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bitneat.errors import BitneatError
from bitneat.sim.walker import episodes, run_episodes
from bitneat.sim.walker.binding import lane_width
from tests.sim.walkers import champion


def test_arrays_and_numpys_numbers_are_as_good_as_pythons() -> None:
    expected = run_episodes([champion()], [3, 4], 20)
    limit: Any = np.int64(20)
    seeds: Any = np.array([3, 4])
    found = run_episodes([champion()], seeds, limit, threads=np.int64(2))  # type: ignore[arg-type]
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    assert run_episodes([champion()], seeds[:0], limit)[0].shape == (1, 0)


def test_seeds_of_any_size_differ() -> None:
    rewards, _ = run_episodes([champion()], [1, 2**64 + 1, 2**200 + 1], 20)
    assert len(set(rewards[0])) == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seeds": [-1]}, "seed: expected a whole number of at least 0, got -1"),
        ({"seeds": [1.5]}, r"seed: .* got 1\.5"),
        ({"seeds": [None]}, "seed: .* got None"),
        ({"max_steps": 0}, "max_steps: expected a whole number from 1 to 2147483647, got 0"),
        ({"max_steps": 2**31}, "max_steps: .* got 2147483648"),
        ({"max_steps": 20.0}, r"max_steps: .* got 20\.0"),
        ({"threads": 0}, "threads: expected a whole number from 1 to 256, got 0"),
        ({"threads": 1.5}, r"threads: .* got 1\.5"),
        ({"lanes": 3}, "lanes: expected one of 1, 4, 8, 16, got 3"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        run_episodes([champion()], **{"seeds": [1], "max_steps": 20, **arguments})


def test_what_goes_wrong_in_the_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def simulator_run(self, *arguments: Any) -> bool:
            raise TypeError("an integer is required")

    widest = lane_width(None)
    monkeypatch.setattr(episodes, "library", Broken)
    with pytest.raises(TypeError, match="an integer is required"):
        run_episodes([champion()], [1], 20, lanes=widest)
