# SPDX-License-Identifier: MIT
"""What a controller computes, as terms: the other side of the equation.

Each value on the way that is not a plain sum (a floor shift, a clip, an activation) becomes an atom of its own, a *cut point*:
an unknown integer within bounds, with the sum that it comes from and the function that makes it. Proofs go from cut to cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller
from bitneat.controller.activation import PROGRAMS, Program, constant, table
from bitneat.controller.activation import Op as Step
from bitneat.controller.interval import Interval, image, intervals
from bitneat.controller.ir import SIGNAL_MAX, Constant, Node
from bitneat.prove.terms import Atom, Op, Term, Terms, signed_values, values_of

IntArray = npt.NDArray[np.int64]

WORD = 32
"""Bits in which the reference is written down: every value of it fits, by validation of the controller."""


Kind = Literal["limit", "floor", "clip", "activation", "sum"]


@dataclass(frozen=True, eq=False)
class Cut:
    """A value of the reference at which a proof can rest.

    Args:
        value: as later values see it: the atom that stands for it, or the sum that it is.
        kind: what made it.
        argument: what it is made from: a sum of atoms, of `WORD` bits.
        definition: the function's value as a term of `WORD` bits in the argument.
        function: the same on an array of integers, straight from the semantics.
    """

    value: Term
    kind: Kind
    argument: Term
    definition: Term
    function: Callable[[IntArray], IntArray]


@dataclass
class Model:
    """A controller as terms of `WORD` bits."""

    controller: Controller
    inputs: list[Atom]
    """As they arrive."""
    previous: list[Atom]
    """Each signal at the end of the step before, in any state that can be reached."""
    cuts: list[Cut] = field(default_factory=list)
    """Those that have an atom, each after those it needs."""
    sums: list[Cut] = field(default_factory=list)
    """Sums on the way, which compilers may make of more than additions."""
    signals: list[Term] = field(default_factory=list)
    outputs: list[Term] = field(default_factory=list)

    def samples(self, inputs: IntArray, previous: IntArray) -> dict[Atom, IntArray]:
        """Values of all atoms.

        Args:
            inputs: (samples, inputs).
            previous: (samples, signals).
        """
        values: dict[Atom, IntArray] = dict(zip(self.inputs, inputs.T, strict=True))
        values |= dict(zip(self.previous, previous.T, strict=True))
        for cut in self.cuts:
            argument = values_of([cut.argument], values)[0]
            assert cut.value.atom is not None
            values[cut.value.atom] = cut.function(np.broadcast_to(signed_values(argument, WORD), len(inputs)))
        return values


def build(terms: Terms, controller: Controller, *, guard: bool) -> Model:
    """A controller as terms, on its declared domain.

    Args:
        terms: where terms are made.
        controller: which.
        guard: whether inputs may be any int16, and are clipped to their limits first.
    """
    reach = _reachable(controller)
    inputs = [
        Atom(f"observation[{i}]", -32768 if guard else -entry.limit, 32767 if guard else entry.limit)
        for i, entry in enumerate(controller.inputs)
    ]
    previous = [Atom(f"previous[{i}]", bounds.low, bounds.high) for i, bounds in enumerate(reach)]
    builder = _Builder(terms, Model(controller, inputs, previous))
    builder.run(guard=guard)
    model = builder.model
    for signal, bounds in zip(model.signals, reach, strict=True):
        # Induction: whatever held before a step holds after it.
        assert bounds.low <= signal.low
        assert signal.high <= bounds.high
    return model


def _reachable(controller: Controller) -> list[Interval]:
    """Bounds of each signal at the end of any step, and at reset, that hold after a step if they held before it."""
    zero = Interval(0, 0)
    return [zero.hull(bounds) for bounds in intervals(controller).signals]


class _Builder:
    def __init__(self, terms: Terms, model: Model) -> None:
        self.terms, self.model = terms, model
        self._known: dict[Term, Term] = {}

    def run(self, *, guard: bool) -> None:
        terms, model = self.terms, self.model
        controller = model.controller
        for atom, entry in zip(model.inputs, controller.inputs, strict=True):
            arrived = terms.var(atom, WORD)
            model.signals.append(self._clip(arrived, entry.limit, "limit") if guard else arrived)
        for node in controller.nodes:
            model.signals.append(self._node(node))
        model.outputs.extend(
            terms.const(WORD, output.value) if isinstance(output, Constant) else model.signals[output.index]
            for output in controller.outputs
        )

    def _node(self, node: Node) -> Term:
        terms, model = self.terms, self.model
        pieces = [terms.const(WORD, node.bias)]
        for link in node.links:
            source = terms.var(model.previous[link.source], WORD) if link.delay else model.signals[link.source]
            pieces.append(terms.times(source, link.sign << link.shift))
        total = terms.add(*pieces)
        if node.gain >= 0:
            scaled = terms.times(total, 1 << node.gain)
            self._sum(scaled)
        else:
            scaled = self._cut("floor", total, terms.ashr(total, -node.gain), _floor(-node.gain))
        argument = self._clip(scaled, SIGNAL_MAX, "clip")
        return self._activation(argument, node.activation, model.controller.frac_bits)

    def _clip(self, term: Term, limit: int, kind: Kind) -> Term:
        terms = self.terms
        if -limit <= term.low and term.high <= limit:
            return term
        low, high = terms.const(WORD, -limit), terms.const(WORD, limit)
        capped = terms.ite(terms.slt(term, high), term, high)
        definition = terms.ite(terms.slt(capped, low), low, capped)
        return self._cut(kind, term, definition, _clipping(limit))

    def _activation(self, argument: Term, name: str, frac_bits: int) -> Term:
        check_activation(name, frac_bits)
        definition = activation_term(self.terms, PROGRAMS[name], argument, frac_bits)
        bounds = image(name, Interval(argument.low, argument.high), frac_bits)
        return self._cut("activation", argument, definition, partial(PROGRAMS[name], frac_bits=frac_bits), bounds)

    def _sum(self, value: Term) -> None:
        if value.op is Op.LIN and value not in self._known:
            self._known[value] = value
            self.model.sums.append(Cut(value, "sum", value, value, lambda values: values))

    def _cut(
        self,
        kind: Kind,
        argument: Term,
        definition: Term,
        function: Callable[[IntArray], IntArray],
        bounds: Interval | None = None,
    ) -> Term:
        """The value, an atom of its own unless it is a plain sum after all or stands somewhere already."""
        if definition.op in (Op.CONST, Op.VAR) or (
            definition.op is Op.LIN and all(part.op is Op.VAR for part in definition.args)
        ):
            self._sum(definition)
            return definition
        if definition not in self._known:
            low, high = (definition.low, definition.high) if bounds is None else bounds
            atom = Atom(f"{kind}{len(self.model.cuts)}", low, high)
            value = self._known[definition] = self.terms.var(atom, WORD)
            self.model.cuts.append(Cut(value, kind, argument, definition, function))
        return self._known[definition]


def _floor(places: int) -> Callable[[IntArray], IntArray]:
    return lambda values: values >> places


def _clipping(limit: int) -> Callable[[IntArray], IntArray]:
    return lambda values: np.clip(values, -limit, limit)


def activation_term(terms: Terms, program: Program, argument: Term, frac_bits: int) -> Term:
    """An activation's description as a term; `check_activation` shows that no step of it wraps."""
    values = [argument]
    width = argument.width
    for step in program.steps:
        x, y = values[step.x], values[step.y]
        values.append(_step_term(terms, step.op, x, y, step.k, constant(step, frac_bits), width, frac_bits))
    return values[-1]


def _step_term(terms: Terms, op: Step, x: Term, y: Term, k: int, number: int, width: int, frac_bits: int) -> Term:
    match op:
        case Step.CONST | Step.INT:
            return terms.const(width, number)
        case Step.ADD:
            return terms.add(x, y)
        case Step.SUB:
            return terms.sub(x, y)
        case Step.SHL:
            return terms.shl(x, k)
        case Step.SHR:
            return terms.ashr(x, k)
        case Step.SHL_F:
            return terms.shl(x, frac_bits)
        case Step.LOW:
            return terms.bit_and(x, terms.const(width, (1 << (frac_bits + k)) - 1))
        case Step.BIT:
            return terms.bit_and(x, terms.const(width, 1 << (frac_bits + k)))
        case Step.MIN:
            return terms.ite(terms.slt(x, y), x, y)
        case Step.MAX:
            return terms.ite(terms.slt(x, y), y, x)
        case Step.COPYSIGN:
            return terms.ite(terms.slt(y, terms.const(width, 0)), terms.neg(x), x)


@cache
def check_activation(name: str, frac_bits: int) -> None:
    """Show that the term of an activation is the activation: at each of its 65,535 arguments.

    Raises:
        AssertionError: if it is not, which is a bug of this module.
    """
    terms = Terms()
    argument = Atom("u", -SIGNAL_MAX, SIGNAL_MAX)
    term = activation_term(terms, PROGRAMS[name], terms.var(argument, WORD), frac_bits)
    every = np.arange(-SIGNAL_MAX, SIGNAL_MAX + 1, dtype=np.int64)
    found = signed_values(values_of([term], {argument: every})[0], WORD)
    if not np.array_equal(np.broadcast_to(found, every.shape), table(name, frac_bits)):
        raise AssertionError(f"the term of {name} at F = {frac_bits} is not what it computes")


def random_previous(model: Model, generator: np.random.Generator, count: int) -> IntArray:
    """States of every kind: (count, signals), zeros and extremes among them."""
    columns: list[IntArray] = []
    for atom in model.previous:
        values = generator.integers(atom.low, atom.high, size=count, endpoint=True)
        special = generator.choice(np.array([0, atom.low, atom.high]), size=count)
        columns.append(np.where(generator.random(count) < 0.7, values, special))
    return np.stack(columns, axis=1)
