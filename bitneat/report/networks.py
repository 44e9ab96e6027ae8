# SPDX-License-Identifier: MIT
"""Networks as drawings: inputs on the left, outputs on the right, each node as far right as the longest path that leads to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bitneat.controller import Controller, Signal
from bitneat.network import FloatNetwork, Policy
from bitneat.report.figure import BLUE, GREY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Drawing:
    """Signals with their places in the unit square, and links between them with their signs."""

    places: dict[int, tuple[float, float]]
    links: tuple[tuple[int, int, int], ...]
    """(source, target, sign) each."""
    outputs: tuple[int, ...]
    num_inputs: int


def drawing(policy: Policy) -> Drawing:
    """Where each signal goes. Inputs that nothing reads are there too: one sees what was left out."""
    num_inputs, links = _links(policy)
    num_signals = num_inputs + len(policy.nodes)
    depth = [0] * num_signals
    for source, target, _ in links:  # by target, whose sources come before it
        depth[target] = max(depth[target], depth[source] + 1)
    outputs = tuple(_outputs(policy))
    last = max([depth[signal] for signal in outputs] + [1])
    for signal in outputs:
        if signal >= num_inputs:
            depth[signal] = last
    columns: dict[int, list[int]] = {}
    for signal in range(num_signals):
        column = depth[signal] if signal < num_inputs or depth[signal] else 1  # a constant stands with the first nodes
        columns.setdefault(column, []).append(signal)
    places = {}
    for column, signals in columns.items():
        for row, signal in enumerate(signals):
            places[signal] = (column / last, 1 - (row + 0.5) / len(signals))
    return Drawing(places, tuple(links), outputs, num_inputs)


def draw(axes: Axes, policy: Policy, title: str) -> None:
    """Draw a network: blue links add, vermilion ones subtract."""
    picture = drawing(policy)
    for source, target, sign in picture.links:
        (x0, y0), (x1, y1) = picture.places[source], picture.places[target]
        axes.plot([x0, x1], [y0, y1], color=BLUE if sign > 0 else VERMILION, linewidth=0.5, alpha=0.7, zorder=1)
    for signal, (x, y) in picture.places.items():
        is_input, is_output = signal < picture.num_inputs, signal in picture.outputs
        size = 8 if is_input else 26 if is_output else 16
        axes.scatter([x], [y], s=size, color=GREY if is_input else "black", marker="s" if is_input else "o", zorder=2)
    axes.set_title(title)
    axes.set_axis_off()
    axes.margins(0.06)


def _links(policy: Policy) -> tuple[int, list[tuple[int, int, int]]]:
    """The number of inputs, and undelayed links as (source, target, sign) in the order of the targets."""
    found: list[tuple[int, int, int]] = []
    if isinstance(policy, FloatNetwork):
        for index, node in enumerate(policy.nodes, start=policy.num_inputs):
            found += [(source, index, 1 if weight > 0 else -1) for source, weight in node.links if weight]
        return policy.num_inputs, found
    first = len(policy.inputs)
    for index, gate in enumerate(policy.nodes, start=first):
        found += [(link.source, index, link.sign) for link in gate.links if not link.delay]
    return first, found


def _outputs(policy: Policy) -> Sequence[int]:
    if isinstance(policy, Controller):
        return [output.index for output in policy.outputs if isinstance(output, Signal)]
    return policy.outputs
