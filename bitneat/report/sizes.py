# SPDX-License-Identifier: MIT
"""The figure of a controller's size: its packed bits by field, and what its C takes on each target."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bitneat.report import figure
from bitneat.report.figure import BLUE, GREEN, GREY, ORANGE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bitneat.verify.size import CompiledSize, PackedBits, SizeReport

_FIELDS = (
    ("header", "header", GREY),
    ("topology", "topology", BLUE),
    ("weights", "weights", ORANGE),
    ("fields", "activations, gains, biases", GREEN),
)
_MEMORIES = (("flash", BLUE), ("RAM", VERMILION), ("stack", SKY))


def size_figure(report: SizeReport, name: str, file_type: str) -> bytes:
    """The figure as SVG or PNG.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    with figure.settings():
        from matplotlib.figure import Figure

        rows = [len(report.packed), 1.4 * len(report.compiled)]
        page = Figure(figsize=(7.0, 1.5 + 0.28 * sum(rows)), layout="constrained")
        upper, lower = page.subplots(2, 1, height_ratios=[rows[0] + 1.0, rows[1] + 1.0])
        _draw_packed(upper, report.packed)
        _draw_compiled(lower, report.compiled)
        upper.set_title(f"{name}: {report.packed[0].num_bytes} bytes packed, as {report.packed[0].encoding}")
        compilers = sorted({entry.report.compiler for entry in report.compiled})
        description = f"sha256 {report.controller.sha256}; {', '.join(compilers)}"
        return figure.render(page, file_type, f"bitneat: the size of {name}", description)


def _draw_packed(axes: Axes, packed: tuple[PackedBits, ...]) -> None:
    """A bar for each encoding, its parts end to end."""
    for row, bits in enumerate(packed):
        left = 0.0
        for field, label, colour in _FIELDS:
            width = getattr(bits, field) / 8
            axes.barh(row, width, 0.7, left=left, color=colour, label=label if row == 0 else None)
            left += width
        axes.text(left, row, f" {bits.num_bytes}", verticalalignment="center", fontsize=8)
    axes.set_yticks(range(len(packed)), [bits.encoding for bits in packed])
    axes.set_ylim(len(packed) - 0.5, -0.5)
    axes.set_xlabel("bytes, by encoding of the packed form")
    axes.margins(x=0.08)
    axes.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.12), ncols=len(_FIELDS), borderaxespad=0.0)


def _draw_compiled(axes: Axes, compiled: tuple[CompiledSize, ...]) -> None:
    """Three bars for each target and style."""
    height = 0.8 / len(_MEMORIES)
    for row, entry in enumerate(compiled):
        examination = entry.report.examination
        values = (examination.flash, examination.ram, entry.report.stack)
        for place, ((label, colour), value) in enumerate(zip(_MEMORIES, values, strict=True)):
            y = row + (place - 1) * height
            axes.barh(y, value or 0, height * 0.9, color=colour, label=label if row == 0 else None)
            text = "?" if value is None else str(value)
            axes.text(value or 0, y, f" {text}", verticalalignment="center", fontsize=6.5)
    axes.set_yticks(range(len(compiled)), [_row_name(entry) for entry in compiled])
    axes.set_ylim(len(compiled) - 0.5, -0.5)
    axes.set_xlabel("bytes, compiled; “?” where it cannot be known")
    axes.margins(x=0.08)
    axes.legend(frameon=False, loc="best")


def _row_name(entry: CompiledSize) -> str:
    from bitneat.verify.size import device_of

    return f"{device_of(entry)}, {entry.report.style}"
