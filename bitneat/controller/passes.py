# SPDX-License-Identifier: MIT
"""Rewrites that make a controller smaller and change no bit of any output of any input sequence from reset.

Each pass takes any valid controller and gives a canonical one. Inside a pass every node that is left keeps its whole sequence
of values, so several rewrites can be made on the strength of one interval analysis. A rewrite that would make a sum leave the
accumulator, give a ternary controller a weight that is not ternary, or put a second link beside an equal one does not apply;
a link that meets its own negation cancels with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from bitneat.controller.activation import output_limit, table
from bitneat.controller.canonical import rebuilt, renumbered
from bitneat.controller.interval import Interval, NodeIntervals, intervals
from bitneat.controller.ir import (
    ACCUMULATOR_MAX,
    GAIN_RANGE,
    SHIFT_RANGE,
    SIGNAL_MAX,
    Constant,
    Controller,
    Link,
    Node,
    Output,
    Signal,
)

Pass = Callable[[Controller], Controller]


def optimize(controller: Controller) -> Controller:
    """The smallest equivalent that the passes of this module find; canonical, and a fixed point of each of them."""
    current = controller.canonical
    while True:
        before = current
        for rewrite in PASSES:
            current = rewrite(current)
        if current == before:
            return current


def fold_constants(controller: Controller) -> Controller:
    """Turn nodes that have one value at every step into constants, and drop delayed links that can only read 0."""
    controller = controller.canonical
    bounds = intervals(controller).signals
    draft = _Draft(controller)
    for index, node in draft.numbered_nodes():
        low, high = bounds[index]
        if low == high and node.links:
            draft.redirect_outputs(index, Constant(low))
            # As in the canonical form: clamped where it fits, so that the declared limit of the node never grows.
            activation = "clamped" if abs(low) <= controller.one else "identity"
            draft.change(index, Node((), low, 0, activation))
    for index, node in draft.numbered_nodes():
        draft.change(index, replace(node, links=tuple(link for link in node.links if any(bounds[link.source]))))
    return draft.controller()


def drop_needless_saturation(controller: Controller) -> Controller:
    """Make a node the identity where its activation does nothing else to any argument it can get, or only negates it."""
    controller = controller.canonical
    draft = _Draft(controller)
    for (index, node), bounds in zip(draft.numbered_nodes(), intervals(controller).nodes, strict=True):
        if node.activation == "identity":
            continue
        if _acts_as(1, node, bounds.argument, controller.frac_bits):
            draft.change(index, replace(node, activation="identity"))
        elif node.gain >= 0 and _acts_as(-1, node, bounds.argument, controller.frac_bits):
            draft.change(index, replace(_negated(node), activation="identity"))
    return draft.controller()


def forward_copies(controller: Controller) -> Controller:
    """Let the readers of a node that only copies, negates, delays or shifts up one signal read that signal itself.

    A delayed reader may do so as well: the copy's previous value is the signal's previous value, and both are 0 after reset.
    """
    controller = controller.canonical
    draft = _Draft(controller)
    for (index, _), bounds in zip(draft.numbered_nodes(), intervals(controller).nodes, strict=True):
        # Its link may be another by now, but its sum is the one that the bounds speak of: so in the next two passes.
        copied = _copied_link(draft.node(index), bounds, controller.frac_bits)
        if copied is None:
            continue
        for reader in sorted(draft.readers[index]):
            for link in draft.node(reader).links:
                if link.source == index:
                    draft.substitute(reader, link, _expansion(link, (copied,)), 0)
        if (copied.delay, copied.shift, copied.sign) == (0, 0, 1):
            draft.redirect_outputs(index, Signal(copied.source))
    return draft.controller()


def inline_sums(controller: Controller) -> Controller:
    """Write a plain sum that only one link reads into its reader."""
    controller = controller.canonical
    draft = _Draft(controller)
    for (index, _), bounds in zip(draft.numbered_nodes(), intervals(controller).nodes, strict=True):
        link = draft.only_link_from(index)
        node = draft.node(index)
        if link is None or not _is_plain_sum(node, bounds, controller.frac_bits) or node.gain < 0:
            continue
        (reader,) = draft.readers[index]
        if link.delay and node.bias:
            continue  # the reader's first step has no bias in it
        terms = [replace(term, shift=term.shift + node.gain) for term in node.links]
        draft.substitute(reader, link, _expansion(link, terms), link.sign * (node.bias << (node.gain + link.shift)))
    return draft.controller()


def compose_gains(controller: Controller) -> Controller:
    """Let a node that does nothing but scale one plain sum, and is the only one to read it, take that sum over."""
    controller = controller.canonical
    draft = _Draft(controller)
    for (index, _), bounds in zip(draft.numbered_nodes(), intervals(controller).nodes, strict=True):
        link = draft.only_link_from(index)
        inner = draft.node(index)
        if link is None or not _is_plain_sum(inner, bounds, controller.frac_bits):
            continue
        (reader,) = draft.readers[index]
        outer = draft.node(reader)
        if reader == index or outer.links != (link,) or outer.bias or (link.delay and inner.bias):
            continue
        outer_gain = link.shift + outer.gain
        # Two floors make one only if nothing is shifted up or negated between them.
        if inner.gain < 0 and (outer_gain > 0 or link.sign < 0):
            continue
        links = _expansion(replace(link, shift=0), inner.links)
        gain = inner.gain + outer_gain
        if links is not None and GAIN_RANGE[0] <= gain <= GAIN_RANGE[1]:
            draft.change(reader, Node(tuple(links), link.sign * inner.bias, gain, outer.activation))
    return draft.controller()


def merge_duplicates(controller: Controller) -> Controller:
    """Let one node stand for all that compute the same.

    Two nodes are the same if they differ in nothing but which of several same nodes they read. That holds around loops too:
    all state starts from 0, so what is equal after one step is equal after the next.
    """
    controller = controller.canonical
    draft = _Draft(controller)
    first: dict[int, int] = {}
    for index, group in enumerate(_equal_signals(controller)):
        original = first.setdefault(group, index)
        if original == index:
            continue
        for reader in sorted(draft.readers[index]):
            for link in draft.node(reader).links:
                if link.source == index:
                    draft.substitute(reader, link, [replace(link, source=original)], 0)
        draft.redirect_outputs(index, Signal(original))
    return draft.controller()


def order_depth_first(controller: Controller) -> Controller:
    """Put each node right after what it alone still waits for: depth first from the outputs, each node's sources in order.

    In straight-line code fewer values then wait to be read, and more of them in registers. It is not one of the passes, since it
    neither drops nor changes a node; the order of the outputs' nodes may change too.
    """
    controller = controller.canonical
    first = len(controller.inputs)
    order: dict[int, None] = {}
    roots = [output.index for output in controller.outputs if isinstance(output, Signal)]
    stack = [*range(controller.num_signals - 1, first - 1, -1), *reversed(roots)]
    while stack:
        index = stack.pop()
        if index < first or index in order:
            continue
        sources = [link.source for link in controller.nodes[index - first].links if not link.delay]
        waiting = [source for source in dict.fromkeys(sources) if source >= first and source not in order]
        if waiting:
            stack += [index, *reversed(waiting)]
        else:
            order[index] = None
    number = {i: i for i in range(first)} | {index: first + position for position, index in enumerate(order)}
    nodes = [renumbered(controller.nodes[index - first], number) for index in order]
    outputs = [Signal(number[output.index]) if isinstance(output, Signal) else output for output in controller.outputs]
    return rebuilt(controller, nodes, outputs)


PASSES: tuple[Pass, ...] = (
    fold_constants,
    drop_needless_saturation,
    forward_copies,
    inline_sums,
    compose_gains,
    merge_duplicates,
)
"""All passes, in the order in which `optimize` applies them again and again."""


class _Draft:
    """A controller being rewritten; refuses a node that breaks a rule of this module."""

    def __init__(self, controller: Controller) -> None:
        self._original = controller
        self._ternary = controller.is_ternary
        self._first = len(controller.inputs)
        self._nodes = list(controller.nodes)
        self._outputs: list[Output] = list(controller.outputs)
        self.readers: dict[int, set[int]] = {index: set() for index in range(controller.num_signals)}
        """The nodes (as signal numbers) that read each signal."""
        for index, node in self.numbered_nodes():
            for link in node.links:
                self.readers[link.source].add(index)

    def numbered_nodes(self) -> list[tuple[int, Node]]:
        """Every node with its signal number, as they are now."""
        return list(enumerate(self._nodes, start=self._first))

    def node(self, index: int) -> Node:
        return self._nodes[index - self._first]

    def controller(self) -> Controller:
        """What has become of it, or the original if constants that come together are no ternary bias any more."""
        if tuple(self._nodes) == self._original.nodes and tuple(self._outputs) == self._original.outputs:
            return self._original
        result = rebuilt(self._original, self._nodes, self._outputs).canonical
        return result if result.is_ternary or not self._ternary else self._original

    def change(self, index: int, node: Node) -> bool:
        """Put another node in the place of one, if the rules allow it; says whether it did."""
        old = self.node(index)
        if node == old or not self._is_allowed(index, node):
            return node == old
        self._nodes[index - self._first] = node
        for link in old.links:
            self.readers[link.source].discard(index)
        for link in node.links:
            self.readers[link.source].add(index)
        return True

    def substitute(self, reader: int, link: Link, terms: Iterable[Link] | None, bias: int) -> bool:
        """Replace one link of a node by other links and a bias; None stands for links that cannot be."""
        node = self.node(reader)
        if terms is None:
            return False
        signs = {(other.source, other.delay, other.shift): other.sign for other in node.links if other != link}
        for term in terms:
            key = (term.source, term.delay, term.shift)
            if signs.get(key) == term.sign:
                return False
            if key in signs:
                del signs[key]
            else:
                signs[key] = term.sign
        links = tuple(Link(*key, sign) for key, sign in signs.items())
        return self.change(reader, replace(node, links=links, bias=node.bias + bias))

    def redirect_outputs(self, old: int, new: Output) -> None:
        self._outputs = [new if output == Signal(old) else output for output in self._outputs]

    def only_link_from(self, index: int) -> Link | None:
        """The link that reads a signal, if there is just one and no output names the signal."""
        if Signal(index) in self._outputs or len(self.readers[index]) != 1:
            return None
        (reader,) = self.readers[index]
        links = [link for link in self.node(reader).links if link.source == index]
        return links[0] if len(links) == 1 else None

    def _is_allowed(self, index: int, node: Node) -> bool:
        one = self._original.one
        if self._ternary and (abs(node.bias) not in (0, one) or any(link.shift for link in node.links)):
            return False
        limit = output_limit(node.activation, self._original.frac_bits)
        grows = limit > output_limit(self.node(index).activation, self._original.frac_bits)
        changed = {index: limit}
        affected = [node, *(self.node(i) for i in self.readers[index] if i != index)] if grows else [node]
        return all(self._fits(candidate, changed) for candidate in affected)

    def _fits(self, node: Node, changed: Mapping[int, int]) -> bool:
        total = abs(node.bias) + sum(self._limit(link.source, changed) << link.shift for link in node.links)
        return total << max(node.gain, 0) <= ACCUMULATOR_MAX

    def _limit(self, index: int, changed: Mapping[int, int]) -> int:
        if index in changed:
            return changed[index]
        if index < self._first:
            return self._original.inputs[index].limit
        return output_limit(self.node(index).activation, self._original.frac_bits)


def _acts_as(sign: int, node: Node, argument: Interval, frac_bits: int) -> bool:
    """Whether the node's activation gives ``sign`` times its argument, all over an interval."""
    if node.activation == "identity":
        return sign > 0 or argument == (0, 0)
    if node.activation == "clamped":
        return argument.magnitude <= 1 << frac_bits if sign > 0 else argument == (0, 0)
    import numpy as np

    arguments = np.arange(argument.low, argument.high + 1)
    values = table(node.activation, frac_bits)[argument.low + SIGNAL_MAX : argument.high + SIGNAL_MAX + 1]
    return bool((values == sign * arguments).all())


def _is_plain_sum(node: Node, bounds: NodeIntervals, frac_bits: int) -> bool:
    """Whether the node's value is its sum after the gain: never clipped, nor changed by the activation."""
    return bounds.scaled.magnitude <= SIGNAL_MAX and _acts_as(1, node, bounds.argument, frac_bits)


def _copied_link(node: Node, bounds: NodeIntervals, frac_bits: int) -> Link | None:
    """The one link that the node's value is exactly worth, if there is such a link."""
    if len(node.links) != 1 or node.bias or not _is_plain_sum(node, bounds, frac_bits):
        return None
    (link,) = node.links
    shift = link.shift + node.gain
    return replace(link, shift=shift) if shift >= 0 else None


def _expansion(link: Link, terms: Iterable[Link]) -> list[Link] | None:
    """What ``link`` reads if its source is the sum of ``terms``; None if a delay or a shift is out of range."""
    result = []
    for term in terms:
        delay, shift = link.delay + term.delay, link.shift + term.shift
        if delay > 1 or shift > SHIFT_RANGE[1]:
            return None
        result.append(Link(term.source, delay, shift, link.sign * term.sign))
    return result


def _negated(node: Node) -> Node:
    return replace(node, links=tuple(replace(link, sign=-link.sign) for link in node.links), bias=-node.bias)


def _equal_signals(controller: Controller) -> list[int]:
    """A number for each signal, the same for those that are always equal: the coarsest partition that the links respect."""
    first = len(controller.inputs)
    groups = [*range(first), *([first] * len(controller.nodes))]
    count = 0
    while count != len(set(groups)):
        count = len(set(groups))
        known: dict[object, int] = {}
        refined = list(range(first))
        for index, node in enumerate(controller.nodes, start=first):
            links = tuple(sorted(replace(link, source=groups[link.source]) for link in node.links))
            definition = (groups[index], node.activation, node.gain, node.bias, links)
            refined.append(known.setdefault(definition, first + len(known)))
        groups = refined
    return groups
