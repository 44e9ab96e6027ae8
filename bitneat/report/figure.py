# SPDX-License-Identifier: MIT
"""Figures whose bytes depend on what they show and the version of Matplotlib, not on the day, the machine or its settings."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from bitneat.errors import BitneatError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = ("svg", "png")

# From Okabe and Ito's palette, which all common kinds of colour vision tell apart; lines differ in width, too.
BLUE = "#0072B2"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
GREY = "#666666"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, "#000000")
"""For one thing after the other."""


def require_matplotlib() -> None:
    """Notice before the work that it could not be drawn.

    Raises:
        MissingExtraError: if Matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise MissingExtraError("plot: Matplotlib is not installed; pip install 'bitneat[plot]'") from None


@contextmanager
def settings() -> Iterator[None]:
    """Matplotlib's own defaults and ours, whatever the user has set; to be held while a figure is drawn and rendered.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    require_matplotlib()
    import matplotlib as mpl

    ours: dict[Any, Any] = {
        "svg.hashsalt": "bitneat",
        "text.parse_math": False,  # names of files and runs may hold a $
        "font.size": 9.0,
        "axes.titlesize": 10.0,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.edgecolor": GREY,
        "axes.linewidth": 0.6,
        "xtick.color": GREY,
        "ytick.color": GREY,
        "xtick.labelcolor": "black",
        "ytick.labelcolor": "black",
        "grid.color": "#dddddd",
        "grid.linewidth": 0.5,
        "savefig.dpi": 120.0,
    }
    with mpl.rc_context({**mpl.rcParamsDefault, **ours}):
        yield


def file_format(path: PurePath) -> str:
    """``svg`` or ``png``, by the ending of a file's name.

    Raises:
        BitneatError: if it is another.
    """
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        raise BitneatError(f"{path}: expected a name that ends in {' or '.join(f'.{known}' for known in FORMATS)}")
    return suffix


def reference_line(axes: Axes, value: float) -> None:
    """A thin line across, its value at the left end."""
    axes.axhline(value, color=GREY, linewidth=0.7, linestyle=(0, (6, 3)), zorder=0)
    axes.annotate(
        f"{value:g}", (0.0, value), xycoords=("axes fraction", "data"), textcoords="offset points", xytext=(3, 2),
        color=GREY, fontsize=8,
    )  # fmt: skip


def render(figure: Figure, file_type: str, title: str, description: str) -> bytes:
    """The file's content; ``title`` and ``description`` go into its metadata."""
    metadata: dict[str, str | None] = {"Title": title, "Description": description}
    if file_type == "svg":
        metadata |= {"Date": None, "Creator": "bitneat"}
    else:
        metadata |= {"Software": "bitneat"}
    buffer = io.BytesIO()
    figure.savefig(buffer, format=file_type, metadata=metadata)
    return _renamed(buffer.getvalue()) if file_type == "svg" else buffer.getvalue()


def _renamed(svg: bytes) -> bytes:
    """The SVG with its hashed names numbered in the order they come: Matplotlib hashes addresses of objects, too."""
    names: dict[bytes, bytes] = {}

    def number(found: re.Match[bytes]) -> bytes:
        return names.setdefault(found[0], b"%c%d" % (found[0][:1], len(names)))

    svg = re.sub(rb"\b[a-zA-Z][0-9a-f]{10}\b", number, svg)
    # The layout's solver differs in its last digits from time to time. Numbers below 1 are scales, and stay as they are.
    return re.sub(rb"\b[1-9]\d*\.\d{4,}", lambda found: b"%.2f" % float(found[0]), svg)
