# SPDX-License-Identifier: MIT
"""Shows that terms of machine code equal terms of the reference, from cut to cut.

A compiler computes most values of the reference somewhere on its way, perhaps negated or moved by a constant. Where a term's
values on samples say that it may be one of them, that is proved, and from there on the term *is* the cut's atom. Sums meet in
their normal form without any proof. Everything else is a function of one sum, small enough to be tried at every value that the
sum can have, or a question for a solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import gcd

import numpy as np
import numpy.typing as npt

from bitneat.prove.evaluation import each_value, signed_values, values_of
from bitneat.prove.queries import differ
from bitneat.prove.semantics import Cut, IntArray, Model
from bitneat.prove.terms import Atom, Op, Term, Terms, cone, rebuild, resized, signed, substituted

EXHAUSTIVE = 1 << 18
"""Up to so many values of a sum are all tried; for more, a solver is asked first."""
_LAST_RESORT = 1 << 22
_CHUNK = 1 << 20
_FEW = 512
_COMPUTED = 64
"""Bits of the widest terms whose values can be computed."""
_SECONDS_EACH = 20.0
_SECONDS_GUESS = 2.0
_SECONDS_WHOLE = 30.0
_GUESSES = 10
_DEEP = 3
"""Definitions of definitions that a solver is given at once."""
_WIDTHS = (16, 32, 64)
"""Bits of the numbers that a value of the reference may stand in."""


@dataclass
class Effort:
    """How the steps of a proof were settled."""

    exhaustive: int = 0
    solver: int = 0
    known: int = 0
    """By a proof of the same function over a range that holds this one."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Two terms that were not shown to be equal. ``model`` has values of the atoms for which they differ, if some are known."""

    model: Mapping[Atom, int] | None


@dataclass
class Lemmas:
    """Functions of one sum that were proved equal, by their text; valid anywhere, so one is kept for many proofs."""

    proved: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    def covers(self, key: str, low: int, high: int) -> bool:
        """Whether a proof over a range that holds this one is there."""
        return any(least <= low and high <= most for least, most in self.proved.get(key, ()))

    def add(self, key: str, low: int, high: int) -> None:
        """Remember one."""
        self.proved.setdefault(key, []).append((low, high))


class _NotOfOneSum(Exception):  # noqa: N818 - it steers, and never leaves this module
    pass


Direction = tuple[tuple[Atom, int], ...]
"""A sum of atoms without its constant, divided by its coefficients' common divisor."""


class Equivalence:
    """One side's terms against a model.

    Args:
        terms: where terms are made.
        model: the reference.
        samples: values of all atoms of both sides, one for each sample.
        state: what the other side's atoms of state stand for, as terms of the model.
        lemmas: proofs to use and to add to.
        widely: whether a term may be a function of a sum by way of other values that are made of the same sum. That finds
            more, and now and then another value than the one that what follows is made of.
        thoroughly: whether a term that has one value on all samples is compared with all of the reference's that have, too;
            not only with those made of what it is made of.
        paranoid: settle each step in every way there is, and by two solvers.
    """

    def __init__(
        self,
        terms: Terms,
        model: Model,
        samples: Mapping[Atom, IntArray],
        state: Mapping[Atom, Term],
        lemmas: Lemmas,
        *,
        widely: bool = False,
        thoroughly: bool = False,
        paranoid: bool = False,
    ) -> None:
        self._widely, self._thoroughly = widely, thoroughly
        self._terms, self._model, self._samples, self._lemmas = terms, model, samples, lemmas
        self._state, self._paranoid = state, paranoid
        self.effort = Effort()
        self._guesses = 0
        self._by_shape: dict[bytes | None, list[tuple[Cut, int, int]]] = {}
        self._by_halfword: dict[bytes, list[tuple[Cut, int, int]]] = {}
        self._cut_of = {cut.value.atom: cut for cut in model.cuts}
        known = [*model.cuts, *model.sums]
        count = len(next(iter(samples.values())))
        for cut, values in zip(known, values_of([cut.value for cut in known], samples), strict=True):
            places = np.broadcast_to(signed_values(values, cut.value.width), (count,))
            shape, scale = _shape(places)
            self._by_shape.setdefault(shape, []).append((cut, scale, int(places[0])))
            for sign in (1, -1) if shape is not None else ():
                self._by_halfword.setdefault(_halfword(sign * places), []).append((cut, sign, int(places[0])))
        self._constants = {signal.params[0] for signal in model.signals if signal.is_const}
        self._abstract: dict[int, Term] = {}
        self._settled: dict[Term, Term] = {}
        self._sums: dict[tuple[int, int], Atom] = {}
        self._chains: dict[Cut, list[Cut]] = {}
        self._tied: dict[Cut, set[Atom]] = {}
        self._functions: dict[tuple[Cut, int], Term | None] = {}

    # Cuts --------------------------------------------------------------------------------------------------------------

    def abstract(self, made: Sequence[Term]) -> None:
        """Find the cuts among terms, each after its arguments; terms that nothing needs may be the ones that show them."""
        for term, values in each_value(made, self._samples):
            new = self._rebuilt(term)
            if values is not None and _is_number(term) and not _is_sum_of_atoms(new) and not _is_another(term, values):
                cut = self._as_cut(new, signed_values(values, term.width))
                if cut is not None:
                    self._settle(new, cut)
                    new = cut
            self._abstract[term.number] = new

    def _rebuilt(self, term: Term) -> Term:
        if term.atom is not None and term.atom in self._state:
            return resized(self._terms, self._state[term.atom], term.width)
        return rebuild(self._terms, term, [self._with_settled(self._abstract[arg.number]) for arg in term.args])

    def _settle(self, term: Term, cut: Term) -> None:
        """Where the term is a sum, sums of more have its parts; let one of them stand for what it must be."""
        constant, parts = self._terms.linear_parts(term)
        for part in sorted(parts, key=lambda one: -one.number):
            if part.atom is None and parts[part] in (1, -1) and part not in self._settled:
                others = {one: c for one, c in parts.items() if one is not part}
                rest = self._terms.sub(cut, self._terms.lin(term.width, constant, others))
                value = self._terms.times(rest, parts[part])
                self._remember(part, value)
                for width in _WIDTHS:  # the same in other registers
                    for resize in (self._terms.sext, self._terms.zext) if width > term.width else ():
                        self._remember(resize(part, width), resize(value, width))
                    if width < term.width:
                        self._remember(self._terms.extract(part, 0, width), self._terms.extract(value, 0, width))
                return

    def _remember(self, part: Term, value: Term) -> None:
        """Let a part stand for a value, which holds no part that stands for something: so they never go round in circles."""
        value = self._with_settled(value)
        if part not in self._settled and part not in self._terms.linear_parts(value)[1]:
            self._settled[part] = value

    def _with_settled(self, term: Term) -> Term:
        while True:
            constant, parts = self._terms.linear_parts(term)
            if not any(part in self._settled for part in parts):
                return term
            pieces = [(self._settled.get(part, part), c) for part, c in parts.items()]
            term = self._terms.scaled_sum(term.width, constant, pieces)

    def _as_cut(self, term: Term, values: IntArray) -> Term | None:
        values = np.broadcast_to(values, next(iter(self._samples.values())).shape)
        shape, scale = _shape(values)
        if shape is None and int(values[0]) in self._constants and self._is_constant(term, int(values[0])):
            return self._terms.const(term.width, int(values[0]))
        found = [(cut, scale // one, first) for cut, one, first in self._by_shape.get(shape, ()) if scale % one == 0]
        if term.width == 16 and shape is not None:
            # What was moved may have wrapped.
            found += [one for one in self._by_halfword.get(_halfword(values), ()) if one not in found]
        if shape is None and not self._thoroughly:
            # All that is rare looks alike in samples.
            atoms = {one.atom for one in cone([term])}
            found = [one for one in found if not atoms.isdisjoint(self._tied_to(one[0]))]
        for cut, factor, first in found:
            offset = int(values[0]) - factor * first
            if self._is_cut(term, cut, factor, offset, guess=shape is not None):
                return self._moved(cut.value, term.width, factor, offset)
        return None

    def _is_cut(self, term: Term, cut: Cut, factor: int, offset: int, *, guess: bool) -> bool:
        """Whether the term is the cut's value times ``factor`` plus ``offset``, for all values of its atoms.

        If it is no function of one sum, a solver is asked where ``guess`` says that it may be worth it.
        """
        chain, compared = self._chain(cut), False
        for depth in range(len(chain)):
            base = chain[depth]
            direction = _direction(base.argument)
            wanted = None if direction is None else self._as_function(cut, chain[1 : depth + 1], direction)
            if direction is None or wanted is None:
                continue
            above = self._above(term, chain[: depth + 1], direction)
            try:
                reduced = self._over(self._substituted(term, above), direction)
            except _NotOfOneSum:
                continue
            goal = self._moved(wanted, term.width, factor, offset)
            compared = True
            if self._same_function(reduced, goal, chain[: depth + 1], direction, (factor, offset)):
                return True
        if compared or not guess or self._guesses >= _GUESSES:
            return False
        self._guesses += 1
        wanted = self._without_others(cut.definition, term)
        return self._asked(term, self._moved(wanted, term.width, factor, offset), _SECONDS_GUESS)

    def _without_others(self, definition: Term, term: Term) -> Term:
        """A definition with those of the cuts that the term does not have, as where code puts a clip of an input into a sum."""
        there = {one.atom for one in cone([term])}
        for _ in range(_DEEP):
            others: dict[Atom | None, Term] = {
                one.atom: self._cut_of[one.atom].definition
                for one in cone([definition])
                if one.atom in self._cut_of and one.atom not in there
            }
            if not others:
                break
            (definition,) = substituted(self._terms, [definition], others)
        return definition

    def _above(self, term: Term, chain: Sequence[Cut], direction: Direction) -> dict[Atom | None, Term]:
        """The definitions of a chain, and of what else in the term is made of its last alone; or of the same sum.

        So `tanh` is found where code takes the magnitude first and its sign last, although the controller has that magnitude, too.
        """
        values: dict[Atom | None, Term] = {
            one.value.atom: one.definition for one in chain if one.value.atom in self._cut_of
        }
        for one in cone([term]):
            other = self._chain(self._cut_of[one.atom]) if one.atom in self._cut_of else []
            for depth, cut in enumerate(other):
                if cut is chain[-1] or (self._widely and _direction(cut.argument) == direction):
                    values |= {each.value.atom: each.definition for each in other[: depth + 1]}
                    break
        return values

    def _as_function(self, cut: Cut, inner: Sequence[Cut], direction: Direction) -> Term | None:
        """A cut's definition in one sum, with those of others for their values; None if it is no function of the sum."""
        key = (cut, len(inner))
        if key not in self._functions:
            values: dict[Atom | None, Term] = {one.value.atom: one.definition for one in inner}
            try:
                self._functions[key] = self._over(self._substituted(cut.definition, values), direction)
            except _NotOfOneSum:
                self._functions[key] = None
        return self._functions[key]

    def _is_constant(self, term: Term, value: int) -> bool:
        """Whether a function of one sum has one value only, as a node that is always saturated has."""
        leaves = [one for one in cone([term]) if _is_sum_of_atoms(one) and not one.is_const]
        direction = _direction(max(leaves, key=lambda one: (one.width, len(one.args)))) if leaves else None
        if direction is None:
            return False
        try:
            reduced = self._over(term, direction)
        except _NotOfOneSum:
            return False
        low, high = _range(direction)
        wanted = self._terms.const(term.width, value)
        if reduced is not wanted and high - low < EXHAUSTIVE:
            sums = np.arange(low, high + 1, dtype=np.int64)
            found = values_of([reduced], {self._sums[low, high]: sums})[0]
            self.effort.exhaustive += 1
            holds = bool((found == np.uint64(wanted.unsigned)).all())
            if not holds or not self._paranoid:
                return holds
        return self._asked(reduced, wanted, _SECONDS_GUESS)

    def _asked(self, left: Term, right: Term, seconds: float) -> bool:
        if left is right:
            return True
        if any(term.width > 64 for term in cone([left, right])):
            return False
        if differ(left, right, seconds=seconds, paranoid=self._paranoid).outcome != "equal":
            return False
        self.effort.solver += 1
        return True

    def _chain(self, cut: Cut) -> list[Cut]:
        """The cut, then the one that it is made from alone, and so on."""
        if cut not in self._chains:
            _, parts = self._terms.linear_parts(cut.argument)
            atoms = [part.atom for part in parts]
            below = self._cut_of.get(atoms[0]) if len(atoms) == 1 else None
            self._chains[cut] = [cut] if below is None else [cut, *self._chain(below)]
        return self._chains[cut]

    def _tied_to(self, cut: Cut) -> set[Atom]:
        """Atoms of which a term that is the cut has one: what it is made from, and what else is made from that."""
        if cut not in self._tied:
            chain = self._chain(cut)
            tied = {part.atom for one in chain for part in self._terms.linear_parts(one.argument)[1]}
            directions = {_direction(one.argument) for one in chain}
            for other in self._model.cuts:
                if any(_direction(one.argument) in directions for one in self._chain(other)):
                    tied.add(other.value.atom)
            self._tied[cut] = {atom for atom in tied if atom is not None}
        return self._tied[cut]

    def _moved(self, term: Term, width: int, factor: int, offset: int) -> Term:
        moved = self._terms.times(resized(self._terms, term, width), factor)
        return self._terms.add(moved, self._terms.const(width, offset))

    def _substituted(self, term: Term, values: Mapping[Atom | None, Term]) -> Term:
        """The term with other terms for some of its atoms, and for those that come in with these."""
        while any(one.atom is not None and one.atom in values for one in cone([term])):
            (term,) = substituted(self._terms, [term], values)
        return term

    # Functions of one sum ----------------------------------------------------------------------------------------------

    def _over(self, term: Term, direction: Direction) -> Term:
        """The term as one in a single atom that stands for a sum."""
        terms, low, high = self._terms, *_range(direction)
        total = self._sums.setdefault((low, high), Atom("sum", low, high))
        coefficients = dict(direction)
        odd = next(atom for atom, c in direction if c % 2)
        done: dict[int, Term] = {}
        for one in cone([term]):
            if one.op not in (Op.VAR, Op.LIN):
                done[one.number] = rebuild(terms, one, [done[arg.number] for arg in one.args])
                continue
            constant, parts = terms.linear_parts(one)
            found = {part.atom: c for part, c in parts.items() if part.atom is not None}
            pieces = [(done[part.number], c) for part, c in parts.items() if part.atom is None]
            if one.op is Op.VAR and found.keys() != coefficients.keys():
                done[one.number] = one  # a part of a sum, which is looked at as a whole; alone, it is refused below
                continue
            if found:
                # Modulo 2^width, where a coefficient may have wrapped or gone.
                modulus = 1 << one.width
                factor = found.get(odd, 0) * pow(coefficients[odd], -1, modulus) % modulus
                if not found.keys() <= coefficients.keys() or any(
                    (found.get(atom, 0) - factor * c) % modulus for atom, c in coefficients.items()
                ):
                    raise _NotOfOneSum
                pieces.append((terms.var(total, one.width), factor))
            done[one.number] = terms.scaled_sum(one.width, constant, pieces)
        result_term = done[term.number]
        if any(one.atom not in (None, total) for one in cone([result_term])):
            raise _NotOfOneSum
        return result_term

    def _same_function(
        self, left: Term, right: Term, chain: Sequence[Cut], direction: Direction, moved: tuple[int, int]
    ) -> bool:
        """Whether two terms in one sum agree wherever the sum can be; ``chain`` says what the right one is."""
        if left is right:
            return True
        low, high = _range(direction)
        key = f"{_text(left)} | {_text(right)}"
        if self._lemmas.covers(key, low, high):
            self.effort.known += 1
            return True
        total = self._sums[low, high]
        if not self._somewhere(left, chain, direction, total, moved):
            return False
        few = high - low < EXHAUSTIVE
        if not few or self._paranoid:
            answer = differ(left, right, seconds=_SECONDS_EACH, paranoid=self._paranoid).outcome
            if answer == "differ":
                return False
            if answer == "equal":
                self.effort.solver += 1
                if not self._paranoid or high - low >= _LAST_RESORT:
                    self._lemmas.add(key, low, high)
                    return True
        if high - low >= _LAST_RESORT or not self._everywhere(left, chain, direction, total, moved):
            return False
        self.effort.exhaustive += 1
        self._lemmas.add(key, low, high)
        return True

    def _everywhere(
        self, left: Term, chain: Sequence[Cut], direction: Direction, total: Atom, moved: tuple[int, int]
    ) -> bool:
        """Try every value of the sum, against the semantics' own functions."""
        return all(
            self._agree(left, chain, direction, total, moved, np.arange(begin, min(begin + _CHUNK, total.high + 1)))
            for begin in range(total.low, total.high + 1, _CHUNK)
        )

    def _somewhere(
        self, left: Term, chain: Sequence[Cut], direction: Direction, total: Atom, moved: tuple[int, int]
    ) -> bool:
        """Try few values: what differs mostly differs in these, which takes no solver then."""
        if any(one.width > _COMPUTED for one in cone([left])):
            return True
        spread = np.linspace(total.low, total.high, _FEW).astype(np.int64)
        middle = np.arange(max(total.low, -_FEW), min(total.high + 1, _FEW))
        return self._agree(left, chain, direction, total, moved, np.concatenate((spread, middle)))

    def _agree(
        self,
        left: Term,
        chain: Sequence[Cut],
        direction: Direction,
        total: Atom,
        moved: tuple[int, int],
        sums: IntArray,
    ) -> bool:
        factor, offset = (signed(one, 64) for one in moved)  # modulo 2^64, as NumPy computes
        mask = np.uint64((1 << left.width) - 1)
        argument = self._argument(chain[-1], direction, sums)
        for cut, after in zip(reversed(chain), [*reversed(chain[:-1]), None], strict=True):
            value = cut.function(argument)
            if after is not None:
                constant, parts = self._terms.linear_parts(after.argument)
                argument = value * next(iter(parts.values())) + constant
        wanted = (value * factor + offset).astype(np.uint64) & mask
        return np.array_equal(np.broadcast_to(values_of([left], {total: sums})[0], sums.shape), wanted)

    def _argument(self, cut: Cut, direction: Direction, sums: IntArray) -> IntArray:
        constant, parts = self._terms.linear_parts(cut.argument)
        first, unit = direction[0]
        factor = next(c for part, c in parts.items() if part.atom is first) // unit
        return sums * factor + constant

    # Whole terms -------------------------------------------------------------------------------------------------------

    def is_shown(self, term: Term, expected: Term) -> bool:
        """Whether nothing is left to ask about a term: its normal form is the reference's."""
        return self._with_settled(self._abstract[term.number]) is self._terms.extract(expected, 0, term.width)

    def difference(self, term: Term, expected: Term, *, whole: bool) -> Difference | None:
        """Whether a term equals the reference's for all values of the atoms; None if it does.

        Args:
            term: as executed.
            expected: of the model, of `WORD` bits; the term is compared with its lowest.
            whole: ask a solver about all that is left, down to the inputs, if nothing else helps.
        """
        terms = self._terms
        reduced = self._with_settled(self._abstract[term.number])
        wanted = terms.extract(expected, 0, term.width)
        if reduced is wanted:
            return None
        if self._asked(reduced, wanted, _SECONDS_GUESS):
            return None
        if not whole:
            return Difference(None)
        # Down to inputs and states, where a difference is a real one.
        all_cuts: dict[Atom | None, Term] = {}
        for cut in self._model.cuts:
            all_cuts[cut.value.atom] = self._substituted(cut.definition, all_cuts)
        answer = differ(
            self._substituted(reduced, all_cuts),
            self._substituted(wanted, all_cuts),
            seconds=_SECONDS_WHOLE,
            paranoid=self._paranoid,
        )
        if answer.outcome == "equal":
            self.effort.solver += 1
            return None
        return Difference(answer.model)


def _shape(values: npt.NDArray[np.int64]) -> tuple[bytes | None, int]:
    """What stays of values when they are scaled and moved, and their scale; None if they are all the same."""
    moved = values - values[0]
    nonzero = np.flatnonzero(moved)
    if not len(nonzero):
        return None, 1
    scale = int(np.gcd.reduce(moved))
    if moved[nonzero[0]] < 0:
        scale = -scale
    return (moved // scale).tobytes(), scale


def _halfword(values: npt.NDArray[np.int64]) -> bytes:
    """What stays of values modulo 2^16 when they are moved."""
    moved: npt.NDArray[np.int64] = (values - values[0]) & 0xFFFF
    return moved.tobytes()


def _is_number(term: Term) -> bool:
    """Whether a value of the reference may stand in it: a register, or bits of a shifted one that a narrow sum goes on with."""
    return term.width in _WIDTHS or (term.op is Op.EXTRACT and term.params[0] > 0 and term.width > min(_WIDTHS))


def _is_another(term: Term, values: npt.NDArray[np.uint64]) -> bool:
    """Whether it is a number that was looked at before, with more bits, moved, or negated; where nothing wraps on samples."""
    if term.op is Op.LIN:
        return len(term.args) == 1 and term.params[1] in (1, -1) and term.width > min(_WIDTHS)
    if term.op not in (Op.SEXT, Op.ZEXT) or not _is_number(term.args[0]):
        return False
    return term.op is Op.SEXT or int(values.max()) < 1 << (term.args[0].width - 1)


def _is_sum_of_atoms(term: Term) -> bool:
    return term.op in (Op.CONST, Op.VAR) or (term.op is Op.LIN and all(part.op is Op.VAR for part in term.args))


def _direction(argument: Term) -> Direction | None:
    if not _is_sum_of_atoms(argument) or argument.is_const:
        return None
    pairs = [(argument, 1)] if argument.op is Op.VAR else list(zip(argument.args, argument.params[1:], strict=True))
    divisor = gcd(*(c for _, c in pairs))
    if pairs[0][1] < 0:
        divisor = -divisor
    return tuple((part.atom, c // divisor) for part, c in pairs if part.atom is not None)


def _range(direction: Direction) -> tuple[int, int]:
    low = sum(min(c * atom.low, c * atom.high) for atom, c in direction)
    high = sum(max(c * atom.low, c * atom.high) for atom, c in direction)
    return low, high


def _text(term: Term) -> str:
    """A term in one atom as text, the same in every `Terms`."""
    names: dict[int, int] = {}
    pieces = []
    for one in cone([term]):
        names[one.number] = len(names)
        arguments = ",".join(str(names[arg.number]) for arg in one.args)
        pieces.append(f"{one.op.value}{one.width}({arguments}){','.join(map(str, one.params))}")
    return ";".join(pieces)
