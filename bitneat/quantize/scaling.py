# SPDX-License-Identifier: MIT
"""Bringing the values of a float network into the range of signals, where that changes nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from bitneat.network import FloatNetwork

HOMOGENEOUS = ("identity", "relu", "abs")
"""Activations f with f(s z) = s f(z) for every s > 0; the others have a range of their own."""


def rescaled(network: FloatNetwork, peaks: Sequence[float], largest: float, *, only_order: bool) -> FloatNetwork:
    """The network with each node whose activation is homogeneous scaled by a power of two, and its readers by the inverse.

    So the values of a node that is large anywhere fit a signal, and those of one that is always small use more of it.

    Args:
        network: any.
        peaks: the largest size of each node's value, in runs that are typical; of shape (nodes,).
        largest: what scaled peaks are to be at most, and more than half of which they are.
        only_order: whether only the order of the outputs matters, so that one factor may scale them all. If not, outputs are left
            alone.

    Returns:
        A network with the same outputs up to rounding, but for that factor.
    """
    first = network.num_inputs
    down = [
        0 if f not in HOMOGENEOUS else _exponent(peak, largest) for f, peak in zip(_names(network), peaks, strict=True)
    ]
    outputs = [index - first for index in network.outputs]
    common = 0
    if only_order and all(place >= 0 and network.nodes[place].activation in HOMOGENEOUS for place in outputs):
        common = _exponent(max(peaks[place] for place in outputs), largest)
    for place in outputs:
        if place >= 0:
            down[place] = common
    nodes = []
    for node, shift in zip(network.nodes, down, strict=True):
        links = tuple((s, math.ldexp(w, down[s - first] if s >= first else 0)) for s, w in node.links)
        factor = math.ldexp(1.0, -shift)
        nodes.append(replace(node, links=links, bias=node.bias * factor, response=node.response * factor))
    return replace(network, nodes=tuple(nodes))


def _names(network: FloatNetwork) -> list[str]:
    return [node.activation for node in network.nodes]


def _exponent(peak: float, largest: float) -> int:
    """The e such that peak / 2^e is at most the largest and more than half of it; 0 if there is no peak."""
    if not peak:
        return 0
    mantissa, power = math.frexp(peak / largest)
    return max(-30, min(30, power - 1 if mantissa == 0.5 else power))
