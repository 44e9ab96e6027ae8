# SPDX-License-Identifier: MIT
"""The figure of one network: what it reads, what each node does, what comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from bitneat.champion import AnyChampion, Champion
from bitneat.controller import Constant, Controller, Node
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, FloatNode
from bitneat.report import figure
from bitneat.report.figure import BLUE, GREY, VERMILION
from bitneat.report.layers import Layout, lay_out
from bitneat.sim.names import input_names, output_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_LINKS = 5000
"""Of more, no figure would show anything."""

_ROW, _COLUMN = 0.3, 1.75
"""Inches between rows and between columns."""
_BOX = (0.9, 0.21)
"""Width and height of a node, in inches."""
_LETTER = 0.062
"""Width of a letter of a name, in inches, on the safe side."""
_MARGIN = 0.15
_HEAD, _FOOT, _UNDER = 0.4, 0.45, 0.3
"""Inches for the title, for the legend, and for links that go back below the nodes."""
_TIMES, _DIVIDED, _MINUS = "\u00d7", "\u00f7", "\u2212"


@dataclass(frozen=True)
class Wire:
    """A link between vertices: positive or negative, by its weight, or with no weight at all to an output."""

    source: int
    target: int
    weight: float | None
    delayed: bool = False


@dataclass(frozen=True)
class Wiring:
    """A network as vertices with labels in columns: the inputs that are read, the nodes, the outputs."""

    labels: tuple[str, ...]
    columns: tuple[int, ...]
    wires: tuple[Wire, ...]
    num_inputs: int
    num_nodes: int
    unread: int
    """Inputs that nothing reads; they are left out."""

    def is_forward(self, wire: Wire) -> bool:
        """True iff it runs from left to right, as all do that are not delayed."""
        return self.columns[wire.source] < self.columns[wire.target]


def wiring(champion: AnyChampion) -> Wiring:
    """What is to be drawn of a champion: its network, pruned of what no output needs."""
    if isinstance(champion, Champion):
        controller = champion.controller.canonical
        count = len(controller.inputs)
        nodes = [_node_label(node, controller) for node in controller.nodes]
        outputs = [None if isinstance(output, Constant) else output.index for output in controller.outputs]
        links = _links(controller)
        constants = {
            i: f" = {output.value / controller.one:g}"
            for i, output in enumerate(controller.outputs)
            if isinstance(output, Constant)
        }
    else:
        network = champion.network
        count = network.num_inputs
        nodes = [_float_label(node) for node in network.nodes]
        outputs = list(network.outputs)
        links = [
            Wire(source, count + i, weight) for i, node in enumerate(network.nodes) for source, weight in node.links if weight
        ]  # fmt: skip
        constants = {}
    if len(links) > MAX_LINKS:
        raise BitneatError(f"plot network: {len(links)} links are too many to draw, the most is {MAX_LINKS}")
    names = input_names(champion.environment, count)
    results = [
        name + constants.get(i, "") for i, name in enumerate(output_names(champion.environment, len(outputs)))
    ]  # fmt: skip
    return _arranged(names, nodes, results, links, outputs)


def _arranged(
    names: Sequence[str],
    nodes: Sequence[str],
    results: Sequence[str],
    links: Sequence[Wire],
    outputs: Sequence[int | None],
) -> Wiring:
    count, first_output = len(names), len(names) + len(nodes)
    depth = [0] * count + [1] * len(nodes)
    followed = {wire.source for wire in links if not wire.delayed}
    for wire in sorted(links, key=lambda wire: wire.target):  # a node's sources come before it
        if not wire.delayed:
            depth[wire.target] = max(depth[wire.target], depth[wire.source] + 1)
    last = max(depth)
    for output in outputs:  # what nothing else reads stands beside its output
        if output is not None and output >= count and output not in followed:
            depth[output] = last
    wires = [*links, *(Wire(o, first_output + i, None) for i, o in enumerate(outputs) if o is not None)]
    read = {wire.source for wire in wires}
    kept = [v for v in range(first_output + len(results)) if v >= count or v in read]
    place = {vertex: index for index, vertex in enumerate(kept)}
    labels, columns = [*names, *nodes, *results], [*depth, *[last + 1] * len(results)]
    return Wiring(
        tuple(labels[v] for v in kept),
        tuple(columns[v] for v in kept),
        tuple(Wire(place[w.source], place[w.target], w.weight, w.delayed) for w in wires),
        sum(v < count for v in kept),
        len(nodes),
        sum(v not in read for v in range(count)),
    )


def network_figure(champion: AnyChampion, name: str, file_type: str) -> bytes:
    """The figure as SVG or PNG.

    Args:
        champion: ternary, integer or float.
        name: what the title calls it.
        file_type: ``svg`` or ``png``.

    Raises:
        BitneatError: if it has more than `MAX_LINKS` links, or Matplotlib is not installed.
    """
    picture = wiring(champion)
    layout = lay_out(picture.columns, [(w.source, w.target) for w in picture.wires if picture.is_forward(w)])
    policy = champion.controller if isinstance(champion, Champion) else champion.network
    with figure.settings():
        from matplotlib.figure import Figure

        left = _MARGIN + _LETTER * max([len(t) for t in picture.labels[: picture.num_inputs]] + [0])
        results = picture.labels[picture.num_inputs + picture.num_nodes :]
        right = _MARGIN + _LETTER * max(len(text) for text in results)
        width = left + _COLUMN * max(picture.columns) + right
        width += max(0.0, 5.5 - width)
        foot = _FOOT + (0.0 if all(map(picture.is_forward, picture.wires)) else _UNDER)
        height = _HEAD + foot + _ROW * (layout.height + 1.0)
        page = Figure(figsize=(width, height))
        axes = page.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(-left, width - left)  # one unit is an inch
        axes.set_ylim(0.0, height)
        _Painter(axes, picture, layout, foot).paint()
        axes.text(_MARGIN - left, height - 0.12, _title(champion, name, picture), verticalalignment="top", fontsize=10)
        _legend(axes, picture, _MARGIN - left)
        return figure.render(page, file_type, f"bitneat: the network of {name}", f"sha256 {policy.sha256}")


class _Painter:
    def __init__(self, axes: Axes, picture: Wiring, layout: Layout, foot: float) -> None:
        self._axes, self._picture, self._layout = axes, picture, layout
        ends = [height for route in layout.routes for _, height in route] + list(layout.heights)
        self._base = foot + _ROW * (0.5 - min(ends))
        self._largest = max([abs(w.weight) for w in picture.wires if w.weight is not None] + [0.0])
        self._equal = len({abs(w.weight) for w in picture.wires if w.weight is not None}) < 2

    def paint(self) -> None:
        routes = iter(self._layout.routes)
        for wire in self._picture.wires:
            if self._picture.is_forward(wire):
                self._run(wire, next(routes))
            else:
                self._loop(wire)
        for vertex, label in enumerate(self._picture.labels):
            self._stamp(vertex, label)

    def _at(self, column: int, height: float) -> tuple[float, float]:
        return column * _COLUMN, self._base + _ROW * height

    def _half(self, vertex: int) -> float:
        """From the middle of a vertex to where its links begin and end."""
        picture = self._picture
        is_node = picture.num_inputs <= vertex < picture.num_inputs + picture.num_nodes
        return _BOX[0] / 2 if is_node else 0.04

    def _run(self, wire: Wire, route: Sequence[tuple[int, float]]) -> None:
        """A smooth line through all points of the route."""
        points = [self._at(*point) for point in route]
        points[0] = points[0][0] + self._half(wire.source), points[0][1]
        points[-1] = points[-1][0] - self._half(wire.target), points[-1][1]
        path = [points[0]]
        for (x0, y0), (x1, y1) in pairwise(points):
            bend = (x1 - x0) * 0.45
            path += [(x0 + bend, y0), (x1 - bend, y1), (x1, y1)]
        self._line(wire, path, arrow=False)

    def _loop(self, wire: Wire) -> None:
        """Back, below the nodes between; to the node itself, above it."""
        heights, columns = self._layout.heights, self._picture.columns
        x0, y0 = self._at(columns[wire.source], heights[wire.source])
        x1, y1 = self._at(columns[wire.target], heights[wire.target])
        half = _BOX[1] / 2
        if wire.source == wire.target:
            path = [(x0 + 0.25, y0 + half), (x0 + 0.2, y0 + 0.26), (x0 - 0.2, y0 + 0.26), (x0 - 0.25, y0 + half)]
        elif columns[wire.source] == columns[wire.target]:
            side = _BOX[0] / 2
            reach = 0.25 + 0.08 * abs(y1 - y0)
            path = [(x0 + side, y0), (x0 + side + reach, y0), (x1 + side + reach, y1), (x1 + side, y1)]
        else:
            depth = min(y0, y1) - half - 0.12 - 0.06 * abs(x1 - x0)
            path = [(x0, y0 - half), (x0 - 0.1, depth), (x1 + 0.1, depth), (x1, y1 - half)]
        self._line(wire, path, arrow=True)

    def _line(self, wire: Wire, points: Sequence[tuple[float, float]], *, arrow: bool) -> None:
        from matplotlib.patches import FancyArrowPatch
        from matplotlib.path import Path

        path = Path(list(points), [Path.MOVETO] + [Path.CURVE4] * (len(points) - 1))
        colour = GREY if wire.weight is None else BLUE if wire.weight > 0 else VERMILION
        self._axes.add_patch(
            FancyArrowPatch(
                path=path,
                arrowstyle="-|>" if arrow else "-",
                mutation_scale=6,
                color=colour,
                linewidth=self._width(wire),
                linestyle=(0, (4, 2)) if wire.delayed else "-",
                alpha=0.85,
                fill=arrow,
                shrinkA=0,
                shrinkB=0,
                capstyle="round",
                zorder=1,
            )
        )

    def _width(self, wire: Wire) -> float:
        if wire.weight is None or self._equal:
            return 0.9
        return 0.3 + 2.0 * abs(wire.weight) / self._largest

    def _stamp(self, vertex: int, label: str) -> None:
        picture = self._picture
        x, y = self._at(picture.columns[vertex], self._layout.heights[vertex])
        if vertex < picture.num_inputs:
            self._axes.plot([x], [y], marker="s", markersize=3.5, color=GREY, zorder=3)
            self._axes.text(x - 0.08, y, label, horizontalalignment="right", verticalalignment="center", fontsize=7.5)
        elif vertex >= picture.num_inputs + picture.num_nodes:
            self._axes.plot([x], [y], marker="o", markersize=3.5, color="black", zorder=3)
            self._axes.text(x + 0.08, y, label, verticalalignment="center", fontsize=7.5)
        else:
            from matplotlib.patches import FancyBboxPatch

            corner = (x - _BOX[0] / 2, y - _BOX[1] / 2)
            style = f"round,pad=0,rounding_size={_BOX[1] / 2}"
            self._axes.add_patch(
                FancyBboxPatch(
                    corner, *_BOX, boxstyle=style, facecolor="white", edgecolor="black", linewidth=0.7, zorder=3
                )
            )
            self._axes.text(
                x, y, label, horizontalalignment="center", verticalalignment="center_baseline", fontsize=7, zorder=4
            )


def _links(controller: Controller) -> list[Wire]:
    """With the power of two that a shift is; gains stand at the nodes."""
    first = len(controller.inputs)
    return [
        Wire(link.source, first + index, float(link.sign << link.shift), bool(link.delay))
        for index, node in enumerate(controller.nodes)
        for link in node.links
    ]


def _node_label(node: Node, controller: Controller) -> str:
    bias = "" if not node.bias else f" {_signed(node.bias / controller.one)}"
    return f"{node.activation}{bias}{_gain(node.gain)}"


def _gain(gain: int) -> str:
    return "" if gain == 0 else f" {_TIMES}{1 << gain}" if gain > 0 else f" {_DIVIDED}{1 << -gain}"


def _float_label(node: FloatNode) -> str:
    bias = "" if not node.bias else f" {_signed(node.bias)}"
    response = "" if node.response == 1.0 else f" {_TIMES}{node.response:.2g}"
    return f"{node.activation}{bias}{response}"


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else _MINUS}{abs(value):.2g}"


def _title(champion: AnyChampion, name: str, picture: Wiring) -> str:
    policy = champion.controller.canonical if isinstance(champion, Champion) else champion.network
    if isinstance(policy, FloatNetwork):
        kind, size = "float weights", ""
    else:
        kind = f"weights {_MINUS}1, 0, +1" if policy.is_ternary else "weights of powers of two"
        size = f", {len(pack(policy))} bytes packed"
    unread = f"; inputs that are not read: {picture.unread}" if picture.unread else ""
    return f"{name}: {len(policy.nodes)} nodes, {policy.num_links} links, {kind}{size}{unread}"


def _legend(axes: Axes, picture: Wiring, left: float) -> None:
    from matplotlib.lines import Line2D

    weights = [wire.weight for wire in picture.wires if wire.weight is not None]
    handles = []
    if any(weight > 0 for weight in weights):
        handles.append(Line2D([], [], color=BLUE, linewidth=1.2, label="adds"))
    if any(weight < 0 for weight in weights):
        handles.append(Line2D([], [], color=VERMILION, linewidth=1.2, label="subtracts"))
    if any(wire.delayed for wire in picture.wires):
        handles.append(
            Line2D([], [], color="black", linewidth=1.0, linestyle=(0, (4, 2)), label="value of the step before")
        )
    if len({abs(weight) for weight in weights}) > 1:
        handles.append(Line2D([], [], color="black", linewidth=2.2, label="wider: larger weight"))
    if handles:
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(left, 0.05), bbox_transform=axes.transData,
            ncols=len(handles), frameon=False, fontsize=7.5, borderaxespad=0.0, handlelength=2.0,
        )  # fmt: skip
