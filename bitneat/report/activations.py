# SPDX-License-Identifier: MIT
"""The figure of the ten activations: the integer functions against neat-python's own, and how far they are apart."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bitneat.controller.activation import ACTIVATION_NAMES, PROGRAMS, real_function, table
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.report.figure import BLUE, GREY, ORANGE, VERMILION, render, settings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]

SHOWN = 3.0
"""The figure shows arguments z = -3..3; figures of error are over all 65,535 arguments."""
_COLUMNS = 3


@dataclass(frozen=True)
class Comparison:
    """One activation beside neat-python's, on real scales: arrays of 65,535 values."""

    name: str
    formula: str
    z: FloatArray
    integer: FloatArray
    real: FloatArray

    @property
    def error(self) -> FloatArray:
        """Integer function minus real function."""
        return self.integer - self.real

    @property
    def verdict(self) -> str:
        """The largest error in words."""
        error = np.abs(self.error)
        if not error.any():
            return "exact"
        if self.name == "sin":  # the phase drifts, so the range that matters has a figure of its own
            return f"|error| ≤ {_bound(error[np.abs(self.z) <= 4.0])} for |z| ≤ 4, {_bound(error)} to the clip"
        return f"|error| ≤ {_bound(error)}"


def compare(frac_bits: int) -> tuple[Comparison, ...]:
    """All activations at F = ``frac_bits`` beside neat-python's own functions."""
    z = np.arange(-SIGNAL_MAX, SIGNAL_MAX + 1) / (1 << frac_bits)
    return tuple(
        Comparison(name, PROGRAMS[name].formula, z, table(name, frac_bits) / (1 << frac_bits), real(z))
        for name, real in ((name, _real_function(name)) for name in ACTIVATION_NAMES)
    )


def activations_figure(frac_bits: int, file_type: str) -> bytes:
    """The figure as SVG or PNG.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    with settings():
        comparisons = compare(frac_bits)
        figure = _draw(comparisons, frac_bits)
        return render(figure, file_type, f"bitneat: activations at F = {frac_bits}", data_digest(comparisons))


def data_digest(comparisons: tuple[Comparison, ...]) -> str:
    """What the figure's metadata says of its data, by which a figure that is out of date is found."""
    digest = hashlib.sha256()
    for comparison in comparisons:
        digest.update(comparison.name.encode())
        digest.update(comparison.integer.astype("<f8").tobytes())
    return f"integer functions: sha256 {digest.hexdigest()}"


def _bound(error: FloatArray) -> str:
    """The largest of these, rounded up, so that it is a bound."""
    return f"{math.ceil(float(error.max()) * 1000) / 1000:.3f}"


def _real_function(name: str) -> Callable[[FloatArray], FloatArray]:
    from neat.activations import ActivationFunctionSet

    known = ActivationFunctionSet()
    if not known.is_valid(name):
        return partial(real_function, name)
    function = known.get(name)
    return lambda z: np.array([function(value) for value in z.tolist()])


def _draw(comparisons: tuple[Comparison, ...], frac_bits: int) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    rows = -(-(len(comparisons) + 1) // _COLUMNS)
    figure = Figure(figsize=(10.0, 2.9 * rows), layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08))
    panels = np.ravel(figure.subfigures(rows, _COLUMNS, squeeze=False))
    for panel, comparison in zip(panels, comparisons, strict=False):
        upper, lower = panel.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        _draw_functions(upper, comparison)
        _draw_error(lower, comparison)
    _draw_legend(panels[len(comparisons)], frac_bits)
    return figure


def _draw_functions(axes: Axes, comparison: Comparison) -> None:
    shown = np.abs(comparison.z) <= SHOWN
    z = comparison.z[shown]
    axes.plot(z, comparison.real[shown], color=ORANGE, linewidth=4.0, solid_capstyle="round")
    axes.plot(z, comparison.integer[shown], color=BLUE, linewidth=1.1)
    title = f"$\\bf{{{comparison.name}}}$   {comparison.formula.partition(' = ')[0]}"
    axes.set_title(title, parse_math=True)
    bounded = float(np.abs(comparison.integer).max()) <= 1.0
    bottom = -1.0 if float(comparison.integer.min()) < 0.0 else 0.0
    axes.set_ylim((bottom - 0.12, 1.12) if bounded else (bottom * SHOWN - 0.3, SHOWN + 0.3))
    axes.set_yticks(([-1, 0, 1] if bottom else [0, 1]) if bounded else ([-2, 0, 2] if bottom else [0, 2]))
    axes.grid(visible=True)


def _draw_error(axes: Axes, comparison: Comparison) -> None:
    shown = np.abs(comparison.z) <= SHOWN
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.plot(comparison.z[shown], comparison.error[shown], color=VERMILION, linewidth=0.8)
    axes.set_xlim(-SHOWN, SHOWN)
    axes.set_xticks(range(-3, 4))
    tick = max(0.02, math.ceil(float(np.abs(comparison.error).max()) * 40) / 50)
    axes.set_ylim(-1.25 * tick, 1.25 * tick)
    axes.set_yticks([-tick, 0.0, tick])
    axes.grid(visible=True)
    axes.set_xlabel(comparison.verdict, fontsize=8.5)


def _draw_legend(panel: object, frac_bits: int) -> None:
    from matplotlib.lines import Line2D

    axes = panel.subplots()  # type: ignore[attr-defined]
    axes.set_axis_off()
    axes.legend(
        handles=[
            Line2D([], [], color=ORANGE, linewidth=4.0, label="neat-python's function of z"),
            Line2D([], [], color=BLUE, linewidth=1.1, label=f"integer function, F = {frac_bits}"),
            Line2D([], [], color=VERMILION, linewidth=0.8, label="error: integer minus neat-python's"),
        ],
        loc="upper left",
        frameon=False,
        borderaxespad=0.0,
        fontsize=10,
    )
    axes.text(
        0.0,
        0.62,
        f"z = u / {1 << frac_bits} is shown from -3 to 3.\n"
        "Errors are in units of full scale (1.0);\nthe bounds hold for all 65,535 arguments.\n"
        "neat-python has no step.",
        transform=axes.transAxes,
        verticalalignment="top",
        linespacing=1.5,
    )
