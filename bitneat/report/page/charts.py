# SPDX-License-Identifier: MIT
"""Charts as values: scales, ticks and the points of lines, for the page's template to draw and its script to read out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 640.0, 250.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 14.0, 30.0, 34.0


@dataclass(frozen=True, slots=True)
class Series:
    """Values over the chart's x; NaN where there is none. ``tone`` is the number of its colour."""

    name: str
    values: tuple[float, ...]
    tone: int


@dataclass(frozen=True, slots=True)
class Tick:
    """A mark on an axis."""

    at: float
    text: str


@dataclass(frozen=True, slots=True)
class Line:
    """A series as it is drawn."""

    name: str
    tone: int
    path: str
    end: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Row:
    """What is read out where the pointer is: the x in pixels, a title, and a text for each series."""

    at: float
    title: str
    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Dot:
    """A point of a scatter chart."""

    x: float
    y: float
    name: str
    text: str
    strong: bool
    labelled: bool

    @property
    def anchor(self) -> str:
        """Which end of its label is at the dot: labels must not leave the chart."""
        return "end" if self.x > WIDTH / 2 else "start"

    @property
    def shift(self) -> float:
        """How far the label is from the dot."""
        return -8.0 if self.x > WIDTH / 2 else 8.0


@dataclass(frozen=True)
class Chart:
    """Lines over x, or dots."""

    key: str
    title: str
    x_label: str
    y_label: str
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    lines: tuple[Line, ...] = ()
    rows: tuple[Row, ...] = ()
    dots: tuple[Dot, ...] = ()
    front: str = ""
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM


@dataclass(frozen=True, slots=True)
class Point:
    """A controller for `scatter`: what it costs, and what it earns."""

    name: str
    x: float
    y: float
    strong: bool = False
    named: bool = False
    """Whether its name stands beside it."""


class _Scale:
    def __init__(self, low: float, high: float, start: float, stop: float) -> None:
        self.step = max(tick_step(high - low), 1e-9 * max(abs(low), abs(high)))  # or it is lost in rounding
        self.low = math.floor(low / self.step) * self.step
        self.high = max(math.ceil(high / self.step) * self.step, self.low + self.step)
        self._start, self._stop = start, stop

    def __call__(self, value: float) -> float:
        part = (value - self.low) / (self.high - self.low)
        return round(self._start + part * (self._stop - self._start), 2)

    def ticks(self) -> tuple[Tick, ...]:
        count = round((self.high - self.low) / self.step)
        values = [self.low + index * self.step for index in range(count + 1)]
        return tuple(Tick(self(value), number(value)) for value in values)


def tick_step(span: float) -> float:
    """1, 2 or 5 times a power of ten, so that a span has about five."""
    if not span > 0:
        return 1.0
    power: float = 10.0 ** math.floor(math.log10(span / 5))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= span / 5 * 0.999)


def number(value: float) -> str:
    """A number as an axis and a tooltip show it; a dash for none."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:,.0f}" if value == round(value) else f"{value:,.1f}" if abs(value) >= 10 else f"{value:.3g}"
    return text.replace("-", "−")


def lines(key: str, title: str, labels: tuple[str, str], xs: Sequence[float], series: Sequence[Series]) -> Chart | None:
    """A chart of lines; None if there is not a single value.

    Args:
        key: its id in the page.
        title: above it.
        labels: of x and of y.
        xs: ascending.
        series: as many values each as there are xs.
    """
    finite = [value for one in series for value in one.values if math.isfinite(value)]
    if not finite or not xs:
        return None
    x = _Scale(min(xs), max(xs), LEFT, WIDTH - RIGHT)
    y = _Scale(min(finite), max(finite), HEIGHT - BOTTOM, TOP)
    x.low, x.high = min(xs), max(*xs, min(xs) + 1)  # the last generation ends the axis, not the last tick
    step = max(tick_step(x.high - x.low), 1.0)
    first = math.ceil(x.low / step)
    ticks = [value * step for value in range(first, math.floor(x.high / step) + 1)]
    drawn = []
    for one in series:
        points = [(x(at), y(value)) for at, value in zip(xs, one.values, strict=True) if math.isfinite(value)]
        if points:
            path = "M" + "L".join(f"{px:g} {py:g}" for px, py in points)
            drawn.append(Line(one.name, one.tone, path, points[-1]))
    rows = tuple(
        Row(x(at), f"{labels[0]} {number(at)}", tuple(f"{one.name}: {number(one.values[i])}" for one in series))
        for i, at in enumerate(xs)
    )
    return Chart(
        key, title, *labels, tuple(Tick(x(value), number(value)) for value in ticks), y.ticks(), tuple(drawn), rows
    )


def scatter(key: str, title: str, labels: tuple[str, str], points: Sequence[Point]) -> Chart | None:
    """A chart of dots with the front of those that no smaller one equals; None if there are fewer than two."""
    points = [point for point in points if math.isfinite(point.x) and math.isfinite(point.y)]
    if len(points) < 2:
        return None
    x = _Scale(min(p.x for p in points), max(p.x for p in points), LEFT, WIDTH - RIGHT)
    y = _Scale(min(p.y for p in points), max(p.y for p in points), HEIGHT - BOTTOM, TOP)
    dots = tuple(
        Dot(x(p.x), y(p.y), p.name, f"{p.name}: {number(p.x)} {labels[0]}, {number(p.y)}", p.strong, p.named)
        for p in points
    )
    path = "".join(_stair(front(points), x, y))
    return Chart(key, title, *labels, x.ticks(), y.ticks(), dots=dots, front=path)


def front(points: Sequence[Point]) -> list[Point]:
    """The points that no other one with as little x, or less, equals in y; by x."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.x, -p.y, p.name)):
        if not best or point.y > best[-1].y:
            best.append(point)
    return best


def _stair(points: Sequence[Point], x: _Scale, y: _Scale) -> list[str]:
    parts = [f"M{x(points[0].x):g} {y(points[0].y):g}"]
    for point in points[1:]:
        parts.append(f"H{x(point.x):g}V{y(point.y):g}")
    return parts
