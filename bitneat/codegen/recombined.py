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
class Recombined:
    """What the compiler must know nothing of, by the index of the node."""

    gains: frozenset[int]
    """Sums that a positive gain shifts."""
    links: frozenset[int]
    """Nodes whose shifted links are."""


@dataclass(frozen=True)
class _Form:
    """What a value is a linear form of, and the shifts on the way: each a node, and whether its gain (else a link of it) shifts."""

    reads: frozenset[Key]
    shifts: frozenset[tuple[int, bool]] = frozenset()


def recombined(controller: Controller, bounds: Sequence[NodeIntervals]) -> Recombined:
    """Find them; a node that reads one signal with several shifts is among them."""
    first = len(controller.inputs)
    forms: dict[int, _Form] = {}
    found: set[tuple[int, bool]] = set()
    for index, node in enumerate(controller.nodes):
        seen: dict[Key, frozenset[tuple[int, bool]]] = {}
        for link in node.links:
            own = _Form(frozenset({(link.source, link.delay)}))
            form = own if link.delay else forms.get(link.source, own)
            shifts = form.shifts | ({(index, False)} if link.shift else set())
            for key in form.reads:
                if key in seen:
                    found |= seen[key] | shifts
                seen[key] = seen.get(key, frozenset()) | shifts
        if node.activation == "identity" and node.gain >= 0 and bounds[index].scaled.magnitude <= SIGNAL_MAX:
            shifts = frozenset().union(*seen.values(), {(index, True)} if node.gain else set())
            forms[first + index] = _Form(frozenset(seen), shifts)
    return Recombined(
        frozenset(index for index, gain in found if gain), frozenset(index for index, gain in found if not gain)
    )
