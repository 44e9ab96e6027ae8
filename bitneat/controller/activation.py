# SPDX-License-Identifier: MIT
"""The ten activations, each described once.

A description is a `Program`: a short straight-line list of additions, subtractions, constant shifts, masks, minima and maxima
that maps a signal to a signal. It is the definition of the activation. The reference evaluates it in exact integers, the C
is printed from it, the tables of the documentation are drawn from it and proofs start from it.

The smooth functions follow neat-python's scaling (``tanh(2.5 z)``, ``sigmoid(5 z)``, ``sin(5 z)``, ``exp(-5 z²)``) and are
built from straight lines whose slopes are sums or differences of at most two powers of two. A concave function is a minimum of such
lines and a convex one a maximum, so no comparison ever turns into a branch.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # numpy takes longer to import than all of code generation, which seldom needs a table
    import numpy as np
    import numpy.typing as npt

    IntArray = npt.NDArray[np.int64]

IntLike = TypeVar("IntLike", int, "IntArray")

CONSTANT_BITS = 12
"""Constants are kept at the finest resolution, F = 12, and lose their lowest bits where F is smaller."""


class Op(enum.Enum):
    """What one step of a program does with its operands x and y and its parameter k; every ``>>`` is a floor."""

    CONST = "constant"
    """The constant ``value * 2^(F + k - 12)``, rounded down."""
    INT = "integer"
    """The plain integer ``value``, whatever F is."""
    ADD = "x + y"
    SUB = "x - y"
    SHL = "x << k"
    SHR = "x >> k"
    SHL_F = "x << F"
    LOW = "x & (2^(F+k) - 1)"
    BIT = "x & 2^(F+k)"
    MIN = "min(x, y)"
    MAX = "max(x, y)"
    COPYSIGN = "x if y >= 0 else -x"


@dataclass(frozen=True, slots=True)
class Step:
    """One operation: ``x`` and ``y`` number earlier values (0 is the argument, i the result of step i-1)."""

    op: Op
    x: int = 0
    y: int = 0
    k: int = 0
    value: int = 0


@dataclass(frozen=True, slots=True)
class Program:
    """A straight-line description of an activation; the value of the last step is the result."""

    name: str
    formula: str
    steps: tuple[Step, ...]

    def __call__(self, u: IntLike, frac_bits: int) -> IntLike:
        """Evaluate at ``u`` (an int or an int64 array, in -32767..32767) for F = ``frac_bits``, exactly."""
        values = [u]
        for step in self.steps:
            values.append(_apply(step, values[step.x], values[step.y], frac_bits))
        return values[-1]


def constant(step: Step, frac_bits: int) -> int:
    """The number that a CONST or INT step stands for at F = ``frac_bits``."""
    if step.op is Op.INT:
        return step.value
    exponent = frac_bits + step.k - CONSTANT_BITS
    return step.value << exponent if exponent >= 0 else step.value >> -exponent


def _apply(step: Step, x: IntLike, y: IntLike, frac_bits: int) -> IntLike:
    match step.op:
        case Op.CONST | Op.INT:
            return x * 0 + constant(step, frac_bits)
        case Op.ADD:
            return x + y
        case Op.SUB:
            return x - y
        case Op.SHL:
            return x << step.k
        case Op.SHR:
            return x >> step.k
        case Op.SHL_F:
            return x << frac_bits
        case Op.LOW:
            return x & ((1 << (frac_bits + step.k)) - 1)
        case Op.BIT:
            return x & (1 << (frac_bits + step.k))
        case Op.MIN:
            return _choose(x <= y, x, y)
        case Op.MAX:
            return _choose(x >= y, x, y)
        case Op.COPYSIGN:  # pragma: no branch - there is no other Op, as mypy checks
            return _choose(y >= 0, x, -x)


def _choose(condition: object, x: IntLike, y: IntLike) -> IntLike:
    if isinstance(x, int):
        return x if condition else y
    import numpy as np

    return np.where(np.asarray(condition), x, y)


class _Builder:
    """Writes a program step by step; every method returns the number of the value it made."""

    ARGUMENT = 0

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def _emit(self, op: Op, x: int = 0, y: int = 0, k: int = 0, value: int = 0) -> int:
        self.steps.append(Step(op, x, y, k, value))
        return len(self.steps)

    def integer(self, value: int) -> int:
        return self._emit(Op.INT, value=value)

    def constant(self, real: float, extra_bits: int = 0) -> int:
        """A real constant, rounded once to 12 fractional bits."""
        return self._emit(Op.CONST, value=round(real * (1 << CONSTANT_BITS)), k=extra_bits)

    def one(self) -> int:
        return self.constant(1.0)

    def add(self, x: int, y: int) -> int:
        return self._emit(Op.ADD, x, y)

    def sub(self, x: int, y: int) -> int:
        return self._emit(Op.SUB, x, y)

    def negated(self, x: int) -> int:
        return self.sub(self.integer(0), x)

    def shifted(self, x: int, exponent: int) -> int:
        """``x * 2^exponent``, rounded down."""
        if exponent == 0:
            return x
        return self._emit(Op.SHL, x, k=exponent) if exponent > 0 else self._emit(Op.SHR, x, k=-exponent)

    def times_one(self, x: int) -> int:
        return self._emit(Op.SHL_F, x)

    def low_bits(self, x: int, k: int) -> int:
        return self._emit(Op.LOW, x, k=k)

    def bit(self, x: int, k: int) -> int:
        return self._emit(Op.BIT, x, k=k)

    def minimum(self, *xs: int) -> int:
        result = xs[0]
        for x in xs[1:]:
            result = self._emit(Op.MIN, result, x)
        return result

    def maximum(self, *xs: int) -> int:
        result = xs[0]
        for x in xs[1:]:
            result = self._emit(Op.MAX, result, x)
        return result

    def with_sign_of(self, x: int, y: int) -> int:
        return self._emit(Op.COPYSIGN, x, y)

    def magnitude(self) -> int:
        return self.with_sign_of(self.ARGUMENT, self.ARGUMENT)

    def line(self, x: int, high: int, low: int, intercept: float) -> int:
        """``x * (2^high + 2^low) + intercept``."""
        result = self.add(self.shifted(x, high), self.shifted(x, low))
        return self.add(result, self.constant(intercept)) if intercept else result

    def program(self, name: str, formula: str) -> Program:
        return Program(name, formula, tuple(self.steps))


def _identity() -> Program:
    return _Builder().program("identity", "u")


def _clamped() -> Program:
    b = _Builder()
    one = b.one()
    b.maximum(b.minimum(b.ARGUMENT, one), b.negated(one))
    return b.program("clamped", "clip(u, -One, One)")


def _relu() -> Program:
    b = _Builder()
    b.maximum(b.ARGUMENT, b.integer(0))
    return b.program("relu", "max(u, 0)")


def _abs() -> Program:
    b = _Builder()
    b.magnitude()
    return b.program("abs", "|u|")


def _hat() -> Program:
    b = _Builder()
    b.maximum(b.sub(b.one(), b.magnitude()), b.integer(0))
    return b.program("hat", "max(0, One - |u|)")


def _step() -> Program:
    b = _Builder()
    b.times_one(b.minimum(b.maximum(b.ARGUMENT, b.integer(0)), b.integer(1)))
    return b.program("step", "One if u > 0 else 0")


def _tanh_of_magnitude(b: _Builder, a: int) -> int:
    """tanh(2.5 z) for z >= 0, which is concave: the lowest of five lines."""
    return b.minimum(
        b.line(a, 1, -1, 0.0),
        b.line(a, 1, -5, 0.0509),
        b.line(a, 0, -2, 0.2620),
        b.line(a, -1, -4, 0.5660),
        b.line(a, -3, -6, 0.8480),
        b.one(),
    )


def _tanh() -> Program:
    b = _Builder()
    b.with_sign_of(_tanh_of_magnitude(b, b.magnitude()), b.ARGUMENT)
    return b.program("tanh", "tanh(2.5 z)")


def _sigmoid() -> Program:
    b = _Builder()
    tanh = b.with_sign_of(_tanh_of_magnitude(b, b.magnitude()), b.ARGUMENT)
    b.shifted(b.add(b.one(), tanh), -1)
    return b.program("sigmoid", "1 / (1 + exp(-5 z)) = (1 + tanh(2.5 z)) / 2")


def _sin() -> Program:
    """sin(5 z): the phase in turns, folded to a quarter, on which the sine is concave.

    A turn is 2^(F+10), so the phase is z * 2^F times 1024 * 5 / (2 pi) = 814.87, taken as 815 = 1024 - 256 + 64 - 16 - 1, an
    error of 0.016 %. The quarter keeps eight bits more than a signal until its last step.
    """
    b = _Builder()
    a = b.minimum(b.magnitude(), b.constant(12.0))
    phase = b.sub(
        b.sub(b.add(b.sub(b.shifted(a, 10), b.shifted(a, 8)), b.shifted(a, 6)), b.shifted(a, 4)),
        a,
    )
    half_turn = b.low_bits(phase, 9)
    quarter = b.minimum(half_turn, b.sub(b.constant(2.0, extra_bits=8), half_turn))
    sine = b.minimum(
        b.add(quarter, b.shifted(quarter, -1)),
        b.add(b.add(quarter, b.shifted(quarter, -4)), b.constant(0.16746, extra_bits=8)),
        b.add(b.add(b.shifted(quarter, -1), b.shifted(quarter, -7)), b.constant(0.53587, extra_bits=8)),
        b.constant(1.0, extra_bits=8),
    )
    second_half = b.negated(b.bit(phase, 9))
    b.with_sign_of(b.with_sign_of(b.shifted(sine, -8), second_half), b.ARGUMENT)
    return b.program("sin", "sin(5 z), |5 z| <= 60")


def _gauss() -> Program:
    """exp(-5 z²) for z >= 0: concave, then convex, so the highest of two tail lines, 0 and the lowest of three head lines."""
    b = _Builder()
    a = b.magnitude()
    head = b.minimum(
        b.one(),
        b.sub(b.constant(1.0495), b.add(a, b.shifted(a, -4))),
        b.sub(b.add(b.constant(1.1600), b.shifted(a, -2)), b.shifted(a, 1)),
    )
    b.maximum(
        head,
        b.sub(b.add(b.constant(0.7500), b.shifted(a, -5)), a),
        b.sub(b.constant(0.3010), b.add(b.shifted(a, -2), b.shifted(a, -4))),
        b.integer(0),
    )
    return b.program("gauss", "exp(-5 z^2)")


PROGRAMS: dict[str, Program] = {
    program.name: program
    for program in (
        _identity(), _clamped(), _relu(), _abs(), _hat(), _step(), _tanh(), _sigmoid(), _sin(), _gauss(),
    )
}  # fmt: skip
"""Every activation by name, in the order of its code in the packed form."""

ACTIVATION_NAMES: tuple[str, ...] = tuple(PROGRAMS)
ACTIVATION_CODES: dict[str, int] = {name: code for code, name in enumerate(ACTIVATION_NAMES)}

_UNBOUNDED = frozenset({"identity", "relu", "abs"})


def output_limit(activation: str, frac_bits: int) -> int:
    """Largest magnitude that ``activation`` can give: 32767, or One for those that saturate."""
    return 32767 if activation in _UNBOUNDED else 1 << frac_bits


def evaluate(activation: str, u: int, frac_bits: int) -> int:
    """The activation of one signal, exactly."""
    return PROGRAMS[activation](u, frac_bits)


@cache
def table(activation: str, frac_bits: int) -> IntArray:
    """The activation at every argument -32767..32767: a read-only int64 array of 65,535 values."""
    import numpy as np

    arguments = np.arange(-32767, 32768, dtype=np.int64)
    values = np.array(PROGRAMS[activation](arguments, frac_bits))
    values.flags.writeable = False
    return values


def real_function(activation: str, z: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """What an activation stands for, on real numbers: neat-python's definition."""
    import numpy as np

    match activation:
        case "identity":
            return z
        case "clamped":
            return np.clip(z, -1.0, 1.0)
        case "relu":
            return np.maximum(z, 0.0)
        case "abs":
            return np.abs(z)
        case "hat":
            return np.maximum(0.0, 1.0 - np.abs(z))
        case "step":
            return (z > 0).astype(np.float64)
        case "tanh":
            return np.tanh(2.5 * z)
        case "sigmoid":
            return (1.0 + np.tanh(2.5 * z)) / 2.0
        case "sin":
            return np.sin(np.clip(5.0 * z, -60.0, 60.0))
        case "gauss":
            return np.exp(-5.0 * z * z)
        case _:
            raise ValueError(f"{activation!r} is no activation")
