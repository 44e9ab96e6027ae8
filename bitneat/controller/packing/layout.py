# SPDX-License-Identifier: MIT
"""Where a controller's values lie in the interpreter's workspace, and which features its blob needs.

The workspace is an array of int16 *slots*: the inputs, then (each only where needed) a slot that holds One, a slot that holds
0 and a slot for each delayed signal, then the nodes, then the outputs where they are not simply the last nodes. So the inputs
come first and the outputs last.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from bitneat.controller.activation import ACTIVATION_CODES
from bitneat.controller.ir import Controller, Node, Signal


@dataclass(frozen=True, slots=True, order=True)
class SlotLink:
    """A link as the packed form has it: the slot that is read, its shift and its sign."""

    slot: int
    shift: int
    sign: int


@dataclass(frozen=True)
class Layout:
    """The slots and features of a canonical controller; everything here follows from the controller alone."""

    controller: Controller

    @cached_property
    def num_inputs(self) -> int:
        """Inputs, which fill the first slots."""
        return len(self.controller.inputs)

    @cached_property
    def num_nodes(self) -> int:
        """Nodes, in as many slots from ``first_node``."""
        return len(self.controller.nodes)

    @cached_property
    def num_outputs(self) -> int:
        """Outputs, the last slots of the workspace."""
        return len(self.controller.outputs)

    @cached_property
    def has_ternary_bias(self) -> bool:
        """True iff biases exist and all are 0 or ±One: they are packed as links from the slot that holds One."""
        one = self.controller.one
        biases = {node.bias for node in self.controller.nodes} - {0}
        return bool(biases) and biases <= {one, -one}

    @cached_property
    def has_general_bias(self) -> bool:
        """True iff some bias is neither 0 nor ±One: every node then carries a bias field."""
        return not self.has_ternary_bias and any(node.bias for node in self.controller.nodes)

    @cached_property
    def has_empty_node(self) -> bool:
        """True iff a node has nothing to read: where each node ends with its last link, it then reads the slot of 0."""
        return any(not node.links and not (node.bias and self.has_ternary_bias) for node in self.controller.nodes)

    @cached_property
    def delayed(self) -> tuple[int, ...]:
        """The signals that some link reads delayed, ascending; their slots keep that order."""
        return tuple(sorted({link.source for node in self.controller.nodes for link in node.links if link.delay}))

    @cached_property
    def has_shifts(self) -> bool:
        """True iff some link has a shift."""
        return any(link.shift for node in self.controller.nodes for link in node.links)

    @cached_property
    def one_slot(self) -> int:
        """The slot of One, which exists iff ``has_ternary_bias``."""
        return self.num_inputs

    @cached_property
    def zero_slot(self) -> int:
        """The slot of 0, which exists iff ``has_empty_node``."""
        return self.one_slot + self.has_ternary_bias

    @cached_property
    def first_delayed(self) -> int:
        """The slot of the first delayed value."""
        return self.zero_slot + self.has_empty_node

    @cached_property
    def first_node(self) -> int:
        """The slot of the first node."""
        return self.first_delayed + len(self.delayed)

    @cached_property
    def num_slots(self) -> int:
        """Slots that links may read; the copies of the outputs are not among them."""
        return self.first_node + self.num_nodes

    @cached_property
    def has_output_map(self) -> bool:
        """True iff the outputs are not simply the last nodes in order, so that they are copied to the end."""
        last = [Signal(self.controller.num_signals - self.num_outputs + i) for i in range(self.num_outputs)]
        return self.num_outputs > self.num_nodes or list(self.controller.outputs) != last

    @cached_property
    def workspace_length(self) -> int:
        """Slots and, where ``has_output_map``, the copies of the outputs."""
        return self.num_slots + self.num_outputs * self.has_output_map

    @cached_property
    def activations(self) -> tuple[str, ...]:
        """The activations in use, by ascending code."""
        used = {node.activation for node in self.controller.nodes}
        return tuple(sorted(used, key=ACTIVATION_CODES.__getitem__))

    @cached_property
    def activation_bits(self) -> int:
        """Bits that tell one of ``activations`` from another."""
        return max(len(self.activations) - 1, 0).bit_length()

    @cached_property
    def min_gain(self) -> int:
        """The smallest gain, which the gain fields count from."""
        return min((node.gain for node in self.controller.nodes), default=0)

    @cached_property
    def gain_bits(self) -> int:
        """Bits of a gain field; 0 where all gains are equal."""
        return (max((node.gain for node in self.controller.nodes), default=0) - self.min_gain).bit_length()

    @cached_property
    def bias_width(self) -> int:
        """Bits of a general bias field in two's complement; 0 without general biases."""
        if not self.has_general_bias:
            return 0
        return max(max(node.bias, ~node.bias).bit_length() for node in self.controller.nodes) + 1

    @cached_property
    def slot_bits(self) -> int:
        """Bits that number any slot."""
        return max(self.num_slots - 1, 0).bit_length()

    @cached_property
    def record_bytes(self) -> int:
        """Bytes of a link record of the encoding ``bytes``: a slot, a shift where there are any, a sign, a last mark."""
        return -(-(self.slot_bits + 3 * self.has_shifts + 2) // 8)

    def slot_of(self, signal: int) -> int:
        """The slot of an input or node."""
        return signal if signal < self.num_inputs else signal - self.num_inputs + self.first_node

    @cached_property
    def _delayed_position(self) -> dict[int, int]:
        return {signal: position for position, signal in enumerate(self.delayed)}

    @cached_property
    def node_links(self) -> tuple[tuple[SlotLink, ...], ...]:
        """For each node its links by slot and shift, a ternary bias among them."""
        return tuple(self._links_of(node) for node in self.controller.nodes)

    def _links_of(self, node: Node) -> tuple[SlotLink, ...]:
        links = []
        for link in node.links:
            if link.delay:
                slot = self.first_delayed + self._delayed_position[link.source]
            else:
                slot = self.slot_of(link.source)
            links.append(SlotLink(slot, link.shift, link.sign))
        if node.bias and self.has_ternary_bias:
            links.append(SlotLink(self.one_slot, 0, 1 if node.bias > 0 else -1))
        return tuple(sorted(links))
