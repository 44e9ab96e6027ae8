# SPDX-License-Identifier: MIT
"""Where the controller's inputs, nodes and outputs go in its drawing, and the curves that link them.

Layers run from left to right: the inputs that are read, the nodes by the longest path that leads to them, the outputs. Within
the layers the places follow the mean of their neighbours' (the barycentre heuristic of Sugiyama, Tagawa and Toda, 1981), which
leaves few crossings and short curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from bitneat.controller import Controller, Node, Signal
from bitneat.report.pooling import pooled

INPUT_WIDTH = 184.0
"""Of an input at least: what it is called in formulas, its name and its value."""
LETTER = 6.2
"""Width of a name's letter, about."""
ROW = 23.0
"""Height of an input's row, and of a node where there are many."""
WIDE_ROW = 27.0
"""Height of an input's row where few are read."""
FEW = 16
CROWDED = 9
"""With more nodes than this in a layer, a node gets one line instead of two."""
MARGIN = 14.0
_SWEEPS = 24


@dataclass(frozen=True, slots=True)
class Box:
    """A signal or an output with its place: the left edge and the middle, in pixels."""

    key: str
    signal: int | None
    x: float
    y: float
    width: float
    height: float
    label: str
    detail: str


@dataclass(frozen=True, slots=True)
class Curve:
    """A link of a node, or the line from a signal to an output, as an SVG path.

    ``sign`` is 0 for the latter. ``target`` is the key of the box that it leads to.
    """

    source: int
    target: str
    sign: int
    shift: int
    delay: int
    path: str


@dataclass(frozen=True)
class Graph:
    """The whole drawing."""

    width: float
    height: float
    inputs: tuple[Box, ...]
    nodes: tuple[Box, ...]
    outputs: tuple[Box, ...]
    curves: tuple[Curve, ...]
    unread: tuple[str, ...]
    """The inputs that nothing reads; they are not drawn."""
    crowded: bool

    @property
    def has_delayed(self) -> bool:
        """Whether a link reads the step before."""
        return any(curve.delay for curve in self.curves)


@dataclass
class _Vertex:
    key: str
    layer: int
    height: float
    neighbours: list[_Vertex] = field(default_factory=list)
    y: float = 0.0


def layout(controller: Controller, input_names: Sequence[str], output_names: Sequence[str]) -> Graph:
    """Place everything.

    Args:
        controller: a canonical one.
        input_names: what each input is called.
        output_names: what each output is called.
    """
    num_inputs = len(controller.inputs)
    layers = _layers(controller)
    num_layers = max(layers.values(), default=0)
    nodes = [signal for signal in layers if signal >= num_inputs]
    crowded = max([sum(layers[s] == layer for s in nodes) for layer in range(1, num_layers + 1)] or [0]) > CROWDED
    node_height = ROW if crowded else 36.0
    vertices = {signal_key(s, num_inputs): layers[s] for s in layers}
    vertices |= {f"y{i}": num_layers + 1 for i in range(len(controller.outputs))}
    row = ROW if sum(layers[s] == 0 for s in layers) > FEW else WIDE_ROW
    columns = _columns(controller, vertices, {"x": row, "n": node_height, "y": 30.0})
    height = _place(columns)
    gap = 58.0 if num_layers > 3 else 96.0
    pin_width = 68.0 + 6.6 * max(len(name) for name in output_names)
    first_gap = 130.0 if crowded else gap
    node_width = 80.0 if crowded else 104.0
    longest = max([len(input_names[s]) for s in layers if s < num_inputs] or [0])
    input_width = max(INPUT_WIDTH, 94.0 + LETTER * longest)
    lefts = [0.0, *(input_width + first_gap + column * (node_width + gap) for column in range(num_layers + 1))]
    place = {vertex.key: vertex for column in columns for vertex in column}

    def box(key: str, signal: int | None, label: str, detail: str) -> Box:
        vertex = place[key]
        width = {"x": input_width, "n": node_width, "y": pin_width}[key[0]]
        return Box(key, signal, lefts[vertex.layer], round(vertex.y, 1), width, vertex.height, label, detail)

    boxes = {
        **{s: box(f"x{s}", s, input_names[s], f"x{s}") for s in layers if s < num_inputs},
        **{s: box(f"n{s - num_inputs}", s, f"n{s - num_inputs}", _response(_node(controller, s))) for s in nodes},
    }
    outputs = [
        box(f"y{i}", output.index if isinstance(output, Signal) else None, output_names[i], f"y{i}")
        for i, output in enumerate(controller.outputs)
    ]
    curves = [
        Curve(link.source, boxes[s].key, link.sign, link.shift, link.delay, _path(boxes[link.source], boxes[s]))
        for s in nodes
        for link in _node(controller, s).links
    ]
    curves += [
        Curve(pin.signal, pin.key, 0, 0, 0, _path(boxes[pin.signal], pin)) for pin in outputs if pin.signal is not None
    ]
    return Graph(
        width=lefts[-1] + pin_width,
        height=height,
        inputs=tuple(boxes[s] for s in sorted(boxes) if s < num_inputs),
        nodes=tuple(boxes[s] for s in sorted(boxes) if s >= num_inputs),
        outputs=tuple(outputs),
        curves=tuple(curves),
        unread=tuple(input_names[i] for i in range(num_inputs) if i not in layers),
        crowded=crowded,
    )


def signal_key(signal: int, num_inputs: int) -> str:
    """What a signal is called in formulas: ``x3`` is an input, ``n3`` a node."""
    return f"x{signal}" if signal < num_inputs else f"n{signal - num_inputs}"


def _node(controller: Controller, signal: int) -> Node:
    return controller.nodes[signal - len(controller.inputs)]


def _response(node: Node) -> str:
    """The gain and the activation in few letters."""
    gain = "" if node.gain == 0 else f" ×{1 << node.gain}" if node.gain > 0 else f" ÷{1 << -node.gain}"
    # An identity does nothing, so it is not named unless the place would be empty.
    return (f"{node.activation}{gain}" if node.activation != "identity" else gain.strip()) or "sum"


def _layers(controller: Controller) -> dict[int, int]:
    """The layer of each node, and of each input that something reads; a node that only outputs read is in the last."""
    num_inputs = len(controller.inputs)
    read = {link.source for node in controller.nodes for link in node.links}
    layers = {
        s: 0 for s in sorted(read | {o.index for o in controller.outputs if isinstance(o, Signal)}) if s < num_inputs
    }
    for signal, node in enumerate(controller.nodes, start=num_inputs):
        layers[signal] = max([layers[link.source] for link in node.links if not link.delay] + [0]) + 1
    last = max(layers.values(), default=0)
    for signal in range(num_inputs, controller.num_signals):
        if signal not in read:
            layers[signal] = last
    return layers


def _columns(controller: Controller, layers: dict[str, int], heights: dict[str, float]) -> list[list[_Vertex]]:
    vertices = {key: _Vertex(key, layer, heights[key[0]]) for key, layer in layers.items()}
    num_inputs = len(controller.inputs)
    edges = [
        (signal_key(link.source, num_inputs), signal_key(signal, num_inputs))
        for signal, node in enumerate(controller.nodes, start=num_inputs)
        for link in node.links
        if not link.delay
    ]
    edges += [
        (signal_key(o.index, num_inputs), f"y{i}") for i, o in enumerate(controller.outputs) if isinstance(o, Signal)
    ]
    for source, target in edges:
        vertices[source].neighbours.append(vertices[target])
        vertices[target].neighbours.append(vertices[source])
    columns: list[list[_Vertex]] = [[] for _ in range(max(layers.values(), default=0) + 1)]
    for vertex in vertices.values():
        columns[vertex.layer].append(vertex)
    return columns


def _place(columns: list[list[_Vertex]]) -> float:
    """Give every vertex its height above the lower edge; the height of the whole."""
    spacing = {"x": 1.0, "n": 8.0, "y": 14.0}
    height = max(sum(v.height + spacing[v.key[0]] for v in column) for column in columns) + 2 * MARGIN
    for column in columns:
        for index, vertex in enumerate(column):
            vertex.y = height * (index + 0.5) / len(column)
    for sweep in range(_SWEEPS):
        for column in columns if sweep % 2 == 0 else reversed(columns):
            wanted = {
                v.key: sum(n.y for n in v.neighbours) / len(v.neighbours) if v.neighbours else v.y for v in column
            }
            column.sort(key=lambda v: (wanted[v.key], v.key))
            steps = [v.height + spacing[v.key[0]] for v in column]
            places = spread([wanted[v.key] for v in column], steps, MARGIN, height - MARGIN)
            for vertex, y in zip(column, places, strict=True):
                vertex.y = y
    return height


def spread(wanted: Sequence[float], sizes: Sequence[float], low: float, high: float) -> list[float]:
    """The middles of boxes in this order that do not overlap, as near to the wanted ones as can be by least squares.

    Args:
        wanted: the middles, ascending.
        sizes: the heights.
        low: where the first may begin.
        high: where the last must end; there is room for all.
    """
    before = [sum(sizes[:i]) + size / 2 for i, size in enumerate(sizes)]
    starts = pooled([want - offset for want, offset in zip(wanted, before, strict=True)])
    limit = high - sum(sizes)
    return [min(max(start, low), max(limit, low)) + offset for start, offset in zip(starts, before, strict=True)]


def _path(source: Box, target: Box) -> str:
    """A curve from the right edge of one box to the left edge of the other; backwards ones swing out below."""
    x0, y0, x1, y1 = source.x + source.width, source.y, target.x, target.y
    if x1 > x0:
        reach = min((x1 - x0) * 0.5, 150.0)
        return f"M{x0:g} {y0:g}C{x0 + reach:g} {y0:g} {x1 - reach:g} {y1:g} {x1:g} {y1:g}"
    low = max(y0, y1) + 46.0
    return f"M{x0:g} {y0:g}C{x0 + 44:g} {low:g} {x1 - 44:g} {low:g} {x1:g} {y1:g}"
