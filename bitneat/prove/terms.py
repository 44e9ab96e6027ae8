# SPDX-License-Identifier: MIT
"""Bit-vector terms: what a register or a byte of memory holds, as a function of inputs and state.

A term has a width in bits and denotes a number modulo 2^width. Equal terms are the same object: constructors rewrite what
they are given into a normal form and look it up. Sums are kept as linear forms, which is what makes two ways of adding the
same things meet; everything else stays as it was computed. Each term carries an interval, in signed reading, that holds for
all values of its atoms; rewriting may use it, so a term equals what it was made of on the declared domain, and only there.

Every rule here is part of what a proof trusts. `tests/prove/test_terms.py` evaluates terms and rewritten terms on random values.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate, pairwise
from math import gcd
from typing import Any

WORD = 32
"""Bits of a number in the reference and in most registers."""


class Op(StrEnum):
    """What kind of term it is; arguments first, then parameters."""

    CONST = "const"
    VAR = "var"
    """An atom's value modulo 2^width."""
    LIN = "lin"
    """The sum of the constant and of each argument times its coefficient."""
    EXTRACT = "extract"
    """Bits from ``low`` upwards; ``low`` is not 0 unless the argument is opaque to truncation."""
    ZEXT = "zext"
    SEXT = "sext"
    CONCAT = "concat"
    """The arguments side by side, the lowest bits first."""
    AND = "and"
    OR = "or"
    XOR = "xor"
    ITE = "ite"
    EQ = "eq"
    SLT = "slt"
    ULT = "ult"
    MUL = "mul"


@dataclass(frozen=True, eq=False)
class Atom:
    """An unknown integer: an input, a state, a cut point, or something that nobody initialised."""

    name: str
    low: int
    high: int
    undefined: bool = False
    """What stood in memory or in a register before, on which no result may depend."""


@dataclass(eq=False, slots=True, repr=False)
class Term:
    """One term; made by the functions of a `Terms`, never by hand."""

    op: Op
    width: int
    args: tuple[Term, ...]
    params: tuple[int, ...]
    """CONST: the value, signed. LIN: the constant, then the coefficients, all signed. EXTRACT: the lowest bit."""
    atom: Atom | None
    low: int
    high: int
    number: int

    def __repr__(self) -> str:
        return f"<{self.op.value}:{self.width} #{self.number}>"

    @property
    def is_const(self) -> bool:
        """Whether it is a known number."""
        return self.op is Op.CONST

    @property
    def unsigned(self) -> int:
        """The number that a constant is, in 0..2^width-1."""
        return self.params[0] & ((1 << self.width) - 1)


def signed(value: int, width: int) -> int:
    """A number modulo 2^width, in signed reading."""
    value &= (1 << width) - 1
    return value - (1 << width) if value >> (width - 1) else value


def _normal(width: int, constant: int, parts: Mapping[Term, int]) -> tuple[int, list[tuple[Term, int]]]:
    """A sum's constant, and its parts in order with their coefficients, none 0: all of them signed."""
    half = 1 << (width - 1)
    mask = 2 * half - 1
    kept = [(part, c) for part, factor in parts.items() if (c := ((factor + half) & mask) - half)]
    kept.sort(key=_number)
    return ((constant + half) & mask) - half, kept


def _number(pair: tuple[Term, int]) -> int:
    return pair[0].number


def _fits(low: int, high: int, width: int) -> bool:
    return -(1 << (width - 1)) <= low and high < 1 << (width - 1)


def _edges(term: Term) -> set[int]:
    """Where the parts of a term begin, and where the last one ends."""
    widths = [part.width for part in term.args] if term.op is Op.CONCAT else []
    if term.op in (Op.ZEXT, Op.SEXT):
        widths = [term.args[0].width]
    return {0, *accumulate(widths), term.width}


def _is_mask(term: Term) -> bool:
    """Whether all bits are alike, by how it was made."""
    return term.params in ((0,), (-1,)) if term.is_const else term.op is Op.SEXT and term.args[0].width == 1


def _is_complement(term: Term) -> bool:
    """Of a mask, by how it was made."""
    return term.op is Op.SEXT and term.args[0].width == 1 and term.args[0].op is Op.LIN and term.args[0].params[0] == -1


class Terms:
    """Makes terms, and keeps them unique."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], Term] = {}
        self.made: list[Term] = []
        """All of them, each after its arguments."""
        self._extracted: dict[tuple[int, int, int], Term] = {}

    # Making ----------------------------------------------------------------------------------------------------------

    def _make(
        self,
        op: Op,
        width: int,
        args: tuple[Term, ...] = (),
        params: tuple[int, ...] = (),
        atom: Atom | None = None,
        bounds: tuple[int, int] | None = None,
    ) -> Term:
        key = (op, width, tuple(map(id, args)), params, id(atom))
        found = self._known.get(key)
        if found is None:
            whole = (-(1 << (width - 1)), (1 << (width - 1)) - 1)
            low, high = whole if bounds is None or not _fits(*bounds, width) else bounds
            found = Term(op, width, args, params, atom, low, high, len(self.made))
            self.made.append(found)
            self._known[key] = found
        return found

    def const(self, width: int, value: int) -> Term:
        """A known number, taken modulo 2^width."""
        value = signed(value, width)
        return self._make(Op.CONST, width, params=(value,), bounds=(value, value))

    def var(self, atom: Atom, width: int) -> Term:
        """An atom's value modulo 2^width."""
        if atom.low == atom.high:
            return self.const(width, atom.low)
        return self._make(Op.VAR, width, atom=atom, bounds=(atom.low, atom.high))

    # Sums ------------------------------------------------------------------------------------------------------------

    def lin(self, width: int, constant: int, parts: Mapping[Term, int]) -> Term:
        """``constant`` plus each part times its coefficient; parts are neither constants nor sums."""
        total, kept = _normal(width, constant, parts)
        if not kept:
            return self.const(width, total)
        first, c = kept[0]
        if len(kept) == 1 and (c == 1 or width == 1) and total == 0:
            return first
        if any(_is_complement(part) for part, _ in kept):  # sums hold masks alone, with which they may cancel out
            pieces = [(self.sext(self.invert(p.args[0]), width), -c) if _is_complement(p) else (p, c) for p, c in kept]
            return self.scaled_sum(width, total - sum(c for p, c in kept if _is_complement(p)), pieces)
        if len(kept) == 1 and c == -1 and total == -1 and width > 1 and _is_mask(first):
            return self.sext(self.invert(first.args[0]), width)  # the complement of a mask is a mask
        low, high = self._lin_bounds(total, kept)
        return self._make(
            Op.LIN,
            width,
            tuple(part for part, _ in kept),
            (total, *(c for _, c in kept)),
            bounds=(low, high),
        )

    @staticmethod
    def _lin_bounds(constant: int, parts: Iterable[tuple[Term, int]]) -> tuple[int, int]:
        low = high = constant
        for part, c in parts:
            low += c * (part.low if c > 0 else part.high)
            high += c * (part.high if c > 0 else part.low)
        return low, high

    def linear_parts(self, term: Term) -> tuple[int, dict[Term, int]]:
        """A term as constant and coefficients."""
        if term.op is Op.CONST:
            return term.params[0], {}
        if term.op is Op.LIN:
            return term.params[0], dict(zip(term.args, term.params[1:], strict=True))
        return 0, {term: 1}

    def add(self, *terms: Term) -> Term:
        """Their sum."""
        return self.scaled_sum(terms[0].width, 0, [(term, 1) for term in terms])

    def scaled_sum(self, width: int, constant: int, pieces: Iterable[tuple[Term, int]]) -> Term:
        """``constant`` plus each term times its factor; terms may be sums themselves."""
        more, parts = self._combined(pieces)
        return self.lin(width, constant + more, parts)

    def _combined(self, pieces: Iterable[tuple[Term, int]]) -> tuple[int, dict[Term, int]]:
        constant, parts = 0, dict[Term, int]()
        for term, factor in pieces:
            c, more = self.linear_parts(term)
            constant += factor * c
            for part, coefficient in more.items():
                parts[part] = parts.get(part, 0) + factor * coefficient
        return constant, parts

    def times(self, term: Term, factor: int) -> Term:
        """A multiple of it by a known number."""
        constant, parts = self.linear_parts(term)
        return self.lin(term.width, constant * factor, {part: c * factor for part, c in parts.items()})

    def sub(self, x: Term, y: Term) -> Term:
        """``x - y``."""
        return self.scaled_sum(x.width, 0, [(x, 1), (y, -1)])

    def neg(self, x: Term) -> Term:
        """``-x``."""
        return self.times(x, -1)

    def invert(self, x: Term) -> Term:
        """``~x``, which is ``-1 - x``."""
        return self.sub(self.const(x.width, -1), x)

    def mul(self, x: Term, y: Term) -> Term:
        """``x * y``."""
        if y.is_const:
            return self.times(x, y.params[0])
        if x.is_const:
            return self.times(y, x.params[0])
        return self._make(Op.MUL, x.width, self._ordered(x, y))

    # Shifts and widths -----------------------------------------------------------------------------------------------

    def shl(self, x: Term, k: int) -> Term:
        """``x << k`` for a known k."""
        return self.const(x.width, 0) if k >= x.width else self.times(x, 1 << k)

    def lshr(self, x: Term, k: int) -> Term:
        """``x >> k``, zeros from above, for a known k."""
        if k == 0:
            return x
        return self.const(x.width, 0) if k >= x.width else self.zext(self.extract(x, k, x.width - k), x.width)

    def ashr(self, x: Term, k: int) -> Term:
        """``x >> k``, the sign from above, for a known k."""
        k = min(k, x.width - 1)
        return x if k == 0 else self.sext(self.extract(x, k, x.width - k), x.width)

    def extract(self, term: Term, low: int, width: int) -> Term:
        """``width`` bits from bit ``low`` on."""
        if low == 0 and width == term.width:
            return term
        key = (term.number, low, width)
        if key not in self._extracted:
            self._extracted[key] = self._extract(term, low, width)
        return self._extracted[key]

    def _extract(self, term: Term, low: int, width: int) -> Term:
        # Odd bits of what is no sum stay bits of it: it may turn out to be a cut, of which its parts know nothing.
        lower_part = low == 0 and width in (8, 16, 32)
        if low and term.width == 2 * WORD and _fits(term.low, term.high, WORD):
            # A word in a register of two: its upper half repeats the sign.
            return self._extract_of_extended(self.extract(term, 0, WORD), low, width, is_signed=True)
        match term.op:
            case Op.CONST:
                return self.const(width, term.params[0] >> low)
            case Op.CONCAT:
                return self._extract_of_concat(term, low, width)
            case Op.EXTRACT:
                return self.extract(term.args[0], term.params[0] + low, width)
            case Op.ZEXT | Op.SEXT:
                return self._extract_of_extended(term.args[0], low, width, is_signed=term.op is Op.SEXT)
            case Op.VAR if low == 0:
                assert term.atom is not None
                return self.var(term.atom, width)
            case Op.LIN:
                narrow = self._extract_of_lin(term, low, width)
                if narrow is not None:
                    return narrow
            case Op.AND if lower_part:
                return self.bit_and(*(self.extract(arg, low, width) for arg in term.args))
            case Op.OR if lower_part:
                return self.bit_or(*(self.extract(arg, low, width) for arg in term.args))
            case Op.XOR if lower_part:
                return self.bit_xor(*(self.extract(arg, low, width) for arg in term.args))
            case Op.ITE if lower_part or (term.args[1].is_const and term.args[2].is_const):
                condition, then, otherwise = term.args
                return self.ite(condition, self.extract(then, low, width), self.extract(otherwise, low, width))
            case Op.MUL if low == 0:
                return self.mul(*(self.extract(arg, 0, width) for arg in term.args))
            case _:
                pass
        if low + width == term.width and width == 1:
            if term.low >= 0 or term.high < 0:
                return self.const(1, -1 if term.high < 0 else 0)
            if term.op is Op.LIN and term.params[1] < 0:  # one normal form for a sign and its complement
                return self.invert(self.extract(self.invert(term), low, width))
        bounds = None
        if low + width == term.width or (term.low >= 0 and term.high >> low < 1 << (width - 1)):
            bounds = (term.low >> low, term.high >> low)
        return self._make(Op.EXTRACT, width, (term,), (low,), bounds=bounds)

    def _extract_of_concat(self, term: Term, low: int, width: int) -> Term:
        parts, at = [], 0
        for part in term.args:
            begin, end = max(low, at), min(low + width, at + part.width)
            if begin < end:
                parts.append(self.extract(part, begin - at, end - begin))
            at += part.width
        return self.concat(parts)

    def _extract_of_extended(self, inner: Term, low: int, width: int, *, is_signed: bool) -> Term:
        if low + width <= inner.width:
            return self.extract(inner, low, width)
        if low < inner.width:
            rest = self.extract(inner, low, inner.width - low)
            return self.sext(rest, width) if is_signed else self.zext(rest, width)
        if not is_signed:
            return self.const(width, 0)
        return self.sext(self.extract(inner, inner.width - 1, 1), width)

    def _extract_of_lin(self, term: Term, low: int, width: int) -> Term | None:
        constant, parts = self.linear_parts(term)
        if low == 0:
            narrow: dict[Term, int] = {}
            for part, c in parts.items():
                less, more = self.linear_parts(self.extract(part, 0, width))
                constant += c * less
                for one, coefficient in more.items():
                    narrow[one] = narrow.get(one, 0) + c * coefficient
            return self.lin(width, constant, narrow)
        unit = 1 << low
        if constant % unit == 0 and all(c % unit == 0 for c in parts.values()):
            # Both sides are taken modulo 2^(term.width - low), where dividing loses nothing.
            rest = self.lin(term.width, constant // unit, {part: c // unit for part, c in parts.items()})
            return self.extract(rest, 0, width)
        above = {part: c for part, c in parts.items() if c % unit == 0}
        below = {part: c for part, c in parts.items() if c % unit}
        least, most = self._lin_bounds(constant % unit, below.items())
        if above and least >= 0 and most < unit:  # two numbers packed into one: the lower does not reach up
            return self.extract(self.lin(term.width, constant - constant % unit, above), low, width)
        return None

    def zext(self, term: Term, width: int) -> Term:
        """More bits, zeros."""
        if width == term.width:
            return term
        if term.width == 1 and not term.is_const:
            return self.neg(self.sext(term, width))  # one normal form of a bit that is made a number
        lifted = self._extend(term, width, 0, (1 << term.width) - 1)
        if lifted is not None:
            return lifted
        if term.op is Op.ZEXT:
            return self.zext(term.args[0], width)
        if term.low >= 0:
            return self.sext(term, width)
        return self._make(Op.ZEXT, width, (term,), bounds=(0, (1 << term.width) - 1))

    def sext(self, term: Term, width: int) -> Term:
        """More bits, the sign."""
        if width == term.width:
            return term
        lifted = self._extend(term, width, -(1 << (term.width - 1)), (1 << (term.width - 1)) - 1)
        if lifted is not None:
            return lifted
        if term.op is Op.SEXT:
            return self.sext(term.args[0], width)
        return self._make(Op.SEXT, width, (term,), bounds=(term.low, term.high))

    def _extend(self, term: Term, width: int, lowest: int, highest: int) -> Term | None:
        """The term in more bits, if its value is known to be read as one in ``lowest..highest`` however it is computed."""
        match term.op:
            case Op.CONST:
                value = term.params[0]
                return self.const(width, value if value >= lowest else value + (1 << term.width))
            case Op.VAR:
                assert term.atom is not None
                if lowest <= term.atom.low and term.atom.high <= highest:
                    return self.var(term.atom, width)
            case Op.LIN if term.width > 1:
                constant, parts = self.linear_parts(term)
                low, high = self._lin_bounds(constant, parts.items())
                turns = -((low - lowest) // (1 << term.width))  # what brings the lower end in
                shift = turns << term.width
                if lowest <= low + shift and high + shift <= highest:
                    terms = [self.times(self.sext(part, width), c) for part, c in parts.items()]
                    return self.add(self.const(width, constant + shift), *terms)
            case Op.ZEXT if lowest < 0 or term.low >= 0:
                return self.zext(term.args[0], width)
            case Op.SEXT if lowest == 0 and term.low >= 0:
                return self.sext(term.args[0], width)
            case Op.ITE if term.width > 1:
                extend = self.zext if lowest == 0 else self.sext
                branches = [(arg, extend(arg, width)) for arg in term.args[1:]]
                if not any(new.op in (Op.ZEXT, Op.SEXT) and new.args[0] is arg for arg, new in branches):
                    return self.ite(term.args[0], *(new for _, new in branches))
            case _:
                pass
        return None

    def concat(self, parts: Sequence[Term]) -> Term:
        """Side by side, the lowest bits first."""
        merged: list[Term] = []
        for part in parts:
            for one in part.args if part.op is Op.CONCAT else (part,):
                joined = self._join(merged[-1], one) if merged else None
                if joined is None:
                    merged.append(one)
                else:
                    merged[-1] = joined
        if len(merged) == 1:
            return merged[0]
        width = sum(part.width for part in merged)
        if width <= 64 and len(merged) == 2:
            low, high = merged
            if high.is_const and high.params[0] == 0:
                return self.zext(low, width)
            if self._is_sign_of(high, low):
                return self.sext(low, width)
        return self._make(Op.CONCAT, width, tuple(merged))

    def _join(self, low: Term, high: Term) -> Term | None:
        if low.is_const and high.is_const:
            return self.const(low.width + high.width, low.unsigned | high.unsigned << low.width)
        if high.op is Op.EXTRACT:
            whole, start = high.args[0], high.params[0]
            if low.op is Op.EXTRACT and low.args[0] is whole and low.params[0] + low.width == start:
                return self.extract(whole, low.params[0], low.width + high.width)
            if start == low.width and self.extract(whole, 0, start) is low:
                return self.extract(whole, 0, start + high.width)
        return None

    def _is_sign_of(self, high: Term, low: Term) -> bool:
        if high.op is not Op.SEXT or high.args[0].width != 1:
            return False
        return high.args[0] is self.extract(low, low.width - 1, 1)

    # Bits ------------------------------------------------------------------------------------------------------------

    def bit_and(self, x: Term, y: Term) -> Term:
        """``x & y``."""
        if x is y:
            return x
        if x.is_const:
            x, y = y, x
        if y.is_const:
            return self._masked(x, y.unsigned)
        for mask, other in ((x, y), (y, x)):
            if mask.op is Op.SEXT and mask.args[0].width == 1:
                return self.ite(mask.args[0], other, self.const(x.width, 0))
        lanes = self._by_lanes(self.bit_and, x, y)
        if lanes is not None:
            return lanes
        bounds = None
        if x.low >= 0 or y.low >= 0:
            bounds = (0, min(one.high for one in (x, y) if one.low >= 0))
        return self._make(Op.AND, x.width, self._ordered(x, y), bounds=bounds)

    def _by_lanes(self, operation: Callable[[Term, Term], Term], x: Term, y: Term) -> Term | None:
        """A bitwise operation on each lane of two vectors, None if they are no vectors of lanes that meet."""
        if Op.CONCAT not in (x.op, y.op):
            return None
        edges = sorted(_edges(x) & _edges(y))
        if len(edges) < 3:
            return None
        lanes = [(low, high - low) for low, high in pairwise(edges)]
        return self.concat([operation(self.extract(x, *lane), self.extract(y, *lane)) for lane in lanes])

    def _masked(self, x: Term, mask: int) -> Term:
        if x.is_const:
            return self.const(x.width, x.unsigned & mask)
        if mask == 0:
            return self.const(x.width, 0)
        if mask == (1 << x.width) - 1:
            return x
        low = (mask & -mask).bit_length() - 1
        run = mask >> low
        if run & (run + 1) == 0:
            kept = self.extract(x, low, run.bit_length())
            return self.shl(self.zext(kept, x.width), low)
        bounds = (0, mask) if mask < 1 << (x.width - 1) else None
        return self._make(Op.AND, x.width, (x, self.const(x.width, mask)), bounds=bounds)

    def bit_or(self, x: Term, y: Term) -> Term:
        """``x | y``."""
        if x is y:
            return x
        if x.is_const:
            x, y = y, x
        if y.is_const:
            if y.params[0] == 0:
                return x
            if y.params[0] == -1:
                return y
            if x.is_const:
                return self.const(x.width, x.params[0] | y.params[0])
        for mask, other in ((x, y), (y, x)):
            if mask.op is Op.SEXT and mask.args[0].width == 1:
                return self.ite(mask.args[0], self.const(x.width, -1), other)
            if other.low >= 0 and self._multiple_of(mask, 1 << other.high.bit_length()):
                return self.add(x, y)  # no bit is set in both
        lanes = self._by_lanes(self.bit_or, x, y)
        if lanes is not None:
            return lanes
        return self._make(Op.OR, x.width, self._ordered(x, y), bounds=self._bits_bounds(x, y))

    def bit_xor(self, x: Term, y: Term) -> Term:
        """``x ^ y``."""
        if x is y:
            return self.const(x.width, 0)
        if x.is_const:
            x, y = y, x
        if y.is_const:
            if y.params[0] == 0:
                return x
            if y.params[0] == -1:
                return self.invert(x)
            if x.is_const:
                return self.const(x.width, x.params[0] ^ y.params[0])
        if x.width == 1:
            return self.add(x, y)
        for mask, other in ((x, y), (y, x)):
            if mask.op is Op.SEXT and mask.args[0].width == 1:
                return self.ite(mask.args[0], self.invert(other), other)
        lanes = self._by_lanes(self.bit_xor, x, y)
        if lanes is not None:
            return lanes
        return self._make(Op.XOR, x.width, self._ordered(x, y), bounds=self._bits_bounds(x, y))

    @staticmethod
    def _bits_bounds(x: Term, y: Term) -> tuple[int, int]:
        bits = max(max(-1 - one.low, one.high, 0).bit_length() for one in (x, y))
        return (0 if x.low >= 0 and y.low >= 0 else -(1 << bits)), (1 << bits) - 1

    def _multiple_of(self, term: Term, unit: int) -> bool:
        constant, parts = self.linear_parts(term)
        return gcd(constant, *parts.values()) % unit == 0

    @staticmethod
    def _ordered(x: Term, y: Term) -> tuple[Term, Term]:
        return (x, y) if x.number <= y.number else (y, x)

    # Choices ---------------------------------------------------------------------------------------------------------

    def ite(self, condition: Term, then: Term, otherwise: Term) -> Term:
        """``then`` where the one bit of ``condition`` is set, else ``otherwise``."""
        if condition.is_const:
            return then if condition.params[0] else otherwise
        if then is otherwise:
            return then
        if condition.op is Op.LIN and condition.params[0] == -1 and len(condition.args) == 1:
            return self.ite(condition.args[0], otherwise, then)
        if then.width > 1 and not otherwise.is_const and self._are_complements(then, otherwise):
            # x ^ mask, where what follows is mostly - mask: then it is x or -x.
            if otherwise.op is Op.LIN and otherwise.params[1] < 0:  # the mask is the complement of the condition's
                chosen = self.ite(condition, then, self.neg(then))
                return self.scaled_sum(then.width, -1, [(chosen, 1), (self.sext(condition, then.width), -1)])
            return self.add(self.ite(condition, self.neg(otherwise), otherwise), self.sext(condition, then.width))
        if then.width == 1:
            if then.is_const:
                if then.params[0]:
                    return self.bit_or(condition, otherwise)
                return self.bit_and(self.invert(condition), otherwise)
            if otherwise.is_const:
                if otherwise.params[0]:
                    return self.bit_or(self.invert(condition), then)
                return self.bit_and(condition, then)
        elif _is_mask(then) and _is_mask(otherwise):
            bits = (self.extract(one, 0, 1) for one in (then, otherwise))
            return self.sext(self.ite(condition, *bits), then.width)
        bounds = self._chosen_bounds(condition, then, otherwise)
        return self._make(Op.ITE, then.width, (condition, then, otherwise), bounds=bounds)

    def _chosen_bounds(self, condition: Term, then: Term, otherwise: Term) -> tuple[int, int]:
        """Of a choice; closer ones if it is a minimum or maximum."""
        choose = None
        if condition.op is Op.SLT and {*condition.args} == {then, otherwise}:
            choose = min if condition.args[0] is then else max
        elif condition.op is Op.EXTRACT and condition.width == 1 and condition.args[0].width == then.width:
            sign_of = condition.args[0]  # a difference that `slt` found not to wrap, or its complement
            wraps = not _fits(then.low - otherwise.high - 1, then.high - otherwise.low, then.width)
            wraps = wraps or not _fits(otherwise.low - then.high - 1, otherwise.high - then.low, then.width)
            if condition.params[0] == then.width - 1 and not wraps:
                if self._distance(sign_of, then, otherwise) in (0, -1):
                    choose = min
                elif self._distance(sign_of, otherwise, then) in (0, -1):
                    choose = max
        if choose is None:
            return min(then.low, otherwise.low), max(then.high, otherwise.high)
        return choose(then.low, otherwise.low), choose(then.high, otherwise.high)

    def _distance(self, term: Term, x: Term, y: Term) -> int | None:
        """``term - (x - y)``, if that is a known number."""
        constant, parts = self._combined([(term, 1), (x, -1), (y, 1)])
        constant, left = _normal(term.width, constant, parts)
        return None if left else constant

    def _are_complements(self, x: Term, y: Term) -> bool:
        if _is_mask(x) and _is_mask(y):
            return self.invert(y) is x  # which is no sum then
        constant, parts = self._combined([(x, 1), (y, 1)])
        return _normal(x.width, constant + 1, parts) == (0, [])

    def eq(self, x: Term, y: Term) -> Term:
        """One bit: whether they are equal."""
        if x is y:
            return self.const(1, 1)
        if x.high < y.low or y.high < x.low:
            return self.const(1, 0)
        if x.is_const and y.is_const:
            return self.const(1, x.params[0] == y.params[0])
        return self._make(Op.EQ, 1, self._ordered(x, y))

    def slt(self, x: Term, y: Term) -> Term:
        """One bit: whether ``x < y``, both signed."""
        if x.high < y.low:
            return self.const(1, 1)
        if x.low >= y.high:
            return self.const(1, 0)
        if _fits(x.low - y.high, x.high - y.low, x.width):
            return self.extract(self.sub(x, y), x.width - 1, 1)
        return self._make(Op.SLT, 1, (x, y))

    def ult(self, x: Term, y: Term) -> Term:
        """One bit: whether ``x < y``, both unsigned."""
        if x.low >= 0 and y.low >= 0:
            return self.slt(x, y)
        if x.is_const and y.is_const:
            return self.const(1, x.unsigned < y.unsigned)
        if x is y:
            return self.const(1, 0)
        return self._make(Op.ULT, 1, (x, y))


def cone(roots: Iterable[Term]) -> list[Term]:
    """All terms that the roots are made of, each after its arguments."""
    found: dict[int, Term] = {}
    waiting = list(roots)
    while waiting:
        term = waiting.pop()
        if term.number not in found:
            found[term.number] = term
            waiting.extend(term.args)
    return [found[number] for number in sorted(found)]


def substituted(terms: Terms, roots: Sequence[Term], values: Mapping[Atom | None, Term]) -> list[Term]:
    """Terms with other terms, in signed reading, for some of their atoms."""
    if not values:
        return list(roots)
    done: dict[int, Term] = {}
    for one in cone(roots):
        if one.atom is not None and one.atom in values:
            done[one.number] = resized(terms, values[one.atom], one.width)
        else:
            done[one.number] = rebuild(terms, one, [done[arg.number] for arg in one.args])
    return [done[root.number] for root in roots]


def resized(terms: Terms, term: Term, width: int) -> Term:
    """A term in fewer or, by its sign, in more bits."""
    return terms.extract(term, 0, width) if width <= term.width else terms.sext(term, width)


def rebuild(terms: Terms, term: Term, args: Sequence[Term]) -> Term:
    """The term with other arguments of the same widths, in normal form."""
    if all(map(operator.is_, args, term.args)):
        return term
    match term.op:
        case Op.CONST | Op.VAR:
            return term
        case Op.LIN:
            return terms.scaled_sum(term.width, term.params[0], zip(args, term.params[1:], strict=True))
        case Op.EXTRACT:
            return terms.extract(args[0], term.params[0], term.width)
        case Op.ZEXT:
            return terms.zext(args[0], term.width)
        case Op.SEXT:
            return terms.sext(args[0], term.width)
        case Op.CONCAT:
            return terms.concat(args)
        case Op.AND:
            return terms.bit_and(*args)
        case Op.OR:
            return terms.bit_or(*args)
        case Op.XOR:
            return terms.bit_xor(*args)
        case Op.ITE:
            return terms.ite(*args)
        case Op.EQ:
            return terms.eq(*args)
        case Op.SLT:
            return terms.slt(*args)
        case Op.ULT:
            return terms.ult(*args)
        case Op.MUL:
            return terms.mul(*args)
