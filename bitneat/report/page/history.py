# SPDX-License-Identifier: MIT
"""What a run's folder tells of its course: the rows of history.csv, and the controllers whose reward and size are known."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bitneat.champion import Champion
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.files import read_capped
from bitneat.report.page.charts import Chart, Point, Series, lines, scatter
from bitneat.state import unseal

MAX_FILE_BYTES = 64 * 1024 * 1024
LARGEST = 1e15
"""Numbers beyond it are shown as none: an axis could not count them."""
MAX_ROWS = 100_000
MAX_DRAWN = 1_500
"""Rows of a history that the charts have."""


@dataclass(frozen=True)
class History:
    """The columns of history.csv by name, and the controllers of the run.

    A missing value is NaN. ``points`` have packed bytes and a mean reward.
    """

    columns: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    points: tuple[Point, ...] = ()


def read_history(folder: Path) -> History:
    """Read the folder of ``evolve`` or ``polish``; what it lacks is left out.

    Raises:
        BitneatError: if a file that is there cannot be read as what it should be.
    """
    columns = _columns(folder / "history.csv") if (folder / "history.csv").exists() else {}
    points: list[Point] = []
    if (folder / "front.csv").exists():
        table = _columns(folder / "front.csv")
        sizes, means = table.get("packed_bytes", ()), table.get("mean", ())
        points = [Point(f"{size:.0f} bytes", size, mean) for size, mean in zip(sizes, means, strict=False)]
    checkpoints = sorted((folder / "checkpoints").glob("generation-*.json"))
    if checkpoints:
        points += _candidates(checkpoints[-1])
    return History(columns, tuple(points))


def _columns(path: Path) -> dict[str, tuple[float, ...]]:
    text = read_capped(path, MAX_FILE_BYTES, regular=True).decode("utf-8", "replace")
    try:
        rows = list(csv.reader(io.StringIO(text)))[: MAX_ROWS + 1]
    except csv.Error as error:
        raise BitneatError(f"{path}: damaged: {error}") from None
    if not rows or not rows[0]:
        raise BitneatError(f"{path}: expected a table with a line of names")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(rows[0]):
            raise BitneatError(f"{path}: line {number}: expected {len(rows[0])} columns, got {len(row)}")
    return {name: tuple(_value(row[i]) for row in rows[1:]) for i, name in enumerate(rows[0])}


def _value(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if abs(value) <= LARGEST else math.nan


def _candidates(path: Path) -> list[Point]:
    """The candidates of a checkpoint of evolve: controllers, with their rewards on the selection seeds."""
    try:
        data = unseal(read_capped(path, MAX_FILE_BYTES, regular=True), str(path), required=False)
        candidates: Sequence[Any] = data["search"]["candidates"]
        found = []
        for entry in candidates:
            if "controller" in entry:
                size = len(pack(Controller.from_data(entry["controller"])))
                rewards = [float(reward) for reward in entry["rewards"]]
                found.append(Point(f"generation {int(entry['generation'])}", size, statistics.fmean(rewards)))
    except (KeyError, TypeError, ValueError, ArithmeticError, RecursionError, AttributeError) as error:
        raise BitneatError(f"{path}: damaged: {type(error).__name__}") from None
    return found


def history_charts(history: History) -> list[Chart]:
    """Reward and size over the generations, as far as the run has them."""
    columns = _thinned(history.columns)
    xs = columns.get("generation", ())
    if not xs or not all(math.isfinite(x) for x in xs):
        return []
    rewards = [("best", "best of the generation", 1), ("selection", "champion so far, selection seeds", 2)]
    rewards += [("smallest_mean", "smallest above the floor", 3), ("mean", "mean of all", 3)]
    sizes = [
        ("best_links", "links of the best", 1),
        ("mean_links", "mean links", 3),
        ("best_nodes", "nodes of the best", 2),
    ]
    sizes += [("best_bytes", "bytes of the best", 1), ("smallest", "smallest above the floor, bytes", 2)]
    charts = [
        lines(key, title, ("generation", label), xs, [Series(n, columns[c], tone) for c, n, tone in of if c in columns])
        for key, title, label, of in (
            ("fitness", "Reward over generations", "reward", rewards),
            ("size", "Size over generations", "size", sizes),
        )
    ]
    return [chart for chart in charts if chart is not None]


def _thinned(columns: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
    """At most `MAX_DRAWN` rows, evenly chosen: more do not show, and make the page large."""
    count = max((len(values) for values in columns.values()), default=0)
    stride = max(-(-count // MAX_DRAWN), 1)
    return {name: values[::stride] for name, values in columns.items()}


def pareto_chart(history: History, champion: Champion, others: Sequence[tuple[str, Champion]]) -> Chart | None:
    """Mean reward against packed bytes: the run's controllers, this champion, others to compare it with."""
    points = list(history.points)
    for name, one, strong in [("this champion", champion, True), *((name, other, False) for name, other in others)]:
        mean = score(one, "held_out") or score(one, "selection")
        if mean is not None:
            points.append(Point(name, len(pack(one.controller.canonical)), mean, strong, named=True))
    return scatter("pareto", "Reward against packed bytes", ("bytes", "mean reward"), points)


def score(champion: Champion, which: str) -> float | None:
    """The mean of ``held_out`` or ``selection`` in a champion's provenance, if it is there and a number."""
    entry = champion.provenance.get(which)
    mean = entry.get("mean") if isinstance(entry, Mapping) else None
    if not isinstance(mean, int | float) or isinstance(mean, bool) or not abs(mean) <= LARGEST:
        return None
    return float(mean)
