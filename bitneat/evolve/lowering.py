# SPDX-License-Identifier: MIT
"""From genome to controller."""

from __future__ import annotations

import heapq
from collections.abc import Iterable

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.ir import ACCUMULATOR_MAX, Constant
from bitneat.evolve.genome import BitConnectionGene, BitGenome

_UNBOUNDED = frozenset({"identity", "relu", "abs"})


def lower(genome: BitGenome, inputs: tuple[Input, ...], num_outputs: int, frac_bits: int) -> Controller:
    """The canonical controller that a genome stands for.

    Links that are disabled or of weight zero are absent. A hidden node that no input reaches is absent too, with its links:
    neat-python would make it a constant nobody asked for. An output without links is the constant that its bias gives.
    A gain that could carry a node's sum beyond the accumulator is lowered to the largest that cannot.
    """
    links = [link for link in genome.connections.values() if link.counts]
    alive = _reached_from_inputs(links) | set(range(num_outputs))
    links = [link for link in links if link.key[1] in alive and (link.key[0] < 0 or link.key[0] in alive)]
    order = _evaluation_order(alive & set(genome.nodes), links, num_outputs)
    first_node = len(inputs)
    number = {-1 - index: index for index in range(first_node)}
    number.update({key: first_node + position for position, key in enumerate(order)})
    one = 1 << frac_bits
    reach = {-1 - index: entry.limit for index, entry in enumerate(inputs)}
    for key in order:
        reach[key] = 32767 if genome.nodes[key].activation in _UNBOUNDED else one
    into: dict[int, list[BitConnectionGene]] = {key: [] for key in order}
    for link in links:
        into[link.key[1]].append(link)
    nodes = []
    for key in order:
        gene = genome.nodes[key]
        total = abs(gene.bias) * one + sum(reach[link.key[0]] for link in into[key])
        gain = gene.gain
        while gain > 0 and total << gain > ACCUMULATOR_MAX:
            gain -= 1
        sources = sorted(Link(number[link.key[0]], link.delay, 0, link.weight) for link in into[key])
        nodes.append(Node(tuple(sources), gene.bias * one, gain, gene.activation))
    outputs = tuple(Signal(number[key]) for key in range(num_outputs))
    return Controller(inputs, tuple(nodes), outputs, frac_bits).canonical


def has_path(controller: Controller) -> bool:
    """True iff some output depends on an input; the controller must be canonical."""
    return any(not isinstance(output, Constant) for output in controller.outputs)


def _reached_from_inputs(links: Iterable[BitConnectionGene]) -> set[int]:
    """The nodes that depend on an input, now or through delayed links."""
    readers: dict[int, list[int]] = {}
    for link in links:
        readers.setdefault(link.key[0], []).append(link.key[1])
    pending = [source for source in readers if source < 0]
    reached: set[int] = set()
    while pending:
        for reader in readers.get(pending.pop(), ()):
            if reader not in reached:
                reached.add(reader)
                pending.append(reader)
    return reached


def _evaluation_order(keys: set[int], links: Iterable[BitConnectionGene], num_outputs: int) -> list[int]:
    """Topological order over undelayed links, hidden nodes by key and the outputs last.

    No undelayed link leaves an output, so that the outputs can wait for all hidden nodes; the canonical order then ends with them.
    """
    readers: dict[int, list[int]] = {key: [] for key in keys}
    waiting_for = dict.fromkeys(keys, 0)
    for link in links:
        source, target = link.key
        if source >= 0 and not link.delay:
            readers[source].append(target)
            waiting_for[target] += 1
    ready = [(key < num_outputs, key) for key in keys if not waiting_for[key]]
    heapq.heapify(ready)
    order = []
    while ready:
        _, key = heapq.heappop(ready)
        order.append(key)
        for reader in readers[key]:
            waiting_for[reader] -= 1
            if not waiting_for[reader]:
                heapq.heappush(ready, (reader < num_outputs, reader))
    return order
