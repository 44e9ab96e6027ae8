# SPDX-License-Identifier: MIT
"""The canonical form of a controller, and its fingerprint.

Two controllers that differ only in dead nodes, constants that can be folded, or the order of links have the same canonical form,
and so the same SHA-256, the same packed blob and the same C. The order of the nodes is kept where their links allow it, so that
outputs that come last stay last; it is part of the content.
"""

from __future__ import annotations

import hashlib
import heapq
import json
from collections.abc import Iterable, Mapping

from bitneat.controller.activation import ACTIVATION_CODES
from bitneat.controller.ir import Constant, Controller, Link, Node, Output, Signal
from bitneat.controller.reference import node_value


def canonicalize(controller: Controller) -> Controller:
    """Fold constants, drop what no output needs, and put nodes and links in canonical order.

    A node is constant iff it has no delayed link and all its sources are constant. It disappears into the biases of those who
    read it undelayed; a delayed reader sees 0 once before it sees the constant, so for that reader it stays, as a node with
    nothing but a bias.
    """
    folded = _fold_constants(controller)
    return _in_order(folded, _needed(folded))


def fingerprint(canonical: Controller) -> str:
    """SHA-256 of a canonical controller's numbers, as `docs/file-formats.md` lays them out."""
    numbers = [
        1,
        canonical.frac_bits,
        [[entry.scale, entry.limit] for entry in canonical.inputs],
        [
            [
                ACTIVATION_CODES[node.activation],
                node.gain,
                node.bias,
                [[link.source, link.delay, link.shift, link.sign] for link in node.links],
            ]
            for node in canonical.nodes
        ],
        [[0, output.index] if isinstance(output, Signal) else [1, output.value] for output in canonical.outputs],
    ]
    return hashlib.sha256(json.dumps(numbers, separators=(",", ":")).encode("ascii")).hexdigest()


def rebuilt(controller: Controller, nodes: Iterable[Node], outputs: Iterable[Output]) -> Controller:
    """The controller with other nodes and outputs."""
    return Controller(controller.inputs, tuple(nodes), tuple(outputs), controller.frac_bits)


def _fold_constants(controller: Controller) -> Controller:
    first_node = len(controller.inputs)
    constants: dict[int, int] = {}
    nodes: list[Node] = []
    for index, node in enumerate(controller.nodes, start=first_node):
        bias = node.bias
        links = []
        for link in node.links:
            if not link.delay and link.source in constants:
                bias += link.sign * (constants[link.source] << link.shift)
            else:
                links.append(link)
        if links:
            nodes.append(Node(tuple(links), bias, node.gain, node.activation))
        else:
            value = node_value(Node((), bias, node.gain, node.activation), (), (), controller.frac_bits)
            constants[index] = value
            # Clamped where it fits, so that the node's declared limit never grows and no reader's sum with it.
            nodes.append(Node((), value, 0, "clamped" if abs(value) <= controller.one else "identity"))
    outputs = [
        Constant(constants[output.index]) if isinstance(output, Signal) and output.index in constants else output
        for output in controller.outputs
    ]
    return rebuilt(controller, nodes, outputs)


def _needed(controller: Controller) -> list[int]:
    """The nodes (as signal numbers) that some output depends on, now or through delayed links."""
    first_node = len(controller.inputs)
    pending = [output.index for output in controller.outputs if isinstance(output, Signal)]
    needed: set[int] = set()
    while pending:
        index = pending.pop()
        if index >= first_node and index not in needed:
            needed.add(index)
            pending.extend(link.source for link in controller.nodes[index - first_node].links)
    return sorted(needed)


def _in_order(controller: Controller, needed: list[int]) -> Controller:
    """Renumber the needed nodes: Kahn's order over undelayed links, the smallest old number first."""
    first_node = len(controller.inputs)
    by_index = {index: controller.nodes[index - first_node] for index in needed}
    readers: dict[int, list[int]] = {index: [] for index in needed}
    waiting_for = dict.fromkeys(needed, 0)
    for index, node in by_index.items():
        for source in {link.source for link in node.links if not link.delay and link.source >= first_node}:
            readers[source].append(index)
            waiting_for[index] += 1
    ready = [index for index in needed if not waiting_for[index]]  # ascending, and so a heap
    order: list[int] = []
    while ready:
        index = heapq.heappop(ready)
        order.append(index)
        for reader in readers[index]:
            waiting_for[reader] -= 1
            if not waiting_for[reader]:
                heapq.heappush(ready, reader)
    number: dict[int, int] = {i: i for i in range(first_node)}
    number.update({index: first_node + position for position, index in enumerate(order)})
    nodes = [renumbered(by_index[index], number) for index in order]
    outputs = [Signal(number[output.index]) if isinstance(output, Signal) else output for output in controller.outputs]
    return rebuilt(controller, nodes, outputs)


def renumbered(node: Node, number: Mapping[int, int]) -> Node:
    """The node with its sources renamed and its links sorted."""
    links = sorted(Link(number[link.source], link.delay, link.shift, link.sign) for link in node.links)
    return Node(tuple(links), node.bias, node.gain, node.activation)
