# SPDX-License-Identifier: MIT
"""Layered drawings of graphs: vertices in columns, few crossings, links that run short and straight.

After Sugiyama, Tagawa and Toda: a link over several columns passes through a point in each of those between; the columns are
sorted by barycentre, from left to right and back, and the order with the fewest crossings is kept. Heights are then the
least-squares ones: each vertex as near as its column's order allows to the mean of its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from bitneat.report.pooling import pooled

_SWEEPS = 24
_SETTLING = 16
_GAPS = (0.4, 0.55, 1.0)
"""Least distance of neighbours in a column of which none, one or both are vertices and not points that a link passes."""


@dataclass(frozen=True)
class Layout:
    """Where everything is: columns are whole numbers from the left, heights grow upwards."""

    heights: tuple[float, ...]
    """Of each vertex."""
    routes: tuple[tuple[tuple[int, float], ...], ...]
    """Of each link the (column, height) from its source to its target, one for each column on the way."""
    crossings: int
    """Pairs of links that cross between two neighbouring columns."""

    @property
    def height(self) -> float:
        """From the lowest vertex or point to the highest."""
        ends = [height for route in self.routes for _, height in route] + list(self.heights)
        return max(ends) - min(ends) if ends else 0.0


def lay_out(columns: Sequence[int], links: Sequence[tuple[int, int]]) -> Layout:
    """Order and heights.

    Args:
        columns: of each vertex, from 0.
        links: (source, target) each; the target's column is greater than the source's.
    """
    graph = _Graph(columns, links)
    order = graph.best_order()
    heights = graph.settle(order)
    routes = tuple(tuple((graph.columns[v], heights[v]) for v in chain) for chain in graph.chains)
    return Layout(tuple(heights[: len(columns)]), routes, graph.crossings(order))


class _Graph:
    """The vertices, and from their number on the points that links pass."""

    def __init__(self, columns: Sequence[int], links: Sequence[tuple[int, int]]) -> None:
        self.columns = list(columns)
        self.real = len(columns)
        self.chains: list[tuple[int, ...]] = []
        for source, target in links:
            first = len(self.columns)
            self.columns.extend(range(columns[source] + 1, columns[target]))
            self.chains.append((source, *range(first, len(self.columns)), target))
        self.before: list[list[int]] = [[] for _ in self.columns]
        self.after: list[list[int]] = [[] for _ in self.columns]
        for chain in self.chains:
            for left, right in pairwise(chain):
                self.after[left].append(right)
                self.before[right].append(left)

    def best_order(self) -> list[list[int]]:
        """The vertices of each column from bottom to top."""
        order: list[list[int]] = [[] for _ in range(max(self.columns, default=-1) + 1)]
        for vertex in range(len(self.columns) - 1, -1, -1):  # the first of each column at the top
            order[self.columns[vertex]].append(vertex)
        best, fewest = order, self.crossings(order)
        for sweep in range(_SWEEPS):
            if not fewest:
                break
            order = self._swept(order, rightwards=sweep % 2 == 0)
            count = self.crossings(order)
            if count < fewest:
                best, fewest = order, count
        return best

    def _swept(self, order: Sequence[Sequence[int]], *, rightwards: bool) -> list[list[int]]:
        """Each column in turn sorted by the mean place of its neighbours in the one before."""
        swept = [list(column) for column in order]
        neighbours = self.before if rightwards else self.after
        places = {vertex: float(place) for column in swept for place, vertex in enumerate(column)}
        for index in range(len(swept)) if rightwards else range(len(swept) - 1, -1, -1):
            swept[index].sort(key=lambda vertex: _mean([places[n] for n in neighbours[vertex]], places[vertex]))
            places.update((vertex, float(place)) for place, vertex in enumerate(swept[index]))
        return swept

    def crossings(self, order: Sequence[Sequence[int]]) -> int:
        """Pairs of links whose ends are in opposite order."""
        place = {vertex: index for column in order for index, vertex in enumerate(column)}
        total = 0
        for column in order:
            ends = [place[right] for left in column for right in sorted(self.after[left], key=place.__getitem__)]
            total += _inversions(ends)
        return total

    def settle(self, order: Sequence[Sequence[int]]) -> list[float]:
        """A height for each vertex and point, in each column's order and at least a gap apart."""
        heights = [0.0] * len(self.columns)
        for column in order:
            for vertex, height in zip(column, self._spaced(column, [0.0] * len(column)), strict=True):
                heights[vertex] = height
        for sweep in range(_SETTLING):
            for column in reversed(order) if sweep % 2 == 0 else order:
                wanted = [
                    _mean([heights[n] for n in self.before[v] + self.after[v]], heights[v]) for v in column
                ]  # fmt: skip
                for vertex, height in zip(column, self._spaced(column, wanted), strict=True):
                    heights[vertex] = height
        return heights

    def _spaced(self, column: Sequence[int], wanted: Sequence[float]) -> list[float]:
        """The rising heights nearest to those wanted, by least squares, that keep the gaps."""
        offsets = [0.0]
        for low, high in pairwise(column):
            offsets.append(offsets[-1] + _GAPS[(low < self.real) + (high < self.real)])
        levels = pooled([target - offset for target, offset in zip(wanted, offsets, strict=False)])
        return [level + offset for level, offset in zip(levels, offsets, strict=False)]


def _mean(values: Sequence[float], otherwise: float) -> float:
    return sum(values) / len(values) if values else otherwise


def _inversions(values: list[int]) -> int:
    """Pairs that stand in falling order, by merging."""
    if len(values) < 2:
        return 0
    middle = len(values) // 2
    left, right = values[:middle], values[middle:]
    count = _inversions(left) + _inversions(right)
    at = 0
    left.sort()
    right.sort()
    for value in right:
        while at < len(left) and left[at] <= value:
            at += 1
        count += len(left) - at
    return count
