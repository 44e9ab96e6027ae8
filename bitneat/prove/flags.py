# SPDX-License-Identifier: MIT
"""What a processor's flags say, from the operation that set them: VEX leaves that to helper functions, which are these.

VEX keeps flags as the number of the operation and its operands. The numbering and which operand is where are those of
Valgrind's ``libvex`` (``guest_amd64_defs.h``, ``guest_arm_defs.h``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bitneat.prove.terms import Term, Terms


class UnsupportedError(Exception):
    """Something that this package does not model, so that nothing can be said about it."""


@dataclass(frozen=True, slots=True)
class Flags:
    """One bit each: negative, zero, carry (on x86 also borrow), overflow. What was not worked out is None."""

    negative: Term
    zero: Term
    carry: Term | None
    overflow: Term | None


def _known(term: Term, what: str) -> int:
    if not term.is_const:
        raise UnsupportedError(f"{what} depends on data or was never set")
    return term.unsigned


def _sign(terms: Terms, x: Term) -> Term:
    return terms.extract(x, x.width - 1, 1)


def _is_zero(terms: Terms, x: Term) -> Term:
    return terms.eq(x, terms.const(x.width, 0))


def _of_addition(terms: Terms, x: Term, y: Term, carry: Term | None) -> Flags:
    total = terms.add(x, y) if carry is None else terms.add(x, y, terms.zext(carry, x.width))
    out = terms.ult(total, x)
    if carry is not None:
        out = terms.ite(carry, terms.invert(terms.ult(x, total)), out)
    overflow = terms.bit_and(terms.bit_xor(total, x), terms.bit_xor(total, y))
    return Flags(_sign(terms, total), _is_zero(terms, total), out, _sign(terms, overflow))


def _of_subtraction(terms: Terms, x: Term, y: Term, borrow: Term | None) -> Flags:
    """Carry is the borrow, as on x86."""
    rest = terms.sub(x, y) if borrow is None else terms.sub(terms.sub(x, y), terms.zext(borrow, x.width))
    out = terms.ult(x, y)
    if borrow is not None:
        out = terms.ite(borrow, terms.invert(terms.ult(y, x)), out)
    overflow = terms.bit_and(terms.bit_xor(x, y), terms.bit_xor(x, rest))
    return Flags(
        _sign(terms, rest), terms.eq(x, y) if borrow is None else _is_zero(terms, rest), out, _sign(terms, overflow)
    )


# x86-64 --------------------------------------------------------------------------------------------------------------

_AMD64_KINDS = ("add", "sub", "adc", "sbb", "logic", "inc", "dec", "shl", "shr")


def amd64_flags(terms: Terms, operation: Term, dep1: Term, dep2: Term, ndep: Term) -> Flags:
    """The flags after an operation; the parity flag is not among them."""
    number = _known(operation, "the flags")
    if not 1 <= number <= 4 * len(_AMD64_KINDS):
        raise UnsupportedError(f"flags of x86-64 operation {number}")
    kind, width = _AMD64_KINDS[(number - 1) // 4], 8 << (number - 1) % 4
    x, y, z = (terms.extract(one, 0, width) for one in (dep1, dep2, ndep))
    none = terms.const(1, 0)
    match kind:
        case "add":
            return _of_addition(terms, x, y, None)
        case "sub":
            return _of_subtraction(terms, x, y, None)
        case "adc" | "sbb":
            carry = terms.extract(z, 0, 1)
            second = terms.bit_xor(y, terms.zext(carry, width))
            of = _of_addition if kind == "adc" else _of_subtraction
            return of(terms, x, second, carry)
        case "logic":
            return Flags(_sign(terms, x), _is_zero(terms, x), none, none)
        case "inc" | "dec":
            edge = terms.const(width, 1 << (width - 1) if kind == "inc" else (1 << (width - 1)) - 1)
            return Flags(_sign(terms, x), _is_zero(terms, x), terms.extract(z, 0, 1), terms.eq(x, edge))
        case _:
            # dep2 is the operand shifted by one less; overflow is defined for shifts by one only, and nobody asks for it.
            carry = terms.extract(y, width - 1 if kind == "shl" else 0, 1)
            return Flags(_sign(terms, x), _is_zero(terms, x), carry, None)


def amd64_condition(terms: Terms, condition: Term, operation: Term, dep1: Term, dep2: Term, ndep: Term) -> Term:
    """One bit: whether a condition code of x86-64 holds."""
    code = _known(condition, "a condition code")
    number = _known(operation, "the flags")
    if 5 <= number <= 8 and code >> 1 in (6, 7):  # after a comparison: signed less, without going by the flags
        width = 8 << (number - 1) % 4
        x, y = terms.extract(dep1, 0, width), terms.extract(dep2, 0, width)
        less = terms.slt(x, y) if code >> 1 == 6 else terms.invert(terms.slt(y, x))
        return terms.invert(less) if code & 1 else less
    flags = amd64_flags(terms, operation, dep1, dep2, ndep)
    chosen = _choose(
        terms,
        flags,
        code >> 1,
        {0: "overflow", 1: "carry", 2: "zero", 3: "below", 4: "negative", 6: "less", 7: "less or zero"},
        "x86-64",
    )
    return terms.invert(chosen) if code & 1 else chosen


def amd64_carry(terms: Terms, operation: Term, dep1: Term, dep2: Term, ndep: Term) -> Term:
    """The carry flag as one bit."""
    carry = amd64_flags(terms, operation, dep1, dep2, ndep).carry
    assert carry is not None
    return carry


def _choose(terms: Terms, flags: Flags, code: int, names: dict[int, str], processor: str) -> Term:
    carry, overflow = flags.carry, flags.overflow
    match names.get(code):
        case "zero":
            return flags.zero
        case "negative":
            return flags.negative
        case "carry" if carry is not None:
            return carry
        case "overflow" if overflow is not None:
            return overflow
        case "below" if carry is not None:
            return terms.bit_or(carry, flags.zero)
        case "above" if carry is not None:
            return terms.bit_and(carry, terms.invert(flags.zero))
        case "at least" if overflow is not None:
            return terms.invert(terms.bit_xor(flags.negative, overflow))
        case "less" if overflow is not None:
            return terms.bit_xor(flags.negative, overflow)
        case "greater" if overflow is not None:
            return terms.invert(terms.bit_or(flags.zero, terms.bit_xor(flags.negative, overflow)))
        case "less or zero" if overflow is not None:
            return terms.bit_or(flags.zero, terms.bit_xor(flags.negative, overflow))
        case _:
            raise UnsupportedError(f"condition {code} of {processor}")


# ARM -----------------------------------------------------------------------------------------------------------------


def arm_flags(terms: Terms, operation: Term, dep1: Term, dep2: Term, dep3: Term) -> Flags:
    """The flags after an operation; carry is the complement of the borrow, as on ARM."""
    match _known(operation, "the flags"):
        case 0:
            return Flags(*(terms.extract(dep1, bit, 1) for bit in (31, 30, 29, 28)))
        case 1:
            return _of_addition(terms, dep1, dep2, None)
        case 2:
            flags = _of_subtraction(terms, dep1, dep2, None)
        case 3:
            return _of_addition(terms, dep1, dep2, terms.extract(dep3, 0, 1))
        case 4:
            flags = _of_subtraction(terms, dep1, dep2, terms.invert(terms.extract(dep3, 0, 1)))
        case 5:
            carry, overflow = terms.extract(dep2, 0, 1), terms.extract(dep3, 0, 1)
            return Flags(_sign(terms, dep1), _is_zero(terms, dep1), carry, overflow)
        case 6:
            carry, overflow = terms.extract(dep3, 1, 1), terms.extract(dep3, 0, 1)
            return Flags(_sign(terms, dep1), _is_zero(terms, dep1), carry, overflow)
        case number:
            raise UnsupportedError(f"flags of ARM operation {number}")
    assert flags.carry is not None
    return Flags(flags.negative, flags.zero, terms.invert(flags.carry), flags.overflow)


def arm_condition(terms: Terms, both: Term, dep1: Term, dep2: Term, dep3: Term) -> Term:
    """One bit: whether a condition code of ARM holds; ``both`` has it above the number of the operation."""
    number = _known(both, "the flags")
    code, operation = number >> 4, terms.const(32, number & 15)
    if code >> 1 == 7:
        return terms.const(1, 1)
    if number & 15 == 2 and code >> 1 in (5, 6):  # after a comparison
        less = terms.slt(dep1, dep2) if code >> 1 == 5 else terms.invert(terms.slt(dep2, dep1))
        return less if code & 1 else terms.invert(less)
    chosen = _choose(
        terms,
        arm_flags(terms, operation, dep1, dep2, dep3),
        code >> 1,
        {0: "zero", 1: "carry", 2: "negative", 3: "overflow", 4: "above", 5: "at least", 6: "greater"},
        "ARM",
    )
    return terms.invert(chosen) if code & 1 else chosen


Helper = Callable[[Terms, list[Term]], Term]

HELPERS: dict[str, Helper] = {
    "amd64g_calculate_condition": lambda terms, args: terms.zext(amd64_condition(terms, *args), 64),
    "amd64g_calculate_rflags_c": lambda terms, args: terms.zext(amd64_carry(terms, *args), 64),
    "armg_calculate_condition": lambda terms, args: terms.zext(arm_condition(terms, *args), 32),
    "armg_calculate_flag_n": lambda terms, args: terms.zext(arm_flags(terms, *args).negative, 32),
    "armg_calculate_flag_z": lambda terms, args: terms.zext(arm_flags(terms, *args).zero, 32),
    "armg_calculate_flag_c": lambda terms, args: terms.zext(_set(arm_flags(terms, *args).carry), 32),
    "armg_calculate_flag_v": lambda terms, args: terms.zext(_set(arm_flags(terms, *args).overflow), 32),
}
"""By the name that VEX calls them."""


def _set(flag: Term | None) -> Term:
    if flag is None:
        raise UnsupportedError("a flag that this operation leaves undefined")
    return flag
