# SPDX-License-Identifier: MIT
"""Questions to SMT solvers: whether two terms can differ for values of their atoms within bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from bitneat.prove.terms import Atom, Op, Term, cone

Outcome = Literal["equal", "differ", "unknown"]

SOLVERS = ("bitwuzla", "z3")
"""By the name of the module; the first answers, the second is asked too when answers are to be cross-checked."""


class SolverDisagreementError(Exception):
    """Two solvers give opposite answers to the same question: at least one is wrong, so nothing can be believed."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What was found, and values of the atoms for which the terms differ, if they can."""

    outcome: Outcome
    model: Mapping[Atom, int] | None = None


def differ(
    left: Term, right: Term, *, seconds: float, paranoid: bool = False, known: Sequence[tuple[Term, Term]] = ()
) -> Answer:
    """Whether two terms of the same width can differ.

    Args:
        left: one.
        right: the other.
        seconds: how long a solver may think.
        paranoid: ask two solvers, and believe only what both say.
        known: pairs of terms that are equal, which tie atoms to each other.

    Raises:
        SolverDisagreementError: if they contradict each other.
    """
    text, names = smtlib(left, right, known)
    answers = [queries_by[name](text, names, seconds) for name in SOLVERS[: 2 if paranoid else 1]]
    outcomes = {answer.outcome for answer in answers}
    if {"equal", "differ"} <= outcomes:
        raise SolverDisagreementError(f"{' and '.join(SOLVERS)} disagree about:\n{text}")
    if outcomes == {"equal"}:
        return answers[0]
    return next((one for one in answers if one.outcome == "differ"), Answer("unknown"))


def _width(atom: Atom) -> int:
    return max(atom.high.bit_length(), (-1 - atom.low).bit_length()) + 1


def smtlib(left: Term, right: Term, known: Sequence[tuple[Term, Term]] = ()) -> tuple[str, dict[str, Atom]]:
    """The question in SMT-LIB 2, satisfiable iff the terms can differ; and which atom each constant stands for."""
    roots = [left, right, *(term for pair in known for term in pair)]
    names: dict[Atom, str] = {}
    lines = ["(set-logic QF_BV)", "(set-option :produce-models true)"]
    body: list[str] = []
    for term in cone(roots):
        if term.atom is not None and term.atom not in names:
            atom, width = term.atom, _width(term.atom)
            name = names[atom] = f"a{len(names)}"
            lines.append(f"(declare-const {name} (_ BitVec {width}))")
            lines.append(f"(assert (bvsle {_number(width, atom.low)} {name}))")
            lines.append(f"(assert (bvsle {name} {_number(width, atom.high)}))")
        body.append(f"(define-fun t{term.number} () (_ BitVec {term.width}) {_expression(term, names)})")
    lines += body
    lines += [f"(assert (= t{one.number} t{other.number}))" for one, other in known]
    lines.append(f"(assert (distinct t{left.number} t{right.number}))")
    return "\n".join([*lines, "(check-sat)"]) + "\n", {name: atom for atom, name in names.items()}


def _number(width: int, value: int) -> str:
    return f"(_ bv{value & ((1 << width) - 1)} {width})"


def _resized(name: str, width: int, wanted: int) -> str:
    if wanted > width:
        return f"((_ sign_extend {wanted - width}) {name})"
    return name if wanted == width else f"((_ extract {wanted - 1} 0) {name})"


def _expression(term: Term, names: Mapping[Atom, str]) -> str:
    args = [f"t{arg.number}" for arg in term.args]
    match term.op:
        case Op.CONST:
            return _number(term.width, term.params[0])
        case Op.VAR:
            assert term.atom is not None
            return _resized(names[term.atom], _width(term.atom), term.width)
        case Op.LIN:
            total = _number(term.width, term.params[0])
            for arg, c in zip(args, term.params[1:], strict=True):
                size = abs(c)
                if size & (size - 1) == 0:
                    shift = size.bit_length() - 1
                    piece = f"(bvshl {arg} {_number(term.width, shift)})" if shift else arg
                else:
                    piece = f"(bvmul {arg} {_number(term.width, size)})"
                total = f"({'bvadd' if c > 0 else 'bvsub'} {total} {piece})"
            return total
        case Op.EXTRACT:
            low = term.params[0]
            return f"((_ extract {low + term.width - 1} {low}) {args[0]})"
        case Op.ZEXT | Op.SEXT:
            kind = "zero_extend" if term.op is Op.ZEXT else "sign_extend"
            return f"((_ {kind} {term.width - term.args[0].width}) {args[0]})"
        case Op.CONCAT:
            return f"(concat {' '.join(reversed(args))})"
        case Op.AND | Op.OR | Op.XOR | Op.MUL:
            return f"(bv{term.op.value} {' '.join(args)})"
        case Op.ITE:
            return f"(ite (= {args[0]} #b1) {args[1]} {args[2]})"
        case Op.EQ:
            return f"(ite (= {args[0]} {args[1]}) #b1 #b0)"
        case Op.SLT | Op.ULT:
            return f"(ite (bv{term.op.value} {args[0]} {args[1]}) #b1 #b0)"


def _ask_bitwuzla(text: str, names: Mapping[str, Atom], seconds: float) -> Answer:
    bitwuzla: Any = import_module("bitwuzla")
    manager = bitwuzla.TermManager()
    options = bitwuzla.Options()
    options.set(bitwuzla.Option.PRODUCE_MODELS, True)
    options.set(bitwuzla.Option.TIME_LIMIT_PER, int(1000 * seconds))
    parser = bitwuzla.Parser(manager, options)
    parser.parse(text.replace("(check-sat)\n", ""), True, False)
    solver = parser.bitwuzla()
    result = solver.check_sat()
    if result == bitwuzla.Result.UNSAT:
        return Answer("equal")
    if result != bitwuzla.Result.SAT:
        return Answer("unknown")
    constants = {str(one.symbol()): one for one in parser.get_declared_funs()}
    model = {
        atom: _signed(int(solver.get_value(constants[name]).value(10)), _width(atom)) for name, atom in names.items()
    }
    return Answer("differ", model)


def _ask_z3(text: str, names: Mapping[str, Atom], seconds: float) -> Answer:
    z3: Any = import_module("z3")
    solver = z3.SolverFor("QF_BV")
    solver.set("timeout", int(1000 * seconds))
    solver.from_string(text)
    result = solver.check()
    if result == z3.unsat:
        return Answer("equal")
    if result != z3.sat:
        return Answer("unknown")
    model = solver.model()
    values = {}
    for name, atom in names.items():
        value = model.eval(z3.BitVec(name, _width(atom)), model_completion=True)
        values[atom] = int(value.as_signed_long())
    return Answer("differ", values)


def _signed(value: int, width: int) -> int:
    return value - (1 << width) if value >> (width - 1) else value


queries_by = {"bitwuzla": _ask_bitwuzla, "z3": _ask_z3}
"""How each solver is asked."""
