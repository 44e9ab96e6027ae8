# SPDX-License-Identifier: MIT
"""Prints an activation's program as a C function.

The argument and the result are signals in two's complement in a ``uint32_t``. All arithmetic is unsigned: it wraps where a
signed sum would, so that nothing in it is undefined or implementation-defined, and a comparison is the sign bit of a
difference, so that nothing in it branches.
"""

from __future__ import annotations

from dataclasses import dataclass

from bitneat.controller.activation import CONSTANT_BITS, PROGRAMS, Op, Program, Step, constant

HELPERS_OF_OP = {Op.MIN: "min", Op.MAX: "max", Op.COPYSIGN: "copysign"}


@dataclass(frozen=True, slots=True)
class Kernel:
    """A C function body: ``statements``, then ``return result``; ``helpers`` are the functions that it calls."""

    name: str
    formula: str
    statements: tuple[str, ...]
    result: str
    helpers: frozenset[str]
    takes_frac_bits: bool
    """Whether the function has a second parameter ``f``."""


def kernel(activation: str, prefix: str, frac_bits: int | None) -> Kernel:
    """The body of ``prefix_act_NAME(uint32_t u)``; for any F the function may have a second parameter ``f``.

    Args:
        activation: one of the ten names.
        prefix: what the names of the helper functions start with.
        frac_bits: F, or None to print code for an F that is known at run time only, in ``f``.
    """
    program = PROGRAMS[activation]
    names = ["u"]
    statements: list[str] = []
    hidden = _sums_of_shifts(program)
    for number, step in enumerate(program.steps, start=1):
        text = _expression(step, names[step.x], names[step.y], prefix, frac_bits)
        if step in hidden:
            text = f"{prefix}_opaque({text})"
        if step.op in (Op.CONST, Op.INT) or number == len(program.steps):
            names.append(text)
        else:
            names.append(f"t{number}")
            statements.append(f"const uint32_t t{number} = {text};")
    helpers = frozenset(HELPERS_OF_OP[step.op] for step in program.steps if step.op in HELPERS_OF_OP)
    if hidden:
        helpers |= {"opaque"}
    takes_frac_bits = frac_bits is None and _depends_on_frac_bits(program)
    return Kernel(activation, program.formula, tuple(statements), names[-1], helpers, takes_frac_bits)


def _depends_on_frac_bits(program: Program) -> bool:
    return any(step.op in (Op.CONST, Op.SHL_F, Op.LOW, Op.BIT) for step in program.steps)


def _sums_of_shifts(program: Program) -> frozenset[Step]:
    """Left shifts of a value that is shifted by other amounts too: to a compiler their sum is a multiplication."""
    amounts: dict[int, set[int]] = {}
    for step in program.steps:
        if step.op is Op.SHL:
            amounts.setdefault(step.x, set()).add(step.k)
    return frozenset(step for step in program.steps if step.op is Op.SHL and len(amounts[step.x]) > 1)


def _expression(step: Step, x: str, y: str, prefix: str, frac_bits: int | None) -> str:
    match step.op:
        case Op.CONST | Op.INT:
            return _constant(step, frac_bits)
        case Op.ADD:
            return f"{x} + {y}"
        case Op.SUB:
            return f"{x} - {y}"
        case Op.SHL:
            return f"{x} << {step.k}"
        case Op.SHR:
            return f"{x} >> {step.k}"
        case Op.SHL_F:
            return f"{x} << {'f' if frac_bits is None else frac_bits}"
        case Op.LOW:
            if frac_bits is None:
                return f"{x} & ((UINT32_C(1) << (f + {step.k}U)) - 1U)"
            return f"{x} & UINT32_C({(1 << (frac_bits + step.k)) - 1})"
        case Op.BIT:
            if frac_bits is None:
                return f"{x} & (UINT32_C(1) << (f + {step.k}U))"
            return f"{x} & UINT32_C({1 << (frac_bits + step.k)})"
        case Op.MIN | Op.MAX | Op.COPYSIGN:  # pragma: no branch - there is no other Op, as mypy checks
            return f"{prefix}_{HELPERS_OF_OP[step.op]}({x}, {y})"


def _constant(step: Step, frac_bits: int | None) -> str:
    if step.op is Op.INT or frac_bits is not None:
        # Of 32 bits even where an int has 16: `0U - 256U` would be 65280 there.
        return f"UINT32_C({constant(step, frac_bits or CONSTANT_BITS)})"
    if step.k > CONSTANT_BITS - 4:
        raise ValueError("a constant with more bits than F = 4 leaves room for")
    below = CONSTANT_BITS - step.k
    if below == CONSTANT_BITS:
        return f"(UINT32_C({step.value}) >> ({CONSTANT_BITS}U - f))"
    return f"(UINT32_C({step.value}) << (f - {below}U))"
