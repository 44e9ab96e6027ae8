# SPDX-License-Identifier: MIT
"""What a controller computes, as terms: the other side of the equation.

Each value on the way that is not a plain sum (a floor shift, a clip, an activation) becomes an atom of its own, a *cut point*:
an unknown integer within bounds, with the sum that it comes from and the function that makes it. Proofs go from cut to cut.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, partial
from math import ceil, floor, gcd
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller, Reference
from bitneat.controller.activation import PROGRAMS, Program, constant, table
from bitneat.controller.activation import Op as Step
from bitneat.controller.interval import Interval, image, intervals, one_step
from bitneat.controller.ir import MAX_SIGNALS, SIGNAL_MAX, Constant, Node
from bitneat.controller.reference import node_value
from bitneat.prove.evaluation import signed_values, values_of
from bitneat.prove.terms import WORD, Atom, Op, Term, Terms
from bitneat.verify.vectors import random_vectors

IntArray = npt.NDArray[np.int64]

_TRIED = 1 << 16
"""Up to so many values of an atom are all tried."""

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
    free: list[Atom] = field(default_factory=list)
    """What is unknown of the state."""
    previous: list[Term] = field(default_factory=list)
    """Each signal at the end of the step before, in any state that can be reached."""
    assumed: set[int] = field(default_factory=set)
    """Signals of which the bounds that ``previous`` has are an assumption about states."""
    constant: dict[int, int] = field(default_factory=dict)
    """Signals that are taken to have the same value after every step, and which."""
    cuts: list[Cut] = field(default_factory=list)
    """Those that have an atom, each after those it needs."""
    sums: list[Cut] = field(default_factory=list)
    """Inputs, unknowns of the state, and sums on the way, which code may make of more than additions."""
    signals: list[Term] = field(default_factory=list)
    outputs: list[Term] = field(default_factory=list)

    def samples(self, inputs: IntArray, free: IntArray) -> dict[Atom, IntArray]:
        """Values of all atoms.

        Args:
            inputs: (samples, inputs).
            free: (samples, unknowns of the state).
        """
        values: dict[Atom, IntArray] = dict(zip(self.inputs, inputs.T, strict=True))
        values |= dict(zip(self.free, free.T, strict=True))
        for cut in self.cuts:
            assert cut.value.atom is not None
            values[cut.value.atom] = cut.function(self._numbers([cut.argument], values, len(inputs))[0])
        return values

    def previous_values(self, samples: Mapping[Atom, IntArray], count: int) -> IntArray:
        """Each signal at the end of the step before: (samples, signals)."""
        return np.stack(self._numbers(self.previous, samples, count), axis=1)

    def signal_values(self, samples: Mapping[Atom, IntArray], count: int) -> IntArray:
        """Each signal: (samples, signals)."""
        return np.stack(self._numbers(self.signals, samples, count), axis=1)

    @staticmethod
    def _numbers(roots: Sequence[Term], values: Mapping[Atom, IntArray], count: int) -> list[IntArray]:
        found = values_of(roots, values)
        return [np.broadcast_to(signed_values(one, WORD), (count,)) for one in found]


def build(terms: Terms, controller: Controller, *, guard: bool) -> Model:
    """A controller as terms, on its declared domain and in every state that can be reached.

    What is known of states is known by induction: it holds after a reset, and if it holds before a step it holds after it.

    - Each signal is within the bounds that `bitneat.controller.interval` finds, if a step keeps it there; else within those of its
      limit or activation, which always do.
    - A signal that has the same value after every step, by its bounds, is that times whether a step was taken since the reset.
    - A node that reads nothing with a delay, and is 0 where all that it reads is 0, was what its definition makes of the
      signals before, too.
    - Signals that were always equal on random sequences are taken to be equal, until one step from there gives different
      terms; then they are told apart, and the rest is tried again.

    Args:
        terms: where terms are made.
        controller: which.
        guard: whether inputs may be any int16, and are clipped to their limits first.
    """
    groups = _seen_equal(controller) if controller.is_recurrent else list(range(controller.num_signals))
    wide = False
    while True:
        model = _Builder(terms, controller, groups, wide=wide).run(guard=guard)
        refined: dict[tuple[int, Term], int] = {}
        after = [refined.setdefault(key, i) for i, key in enumerate(zip(groups, model.signals, strict=True))]
        if len(set(after)) == len(set(groups)):
            if _stays_inside(model):
                return model
            if wide:
                raise AssertionError("a signal is beyond its own limit")
            wide = True
        groups = after


def _stays_inside(model: Model) -> bool:
    """Whether a step keeps each signal within the bounds that it was taken to be in before it.

    A signal's term may have wider bounds than the signal, where it is a sum that a node with an activation turned out to be; and
    the other way round, where sums cancel.
    """
    if not model.previous:
        return True
    step = one_step(model.controller, [Interval(before.low, before.high) for before in model.previous])
    for i, (before, after, bounds) in enumerate(zip(model.previous, model.signals, step.signals, strict=True)):
        low, high = max(after.low, bounds.low), min(after.high, bounds.high)
        least, most = before.low, before.high
        if i in model.constant:
            least = most = model.constant[i]
        if i in model.assumed and (low < least or high > most):
            return False
    return True


def _seen_equal(controller: Controller) -> list[int]:
    """For each signal the first that had the same values on random sequences."""
    lanes, steps = 16, 10
    inputs = random_vectors(controller, 0, lanes * steps).reshape(lanes, steps, -1)
    seen: list[list[int]] = []
    for lane in inputs.tolist():
        reference = Reference(controller)
        for vector in lane:
            reference.step(vector)
            seen.append(reference.signals)
    first: dict[tuple[int, ...], int] = {}
    return [first.setdefault(history, i) for i, history in enumerate(zip(*seen, strict=True))]


class _Builder:
    def __init__(self, terms: Terms, controller: Controller, groups: Sequence[int], *, wide: bool) -> None:
        self.terms, self.controller, self._groups, self._wide = terms, controller, groups, wide
        self.model = Model(controller, [])
        self._known: dict[Term, Term] = {}
        self._started_term: Term | None = None

    def run(self, *, guard: bool) -> Model:
        terms, model, controller = self.terms, self.model, self.controller
        if controller.is_recurrent:
            self._add_previous()
        for i, entry in enumerate(controller.inputs):
            atom = Atom(f"observation[{i}]", -32768 if guard else -entry.limit, 32767 if guard else entry.limit)
            model.inputs.append(atom)
            arrived = terms.var(atom, WORD)
            self._sum(arrived)
            model.signals.append(self._clip(arrived, entry.limit, "limit") if guard else arrived)
        for node in controller.nodes:
            model.signals.append(self._node(node, model.signals))
        model.outputs.extend(
            terms.const(WORD, output.value) if isinstance(output, Constant) else model.signals[output.index]
            for output in controller.outputs
        )
        return model

    def _add_previous(self) -> None:
        terms, model, controller = self.terms, self.model, self.controller
        unknown: dict[int, Term] = {}
        for i, bounds in enumerate(intervals(controller).signals):
            node = None if i < len(controller.inputs) else controller.nodes[i - len(controller.inputs)]
            if bounds.low == bounds.high and not self._wide:
                model.assumed.add(i)
                model.constant[i] = bounds.low
                model.previous.append(terms.times(self._started(), bounds.low) if bounds.low else terms.const(WORD, 0))
                continue
            if node is not None and _keeps_zero(node, controller):
                model.previous.append(self._node(node, model.previous))
                continue
            model.assumed.add(i)
            group = self._groups[i]
            if group not in unknown:
                # All of a group are equal, so the bounds of its first are those of all.
                low, high = min(bounds.low, 0), max(bounds.high, 0)
                if self._wide:
                    limit = controller.signal_limit(i)
                    low, high = -limit, limit
                atom = Atom(f"previous[{i}]", low, high)
                model.free.append(atom)
                unknown[group] = terms.var(atom, WORD)
                self._sum(unknown[group])
            model.previous.append(unknown[group])

    def _started(self) -> Term:
        """0 in the first step after a reset, 1 later."""
        if self._started_term is None:
            atom = Atom("started", 0, 1)
            self.model.free.append(atom)
            self._started_term = self.terms.var(atom, WORD)
        return self._started_term

    def _node(self, node: Node, signals: Sequence[Term]) -> Term:
        terms, model = self.terms, self.model
        pieces = [terms.const(WORD, node.bias)]
        for link in node.links:
            source = (model.previous if link.delay else signals)[link.source]
            pieces.append(terms.times(source, link.sign << link.shift))
        total = terms.add(*pieces)
        if node.gain >= 0:
            scaled = terms.times(total, 1 << node.gain)
            self._sum(scaled)
        else:
            scaled = self._cut("floor", total, terms.ashr(total, -node.gain), _floor(-node.gain))
        argument = self._clip(scaled, SIGNAL_MAX, "clip")
        return self._activation(argument, node.activation, self.controller.frac_bits)

    def _clip(self, term: Term, limit: int, kind: Kind) -> Term:
        terms = self.terms
        if -limit <= term.low and term.high <= limit:
            return term
        low, high = terms.const(WORD, -limit), terms.const(WORD, limit)
        capped = terms.ite(terms.slt(term, high), term, high)
        definition = terms.ite(terms.slt(capped, low), low, capped)
        bounds = Interval(max(term.low, -limit), min(term.high, limit))
        return self._cut(kind, term, definition, _clipping(limit), bounds)

    def _activation(self, argument: Term, name: str, frac_bits: int) -> Term:
        check_activation(name, frac_bits)
        definition = activation_term(self.terms, PROGRAMS[name], argument, frac_bits)
        bounds = image(name, Interval(argument.low, argument.high), frac_bits)
        return self._cut("activation", argument, definition, partial(PROGRAMS[name], frac_bits=frac_bits), bounds)

    def _sum(self, value: Term) -> None:
        if value.op in (Op.VAR, Op.LIN) and value not in self._known.values():
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
        line = self._line(argument, function)
        if line is not None:
            self._sum(line)
            return line
        if definition.op is Op.LIN and len(definition.args) == 1:
            # A multiple of something: a compiler may well compute that, and scale it later.
            constant, factor = definition.params
            part = definition.args[0]
            inner_bounds = None if bounds is None else _unscaled_bounds(bounds, part, constant, factor)
            inner = self._cut(kind, argument, part, _unscaled(function, constant, factor), inner_bounds)
            return self.terms.add(self.terms.times(inner, factor), self.terms.const(WORD, constant))
        if definition not in self._known:
            low, high = (definition.low, definition.high) if bounds is None else bounds
            if low == high:
                return self.terms.const(WORD, low)
            atom = Atom(f"{kind}{len(self.model.cuts)}", low, high)
            value = self._known[definition] = self.terms.var(atom, WORD)
            self.model.cuts.append(Cut(value, kind, argument, definition, function))
        return self._known[definition]

    def _line(self, argument: Term, function: Callable[[IntArray], IntArray]) -> Term | None:
        """The value as a sum, if it is one at each value that the argument can have, as that of `abs` below 0 is."""
        constant, parts = self.terms.linear_parts(argument)
        unit = gcd(*parts.values())
        rest = self.terms.lin(argument.width, 0, {part: c // unit for part, c in parts.items()})
        if not 0 < rest.high - rest.low < _TRIED or argument.low != unit * rest.low + constant:
            return None  # too many values, or a sum that might wrap
        rests = np.arange(rest.low, rest.high + 1, dtype=np.int64)
        values = function(unit * rests + constant)
        slope = int(values[1] - values[0])
        offset = int(values[0]) - slope * rest.low
        if not np.array_equal(values, slope * rests + offset):
            return None
        return self.terms.add(self.terms.times(rest, slope), self.terms.const(WORD, offset))


def _unscaled(function: Callable[[IntArray], IntArray], constant: int, factor: int) -> Callable[[IntArray], IntArray]:
    return lambda values: (function(values) - constant) // factor


def _unscaled_bounds(bounds: Interval, part: Term, constant: int, factor: int) -> Interval | None:
    """Of a part, when ``constant + factor * part`` is within bounds; None if that sum might wrap."""
    ends = (constant + factor * part.low, constant + factor * part.high)
    if not all(-(1 << (WORD - 1)) <= end < 1 << (WORD - 1) for end in ends):
        return None
    low, high = sorted(Fraction(end - constant, factor) for end in (bounds.low, bounds.high))
    return Interval(max(part.low, ceil(low)), min(part.high, floor(high)))


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


def _keeps_zero(node: Node, controller: Controller) -> bool:
    """Whether a node that reads nothing with a delay is 0 in a step in which all that it reads is 0."""
    return not any(link.delay for link in node.links) and node_value(node, _ZEROS, (), controller.frac_bits) == 0


class _Zeros(Sequence[int]):
    def __len__(self) -> int:
        return MAX_SIGNALS

    def __getitem__(self, index: Any) -> Any:
        return 0


_ZEROS = _Zeros()


def random_states(model: Model, generator: np.random.Generator, count: int) -> IntArray:
    """States of every kind, zeros and extremes among them: (count, unknowns of the state)."""
    columns = [np.zeros((count, 0), dtype=np.int64)]
    for atom in model.free:
        values = generator.integers(atom.low, atom.high, size=count, endpoint=True)
        special = generator.choice(np.array([0, atom.low, atom.high]), size=count)
        columns.append(np.where(generator.random(count) < 0.7, values, special)[:, None])
    return np.concatenate(columns, axis=1)
