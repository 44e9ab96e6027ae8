# SPDX-License-Identifier: MIT
"""Layered drawings, against definitions too slow to draw by."""

from __future__ import annotations

from itertools import combinations, pairwise, permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bitneat.report.layers import Layout, _Graph, lay_out


@st.composite
def graphs(draw: st.DrawFn) -> tuple[list[int], list[tuple[int, int]]]:
    columns = draw(st.lists(st.integers(0, 3), min_size=2, max_size=9))
    pairs = [(a, b) for a in range(len(columns)) for b in range(len(columns)) if columns[a] < columns[b]]
    return columns, draw(st.lists(st.sampled_from(pairs), max_size=12)) if pairs else []


def crossings_of(layout: Layout) -> int:
    """Two pieces between the same two columns cross if their ends are in opposite order."""
    pieces = [piece for route in layout.routes for piece in pairwise(route)]
    return sum(
        (a[0][1] - b[0][1]) * (a[1][1] - b[1][1]) < -1e-9
        for a, b in combinations(pieces, 2)
        if a[0][0] == b[0][0]
    )  # fmt: skip


@given(graphs())
def test_routes_go_column_by_column_from_source_to_target(graph: tuple[list[int], list[tuple[int, int]]]) -> None:
    columns, links = graph
    layout = lay_out(columns, links)
    for (source, target), route in zip(links, layout.routes, strict=True):
        assert route[0] == (columns[source], layout.heights[source])
        assert route[-1] == (columns[target], layout.heights[target])
        assert [column for column, _ in route] == list(range(columns[source], columns[target] + 1))


@given(graphs())
def test_vertices_of_a_column_are_apart(graph: tuple[list[int], list[tuple[int, int]]]) -> None:
    columns, links = graph
    layout = lay_out(columns, links)
    for a, b in combinations(range(len(columns)), 2):
        if columns[a] == columns[b]:
            assert abs(layout.heights[a] - layout.heights[b]) > 1 - 1e-9


@given(graphs())
def test_crossings_are_counted_as_they_are_and_are_no_more_than_in_the_order_given(
    graph: tuple[list[int], list[tuple[int, int]]],
) -> None:
    columns, links = graph
    layout = lay_out(columns, links)
    assert crossings_of(layout) == layout.crossings
    given_order = _Graph(columns, links)
    order: list[list[int]] = [[] for _ in range(max(columns) + 1)]
    for vertex in range(len(given_order.columns) - 1, -1, -1):
        order[given_order.columns[vertex]].append(vertex)
    assert layout.crossings <= given_order.crossings(order)


def test_a_tangle_that_can_be_undone_is_undone() -> None:
    columns = [0, 0, 0, 0, 1, 1, 1, 1]
    links = [(0, 7), (1, 6), (2, 5), (3, 4), (0, 6), (1, 5)]
    fewest = min(_Graph(columns, links).crossings([[0, 1, 2, 3], list(right)]) for right in permutations(range(4, 8)))
    assert lay_out(columns, links).crossings == fewest == 0


@given(st.lists(st.floats(-20, 20), min_size=1, max_size=12))
def test_heights_are_the_nearest_that_keep_the_order(wanted: list[float]) -> None:
    graph = _Graph([0] * len(wanted), [])
    heights = graph._spaced(range(len(wanted)), wanted)
    assert all(high - low > 1 - 1e-9 for low, high in pairwise(heights))
    # Of a convex problem any small step that keeps the gaps must not improve the sum of squares.
    cost = float(np.sum((np.array(heights) - wanted) ** 2))
    for first in range(len(wanted)):
        for last in range(first + 1, len(wanted) + 1):
            for step in (-1e-3, 1e-3):
                moved = np.array(heights)
                moved[first:last] += step
                if np.all(np.diff(moved) > 1 - 1e-9):
                    assert float(np.sum((moved - wanted) ** 2)) >= cost - 1e-9
