# SPDX-License-Identifier: MIT
"""A controller while it is put together from the nodes of something else and helper nodes.

What is translated numbers its signals in its own way; `Draft` lets helper nodes stand between them and gives everything its final
number at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bitneat.controller import Controller, ControllerError, Input, Link, Node, Output, Signal
from bitneat.controller.digits import signed_powers
from bitneat.controller.ir import GAIN_RANGE, SIGNAL_MAX
from bitneat.errors import BitneatError

LARGEST_POWER = SIGNAL_MAX.bit_length() - 1
"""The largest power of two that is a signal."""
_MOST_COPIES = 1024


class QuantizeError(BitneatError):
    """A network has no controller of the kind asked for."""


Key = tuple[str, int]
"""A signal of the draft: ("source", its number in what is translated) or ("helper", a running number)."""


@dataclass
class DraftNode:
    """A node whose links all have weight ±1."""

    links: dict[tuple[Key, int], int] = field(default_factory=dict)
    """Sign by source and delay."""
    bias: int = 0
    gain: int = 0
    activation: str = "identity"


class Draft:
    """Nodes in evaluation order.

    Args:
        inputs: of the controller; they are its sources 0, 1, ….
        frac_bits: F.
        anchor: the input that the constant one is made from.
    """

    def __init__(self, inputs: Sequence[Input], frac_bits: int, anchor: int = 0) -> None:
        self._inputs = tuple(inputs)
        self.frac_bits = frac_bits
        self._anchor = anchor
        self._constants: dict[tuple[int, int], Key] = {}
        self._ones: list[tuple[Key, DraftNode]] = []
        self._nodes: list[tuple[Key, DraftNode]] = []
        self._helpers = 0

    @property
    def one(self) -> int:
        """2^F."""
        return 1 << self.frac_bits

    def place(self, source: int, node: DraftNode) -> None:
        """Append the translation of a node."""
        self._nodes.append((("source", source), node))

    def helper(self, node: DraftNode) -> Key:
        """Append a helper node."""
        key = self._new_key()
        self._nodes.append((key, node))
        return key

    def constants(self, value: int) -> dict[Key, int]:
        """Signals that are constant and, with the signs given, add up to an integer.

        A node without links is a constant and becomes part of its readers' biases, which then are not ternary. So the constant
        one is ``step(|x| + 1)`` of some input x: it reads something, and is 1 whatever that is. The others are scaled from it.

        Raises:
            QuantizeError: if there would be more than a thousand of them.
        """
        largest = 1 << LARGEST_POWER
        copies = (value + largest // 2) >> LARGEST_POWER
        if abs(copies) > _MOST_COPIES:
            raise QuantizeError(f"a bias of {value} units is too large for links of weight 1")
        rest = {self._constant(power, 0): sign for power, sign in signed_powers(value - copies * largest)}
        rest.update({self._constant(LARGEST_POWER, copy): 1 if copies > 0 else -1 for copy in range(abs(copies))})
        return rest

    def controller(self, outputs: Sequence[Output]) -> Controller:
        """The canonical controller, with outputs in the numbering of what is translated.

        Raises:
            QuantizeError: if it breaks a rule of controllers.
        """
        order = [*self._ones, *self._nodes]
        number: dict[Key, int] = {("source", index): index for index in range(len(self._inputs))}
        number.update({key: len(self._inputs) + place for place, (key, _) in enumerate(order)})
        nodes = (Node(_links(node.links, number), node.bias, node.gain, node.activation) for _, node in order)
        renamed = (Signal(number["source", o.index]) if isinstance(o, Signal) else o for o in outputs)
        try:
            return Controller(self._inputs, tuple(nodes), tuple(renamed), self.frac_bits).canonical
        except ControllerError as error:
            raise QuantizeError(f"has no such controller: {error}") from None

    def _constant(self, power: int, copy: int) -> Key:
        if (power, copy) not in self._constants:
            self._constants[power, copy] = self._make_constant(power, copy)
        return self._constants[power, copy]

    def _make_constant(self, power: int, copy: int) -> Key:
        if (power, copy) == (self.frac_bits, 0):
            size = self._append_constant(DraftNode({(("source", self._anchor), 0): 1}, 0, 0, "abs"))
            return self._append_constant(DraftNode({(size, 0): 1}, self.one, 0, "step"))
        gain = power - self.frac_bits
        if gain < GAIN_RANGE[0]:
            scaled = self._constant(power - GAIN_RANGE[0], 0)
            return self._append_constant(DraftNode({(scaled, 0): 1}, 0, GAIN_RANGE[0]))
        if gain > GAIN_RANGE[1]:
            scaled = self._constant(power - GAIN_RANGE[1], 0)
            return self._append_constant(DraftNode({(scaled, 0): 1}, 0, GAIN_RANGE[1]))
        return self._append_constant(DraftNode({(self._constant(self.frac_bits, 0), 0): 1}, 0, gain))

    def _append_constant(self, node: DraftNode) -> Key:
        key = self._new_key()
        self._ones.append((key, node))
        return key

    def _new_key(self) -> Key:
        self._helpers += 1
        return "helper", self._helpers


def _links(links: Mapping[tuple[Key, int], int], number: Mapping[Key, int]) -> tuple[Link, ...]:
    return tuple(sorted(Link(number[source], delay, 0, sign) for (source, delay), sign in links.items()))
