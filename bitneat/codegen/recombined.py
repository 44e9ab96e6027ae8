# SPDX-License-Identifier: MIT
"""Which shifts a compiler could make multiplications of, because their operand comes to the same sum on another way, too.

A node that only adds and shifts, neither clipped nor bent by its activation, is a linear form of what it reads. Where a sum gets a
signal x by itself and twice x through such a node, a compiler may see 3 x, and multiply.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bitneat.controller import Controller
from bitneat.controller.interval import NodeIntervals
from bitneat.controller.ir import SIGNAL_MAX

Key = tuple[int, int]
"""A signal, and by how many steps it is delayed."""


@dataclass(frozen=True)
class _Form:
    """What a value is a linear form of, and the nodes whose shifts are on the way."""

    reads: frozenset[Key]
    shifts: frozenset[int]


def recombined(controller: Controller, bounds: Sequence[NodeIntervals]) -> frozenset[int]:
    """Indices of the nodes of positive gain whose sums the compiler must know nothing of."""
    first = len(controller.inputs)
    forms: dict[int, _Form] = {}
    found: set[int] = set()
    for index, node in enumerate(controller.nodes):
        seen: dict[Key, frozenset[int]] = {}
        for link in node.links:
            own = _Form(frozenset({(link.source, link.delay)}), frozenset())
            form = own if link.delay else forms.get(link.source, own)
            for key in form.reads:
                if key in seen:
                    found |= seen[key] | form.shifts
                seen[key] = seen.get(key, frozenset()) | form.shifts
        if node.activation == "identity" and node.gain >= 0 and bounds[index].scaled.magnitude <= SIGNAL_MAX:
            shifts = frozenset().union(*seen.values()) | ({index} if node.gain else frozenset())
            forms[first + index] = _Form(frozenset(seen), shifts)
    return frozenset(found)
