# SPDX-License-Identifier: MIT
"""What a benchmark gives back, and the repetition that all of them share."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Measurement:
    """One line of the table: two medians of the same run, and the figure that a goal is set for.

    ``ours`` and ``baseline`` are in ``unit``; ``figure`` is what ``goal`` speaks of. ``met`` is None where there is no goal.
    """

    what: str
    ours: float
    compared_with: str
    baseline: float
    unit: str
    figure: float
    figure_means: str
    goal: str
    met: bool | None

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Pair:
    """Medians over repetitions; ``ratio`` is the median of the ratios, each of neighbours in time."""

    ours: float
    baseline: float
    ratio: float


def side_by_side(ours: Callable[[], float], baseline: Callable[[], float], repetitions: int) -> Pair:
    """Measure both in turns, so that what slows the machine for a while slows both.

    Each function does its work once and returns what it cost; ``ratio`` is baseline / ours. A first turn of each, which
    compiles and loads, does not count.
    """
    ours()
    baseline()
    ours_costs, baseline_costs = [], []
    for _ in range(repetitions):
        ours_costs.append(ours())
        baseline_costs.append(baseline())
    ratios = [other / own for own, other in zip(ours_costs, baseline_costs, strict=True)]
    return Pair(statistics.median(ours_costs), statistics.median(baseline_costs), statistics.median(ratios))


def seconds_of(work: Callable[[], object]) -> float:
    """Do ``work`` and return how long it took."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
