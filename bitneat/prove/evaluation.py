# SPDX-License-Identifier: MIT
"""Values of terms: many samples at a time, or every value that a sum can have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from bitneat.prove.terms import Atom, Op, Term, cone

Values = npt.NDArray[np.uint64]
"""The value of a term at each sample, modulo 2^width; of terms of at most 64 bits."""


def _evaluate(term: Term, args: Sequence[Values], atoms: Mapping[Atom, npt.NDArray[np.int64]]) -> Values:
    """A term's values, given those of its arguments and of the atoms; of a term of at most 64 bits."""
    width = term.width
    mask = np.uint64((1 << width) - 1)
    match term.op:
        case Op.CONST:
            return np.full(1, term.unsigned, dtype=np.uint64)
        case Op.VAR:
            assert term.atom is not None
            return atoms[term.atom].astype(np.uint64) & mask
        case Op.LIN:
            total = np.full(1, term.params[0] & ((1 << 64) - 1), dtype=np.uint64)
            for arg, c in zip(args, term.params[1:], strict=True):
                total = total + (arg if c == 1 else arg * np.uint64(c & ((1 << 64) - 1)))
            return total & mask
        case Op.EXTRACT:
            return (args[0] >> np.uint64(term.params[0])) & mask
        case Op.ZEXT:
            return args[0]
        case Op.SEXT:
            return signed_values(args[0], term.args[0].width).astype(np.uint64) & mask
        case Op.CONCAT:
            total, at = np.zeros(1, dtype=np.uint64), 0
            for arg, part in zip(args, term.args, strict=True):
                total, at = total | arg << np.uint64(at), at + part.width
            return total
        case Op.AND:
            return args[0] & args[1]
        case Op.OR:
            return args[0] | args[1]
        case Op.XOR:
            return args[0] ^ args[1]
        case Op.ITE:
            return np.where(args[0] != 0, args[1], args[2])
        case Op.EQ:
            return np.equal(args[0], args[1]).astype(np.uint64)
        case Op.SLT:
            x, y = (signed_values(arg, part.width) for arg, part in zip(args, term.args, strict=True))
            return (x < y).astype(np.uint64)
        case Op.ULT:
            return (args[0] < args[1]).astype(np.uint64)
        case Op.MUL:
            return (args[0] * args[1]) & mask


def signed_values(values: Values, width: int) -> npt.NDArray[np.int64]:
    """Values of a term in signed reading."""
    shifted: npt.NDArray[np.int64] = (values << np.uint64(64 - width)).view(np.int64) >> np.int64(64 - width)
    return shifted


def each_value(
    order: Sequence[Term], atoms: Mapping[Atom, npt.NDArray[np.int64]]
) -> Iterator[tuple[Term, Values | None]]:
    """Terms, each after its arguments, with their values, which are let go of when nothing needs them any more.

    A term of more than 64 bits has none.
    """
    needed = dict.fromkeys((term.number for term in order), 0)
    for term in order:
        for arg in term.args:
            needed[arg.number] += 1
    found: dict[int, Values] = {}
    for term in order:
        values = None
        if term.width <= 64:
            values = _evaluate(term, [found[arg.number] for arg in term.args], atoms)
            if needed[term.number]:
                found[term.number] = values
        for arg in term.args:
            needed[arg.number] -= 1
            if not needed[arg.number]:
                found.pop(arg.number, None)
        yield term, values


def values_of(roots: Sequence[Term], atoms: Mapping[Atom, npt.NDArray[np.int64]]) -> list[Values]:
    """The roots' values; of terms of at most 64 bits."""
    wanted = {root.number for root in roots}
    found = {term.number: value for term, value in each_value(cone(roots), atoms) if term.number in wanted}
    return [_there(found[root.number]) for root in roots]


def _there(values: Values | None) -> Values:
    assert values is not None
    return values
