# SPDX-License-Identifier: MIT
"""VEX's operations on terms. What is not here is refused, never guessed."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

from bitneat.prove.flags import UnsupportedError
from bitneat.prove.terms import Term, Terms

Operation = Callable[..., Term]
"""Takes a `Terms` and the arguments."""


def _amount(term: Term) -> int:
    if not term.is_const:
        raise UnsupportedError("a shift by a number of places that depends on data")
    return term.unsigned


def lanes(terms: Terms, term: Term, width: int) -> list[Term]:
    """A vector's elements, the lowest first."""
    return [terms.extract(term, at, width) for at in range(0, term.width, width)]


def _saturated(terms: Terms, term: Term, width: int) -> Term:
    low, high = (terms.const(term.width, bound) for bound in (-(1 << (width - 1)), (1 << (width - 1)) - 1))
    clipped = terms.ite(terms.slt(term, low), low, terms.ite(terms.slt(high, term), high, term))
    return terms.extract(clipped, 0, width)


_SCALAR: dict[str, Operation] = {
    "Add": lambda t, x, y: t.add(x, y),
    "Sub": lambda t, x, y: t.sub(x, y),
    "Mul": lambda t, x, y: t.mul(x, y),
    "And": lambda t, x, y: t.bit_and(x, y),
    "Or": lambda t, x, y: t.bit_or(x, y),
    "Xor": lambda t, x, y: t.bit_xor(x, y),
    "Shl": lambda t, x, k: t.shl(x, _amount(k)),
    "Shr": lambda t, x, k: t.lshr(x, _amount(k)),
    "Sar": lambda t, x, k: t.ashr(x, _amount(k)),
    "Not": lambda t, x: t.invert(x),
    "CmpEQ": lambda t, x, y: t.eq(x, y),
    "CasCmpEQ": lambda t, x, y: t.eq(x, y),
    "CmpNE": lambda t, x, y: t.invert(t.eq(x, y)),
    "CasCmpNE": lambda t, x, y: t.invert(t.eq(x, y)),
    "ExpCmpNE": lambda t, x, y: t.invert(t.eq(x, y)),
    "CmpNEZ": lambda t, x: t.invert(t.eq(x, t.const(x.width, 0))),
    "CmpwNEZ": lambda t, x: t.sext(t.invert(t.eq(x, t.const(x.width, 0))), x.width),
    "CmpLT_S": lambda t, x, y: t.slt(x, y),
    "CmpLE_S": lambda t, x, y: t.invert(t.slt(y, x)),
    "CmpLT_U": lambda t, x, y: t.ult(x, y),
    "CmpLE_U": lambda t, x, y: t.invert(t.ult(y, x)),
}
_LANE: dict[str, Operation] = {
    "Add": _SCALAR["Add"],
    "Sub": _SCALAR["Sub"],
    "CmpEQ": lambda t, x, y: t.sext(t.eq(x, y), x.width),
    "CmpGT_S": lambda t, x, y: t.sext(t.slt(y, x), x.width),
    "CmpGT_U": lambda t, x, y: t.sext(t.ult(y, x), x.width),
    "Max_S": lambda t, x, y: t.ite(t.slt(x, y), y, x),
    "Min_S": lambda t, x, y: t.ite(t.slt(x, y), x, y),
    "Max_U": lambda t, x, y: t.ite(t.ult(x, y), y, x),
    "Min_U": lambda t, x, y: t.ite(t.ult(x, y), x, y),
    "Mul": _SCALAR["Mul"],
}
_BY_ONE_AMOUNT = {"ShlN": _SCALAR["Shl"], "ShrN": _SCALAR["Shr"], "SarN": _SCALAR["Sar"]}

_SCALAR_NAME = re.compile(r"(?P<what>[A-Za-z]+?)(?P<width>8|16|32|64)(?P<sign>[SU]?)$")
_CONVERSION = re.compile(r"(?P<source>1|8|16|32|64)(?P<sign>[US]?)to(?P<result>1|8|16|32|64)$")
_HALF = re.compile(r"(?P<source>16|32|64|128)HIto(?P<result>8|16|32|64)$")
_JOINED = re.compile(r"(?P<part>8|16|32|64)HLto(?:V?)(?P<whole>16|32|64|128)$")
_VECTOR = re.compile(r"(?P<what>[A-Za-z]+?)(?P<width>8|16|32|64)(?P<sign>[SU]?)x(?P<count>2|4|8|16)$")
_INTERLEAVED = re.compile(r"Interleave(?P<half>LO|HI)(?P<width>8|16|32|64)x(?P<count>2|4|8|16)$")
_NARROWED = re.compile(
    r"(?P<kind>QNarrow|Narrow)Bin(?P<from>16|32|64)(?P<sign>[SU]?)to(?P<to>8|16|32)(?P<out>[SU]?)x(?P<count>\d+)$"
)


@cache
def operation(name: str) -> Operation:
    """What VEX calls ``Iop_name``.

    Raises:
        UnsupportedError: if it is none of those that are modelled.
    """
    bare = name.removeprefix("Iop_")
    for pattern, maker in _MAKERS:
        found = pattern.match(bare)
        if found is not None:
            made = maker(found)
            if made is not None:
                return made
    special = _SPECIAL.get(bare)
    if special is None:
        raise UnsupportedError(f"VEX operation {name}")
    return special


def _scalar(found: re.Match[str]) -> Operation | None:
    key = found["what"] + (f"_{found['sign']}" if found["sign"] else "")
    return _SCALAR.get(key)


def _conversion(found: re.Match[str]) -> Operation:
    source, result = int(found["source"]), int(found["result"])
    if result <= source:
        return lambda t, x: t.extract(x, 0, result)
    return (lambda t, x: t.sext(x, result)) if found["sign"] == "S" else (lambda t, x: t.zext(x, result))


def _half(found: re.Match[str]) -> Operation:
    result = int(found["result"])
    return lambda t, x: t.extract(x, int(found["source"]) - result, result)


def _vector(found: re.Match[str]) -> Operation | None:
    width = int(found["width"])
    shift = _BY_ONE_AMOUNT.get(found["what"])
    if shift is not None:
        return lambda t, x, k: t.concat([shift(t, lane, k) for lane in lanes(t, x, width)])
    one = _LANE.get(found["what"] + (f"_{found['sign']}" if found["sign"] else ""))
    if one is None:
        return None
    return lambda t, x, y: t.concat([one(t, a, b) for a, b in zip(lanes(t, x, width), lanes(t, y, width), strict=True)])


def _interleaved(found: re.Match[str]) -> Operation:
    width, half = int(found["width"]), found["half"]

    def interleave(t: Terms, high: Term, low: Term) -> Term:
        count = high.width // width
        chosen = slice(count // 2) if half == "LO" else slice(count // 2, count)
        pairs = zip(lanes(t, low, width)[chosen], lanes(t, high, width)[chosen], strict=True)
        return t.concat([one for pair in pairs for one in pair])

    return interleave


def _narrowed(found: re.Match[str]) -> Operation | None:
    source, result = int(found["from"]), int(found["to"])
    if found["kind"] == "QNarrow" and (found["sign"], found["out"]) != ("S", "S"):
        return None

    def narrow(t: Terms, high: Term, low: Term) -> Term:
        parts = [*lanes(t, low, source), *lanes(t, high, source)]
        if found["kind"] == "QNarrow":
            return t.concat([_saturated(t, part, result) for part in parts])
        return t.concat([t.extract(part, 0, result) for part in parts])

    return narrow


def _bitwise(one: Operation) -> Operation:
    return lambda t, x, y: t.concat([one(t, a, b) for a, b in zip(lanes(t, x, 64), lanes(t, y, 64), strict=True)])


def _multiplied(width: int, *, is_signed: bool) -> Operation:
    def multiply(t: Terms, x: Term, y: Term) -> Term:
        extend = t.sext if is_signed else t.zext
        return t.mul(extend(x, 2 * width), extend(y, 2 * width))

    return multiply


def _shifted_bytes(*, left: bool) -> Operation:
    def shift(t: Terms, x: Term, k: Term) -> Term:
        bits = _amount(k)
        if bits == 0:
            return x
        nothing = t.const(bits, 0)
        if left:
            return t.concat([nothing, t.extract(x, 0, x.width - bits)])
        return t.concat([t.extract(x, bits, x.width - bits), nothing])

    return shift


_MAKERS: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Operation | None]], ...] = (
    (_CONVERSION, _conversion),
    (_HALF, _half),
    (_JOINED, lambda found: lambda t, high, low: t.concat([low, high])),
    (_INTERLEAVED, _interleaved),
    (_NARROWED, _narrowed),
    (_VECTOR, _vector),
    (_SCALAR_NAME, _scalar),
)
_SPECIAL: dict[str, Operation] = {
    "And1": _SCALAR["And"],
    "Or1": _SCALAR["Or"],
    "Not1": _SCALAR["Not"],
    "AndV128": _bitwise(_SCALAR["And"]),
    "OrV128": _bitwise(_SCALAR["Or"]),
    "XorV128": _bitwise(_SCALAR["Xor"]),
    "NotV128": lambda t, x: t.concat([t.invert(lane) for lane in lanes(t, x, 64)]),
    "V128to32": lambda t, x: t.extract(x, 0, 32),
    "V128to64": lambda t, x: t.extract(x, 0, 64),
    "V128HIto64": lambda t, x: t.extract(x, 64, 64),
    "32UtoV128": lambda t, x: t.concat([x, t.const(96, 0)]),
    "64UtoV128": lambda t, x: t.concat([x, t.const(64, 0)]),
    "64HLtoV128": lambda t, high, low: t.concat([low, high]),
    "SetV128lo32": lambda t, x, low: t.concat([low, t.extract(x, 32, 96)]),
    "SetV128lo64": lambda t, x, low: t.concat([low, t.extract(x, 64, 64)]),
    "ShlV128": _shifted_bytes(left=True),
    "ShrV128": _shifted_bytes(left=False),
    "MullS32": _multiplied(32, is_signed=True),
    "MullU32": _multiplied(32, is_signed=False),
    "MullS16": _multiplied(16, is_signed=True),
    "MullU16": _multiplied(16, is_signed=False),
}
