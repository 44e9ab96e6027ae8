# SPDX-License-Identifier: MIT
"""The figure of runs: how best, mean and selection score go over generations or simulated steps."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.files import read_capped
from bitneat.report import figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]

CURVES = ("best", "mean", "selection")
_WORDS = {
    "best": "best of the generation",
    "mean": "mean of the generation",
    "selection": "best so far, selection seeds",
}
_STYLES: Mapping[str, tuple[str, float]] = {"best": ("-", 1.0), "mean": (":", 1.2), "selection": ("-", 1.8)}
_HISTORY = "history.csv"
_MAX_BYTES = 1 << 25
_GRID = 400
"""Points on the axis of steps, where the generations of several runs do not fall together."""


@dataclass(frozen=True)
class History:
    """A run: a value a generation in each array."""

    label: str
    steps: FloatArray
    """Simulated until the end of each generation."""
    curves: Mapping[str, FloatArray]
    environment: EnvironmentSpec | None = None

    @property
    def generations(self) -> int:
        """How many."""
        return len(self.steps)


def read_history(path: Path, label: str) -> History:
    """Of a run folder of ``bitneat evolve``, or its history.csv.

    Raises:
        BitneatError: if there is no history, or a damaged one, or one of something else than a run of evolution.
    """
    file = path / _HISTORY if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise BitneatError(f"{path}: holds no {_HISTORY}; expected a run folder of bitneat evolve")
    text = read_capped(file, _MAX_BYTES).decode("utf-8", "replace")
    reader = csv.DictReader(io.StringIO(text))
    try:
        names = reader.fieldnames or ()
    except csv.Error as error:
        raise BitneatError(f"{file}: damaged: {error}") from None
    missing = [name for name in (*CURVES, "steps") if name not in names]
    if missing:
        raise BitneatError(f"{file}: expected a history of bitneat evolve; it has no column {missing[0]!r}")
    try:
        rows = [[float(row[name]) for name in (*CURVES, "steps")] for row in reader]
    except (TypeError, ValueError, csv.Error):
        raise BitneatError(f"{file}: damaged: expected a number in each column") from None
    if not rows:
        raise BitneatError(f"{file}: holds no generation yet")
    if not all(math.isfinite(value) for row in rows for value in row):
        raise BitneatError(f"{file}: damaged: a number is not finite")
    columns = np.array(rows).T
    return History(
        label, np.cumsum(columns[-1]), dict(zip(CURVES, columns[:-1], strict=True)), _environment(file.parent)
    )


def fitness_figure(
    histories: Sequence[History], curves: Sequence[str], by_steps: bool, references: Sequence[float], file_type: str
) -> bytes:
    """The figure as SVG or PNG: runs of one label together, their median and the band between the extremes.

    Args:
        histories: at least one.
        curves: some of `CURVES`.
        by_steps: whether the axis counts simulated steps instead of generations.
        references: rewards to draw a line at.
        file_type: ``svg`` or ``png``.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    groups: dict[str, list[History]] = {}
    for history in histories:
        groups.setdefault(history.label, []).append(history)
    with figure.settings():
        from matplotlib.figure import Figure

        page = Figure(figsize=(7.0, 4.6), layout="constrained")
        axes = page.add_subplot()
        for place, (label, runs) in enumerate(groups.items()):
            for number, curve in enumerate(curves):
                alone = len(groups) == 1
                colour = figure.CYCLE[(number if alone else place) % len(figure.CYCLE)]
                name = _name(label, runs, curve, alone, len(curves) > 1)
                _draw_curve(axes, runs, curve, by_steps, colour=colour, label=name)
        for reference in references:
            figure.reference_line(axes, reference)
        axes.set_xlabel("simulated steps, in millions" if by_steps else "generation")
        axes.set_ylabel("reward (median of runs, and extremes)" if len(groups) < len(histories) else "reward")
        axes.margins(x=0.01)
        axes.grid(visible=True)
        page.legend(frameon=False, loc="outside upper left", ncols=min(len(groups), 3))
        description = "; ".join(f"{label}: {len(runs)} runs" for label, runs in groups.items())
        return figure.render(page, file_type, "bitneat: reward over a search", description)


def pooled(runs: Sequence[History], curve: str, by_steps: bool) -> tuple[FloatArray, FloatArray]:
    """A place on the axis for each column, and a row a run, as far as the shortest goes."""
    if not by_steps:
        length = min(run.generations for run in runs)
        return np.arange(length, dtype=np.float64), np.array([run.curves[curve][:length] for run in runs])
    if len(runs) == 1:
        return runs[0].steps / 1e6, runs[0].curves[curve][np.newaxis]
    grid = np.linspace(max(run.steps[0] for run in runs), min(run.steps[-1] for run in runs), _GRID)
    return grid / 1e6, np.array([np.interp(grid, run.steps, run.curves[curve]) for run in runs])


def _draw_curve(axes: Axes, runs: Sequence[History], curve: str, by_steps: bool, *, colour: str, label: str) -> None:
    x, values = pooled(runs, curve, by_steps)
    style, width = _STYLES[curve]
    axes.plot(x, np.median(values, axis=0), color=colour, linestyle=style, linewidth=width, label=label)
    if len(runs) > 1:
        axes.fill_between(x, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.15, linewidth=0)


def _name(label: str, runs: Sequence[History], curve: str, alone: bool, several_curves: bool) -> str:
    """In the legend: the label where there are several, the curve where there are several."""
    count = f" ({len(runs)} runs)" if len(runs) > 1 else ""
    if alone:
        return f"{_WORDS[curve]}{count}"
    return f"{label}: {curve}{count}" if several_curves else f"{label}{count}"


def _environment(folder: Path) -> EnvironmentSpec | None:
    """What the run folder says, if it is one; whatever else may be in there is not complained of for a line in a figure."""
    from bitneat.evolve.run_folder import RunFolder

    try:
        return RunFolder(folder).settings().environment
    except BitneatError:
        return None
