# SPDX-License-Identifier: MIT
"""Streams of randomness, and the ranges of episode seeds."""

from __future__ import annotations

import json
import random

import pytest

from bitneat.evolve.randomness import (
    REPORT_START,
    SEED_END,
    SELECTION_START,
    Streams,
    report_seeds,
    selection_seeds,
)


def test_search_selection_and_report_seeds_never_meet() -> None:
    assert SELECTION_START == 2**30
    assert REPORT_START == 2**30 + 2**28
    streams = Streams(5)
    for _ in range(200):
        assert all(0 <= seed < SELECTION_START for seed in streams.search_seeds(50))
    assert all(SELECTION_START <= seed < REPORT_START for seed in selection_seeds(100_000))
    assert all(REPORT_START <= seed < SEED_END for seed in report_seeds(100_000))
    with pytest.raises(ValueError, match="do not fit"):
        selection_seeds(2**28 + 1)


def test_each_generation_has_new_seeds_and_no_repeats_within() -> None:
    streams = Streams(1)
    first, second = streams.search_seeds(100), streams.search_seeds(100)
    assert len(set(first)) == len(set(second)) == 100
    assert first != second


def test_the_global_generator_is_left_as_it_was() -> None:
    random.seed(9)
    expected = random.random()
    random.seed(9)
    streams = Streams(1)
    with streams.neat():
        random.random()
        with streams.aside():
            random.seed(77)
    assert random.random() == expected


def test_foreign_draws_do_not_move_the_stream() -> None:
    plain, disturbed = Streams(1), Streams(1)
    with plain.neat():
        expected = [random.random(), random.random()]
    with disturbed.neat():
        found = [random.random()]
        with disturbed.aside():
            random.random()
        found.append(random.random())
    assert found == expected


def test_a_saved_state_continues_every_stream() -> None:
    streams = Streams(3)
    with streams.neat():
        random.gauss(0, 1)
    streams.search_seeds(3)
    saved = json.loads(json.dumps(streams.to_data()))
    other = Streams(99)
    other.restore(saved)

    def draw(from_: Streams) -> list[float]:
        with from_.neat():
            drawn = [random.random(), random.gauss(0, 1)]
        return [*drawn, *from_.search_seeds(4), from_.pressure()]

    assert draw(streams) == draw(other)


def test_streams_of_one_seed_are_independent_of_each_other() -> None:
    first, second = Streams(4), Streams(4)
    second.pressure()
    with second.neat():
        random.random()
    assert first.search_seeds(10) == second.search_seeds(10)
