# SPDX-License-Identifier: MIT
"""Where randomness comes from: named streams made from one seed, and the ranges of episode seeds.

neat-python draws from the global ``random``. `Streams.neat` is the one place where that generator is touched: it puts a
stream of ours under neat-python's calls and gives the caller's state back afterwards.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator
from typing import Any

SELECTION_START = 2**30
REPORT_START = SELECTION_START + 2**28
SEED_END = 2**31
"""Episode seeds: search < SELECTION_START <= selection < REPORT_START <= report < SEED_END."""

MAX_SEED = 1 << 1024
"""Seeds of a run's whole randomness are below it, so that its champion's file can hold them."""

_STREAMS = ("neat", "episodes", "pressure")


class Streams:
    """One generator for each purpose, so that drawing more for one changes none of the others."""

    def __init__(self, seed: int) -> None:
        self._streams = {name: random.Random(f"bitneat {seed} {name}") for name in _STREAMS}

    @contextlib.contextmanager
    def neat(self) -> Iterator[None]:
        """Put our stream under the global ``random`` for the duration."""
        outside = random.getstate()
        random.setstate(self._streams["neat"].getstate())
        try:
            yield
        finally:
            self._streams["neat"].setstate(random.getstate())
            random.setstate(outside)

    @contextlib.contextmanager
    def aside(self) -> Iterator[None]:
        """Within `neat`, run foreign code (an environment) that must not move the stream."""
        state = random.getstate()
        try:
            yield
        finally:
            random.setstate(state)

    def search_seeds(self, count: int) -> list[int]:
        """Different new episode seeds for a generation."""
        return self._streams["episodes"].sample(range(SELECTION_START), count)

    def pressure(self) -> float:
        """A number in [0, 1) that decides on size pressure."""
        return self._streams["pressure"].random()

    def to_data(self) -> dict[str, Any]:
        """The state of every stream as plain data."""
        return {name: _plain(stream.getstate()) for name, stream in self._streams.items()}

    def restore(self, data: dict[str, Any]) -> None:
        """Continue where `to_data` was taken."""
        for name, stream in self._streams.items():
            version, numbers, gauss = data[name]
            if gauss is not None and type(gauss) is not float:
                raise ValueError(f"streams: {name} has a wrong state")
            stream.setstate((version, tuple(numbers), gauss))


def selection_seeds(count: int) -> list[int]:
    """Episode seeds on which champions are chosen; the same in every run."""
    return _range(SELECTION_START, REPORT_START, count)


def report_seeds(count: int) -> list[int]:
    """Episode seeds on which a champion's score is reported; the same in every run, seen by no search."""
    return _range(REPORT_START, SEED_END, count)


def _range(start: int, end: int, count: int) -> list[int]:
    if start + count > end:
        raise ValueError(f"{count} episodes do not fit between seeds {start} and {end}")
    return list(range(start, start + count))


def _plain(state: tuple[Any, ...]) -> list[Any]:
    version, numbers, gauss = state
    return [version, list(numbers), gauss]
