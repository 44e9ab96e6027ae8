# SPDX-License-Identifier: MIT
"""Planted faults: one flipped bit in generated C, to show that verify can fail.

The places are every bit of the packed table and every significant bit of every integer constant in the code. Left out are
the sizes of arrays in declarations, which hold no behaviour, and the numbers of the expression that picks one weight out of
the table, ``0U - ((uint32_t)name_weights[3] >> 4 & 1U)``: a fault in it either reads another weight, which is the same fault as
one in the table, or the same bit from another place, which is none. Left out, too, are lines that only a chip's compiler sees.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bitneat.verify.cfile import CFile

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_DIRECTIVE = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
_CONDITION = re.compile(r"[ \t]*#[ \t]*(if|ifdef|ifndef|elif|else|endif)\b(.*)")
_OTHER_CHIP = re.compile(r"(?<!!)defined\(__(?:AVR|thumb)")
_ARRAY_SIZE = re.compile(r"^static const .*?=", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])(0[xX][0-9a-fA-F]+|[0-9]+)(?=[uUlL]*\b)")


@dataclass(frozen=True, slots=True)
class Fault:
    """One flipped bit: where it is in the source, and the numbers before and after."""

    line: int
    start: int
    end: int
    what: str
    bit: int
    before: str
    after: str

    def __str__(self) -> str:
        return f"line {self.line}: bit {self.bit} of {self.what}: {self.before} becomes {self.after}"

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {"line": self.line, "what": self.what, "bit": self.bit, "before": self.before, "after": self.after}


def choose(code: CFile, number: int) -> Fault:
    """Fault number ``number`` of a file: drawn uniformly from all bits of all places, the same every time."""
    places = list(_places(code))
    weights = [place.bits for place in places]
    rng = random.Random(number)
    place = rng.choices(places, weights)[0]
    return place.flipped(rng.randrange(place.bits), code.source)


def plant(code: CFile, fault: Fault, folder: Path) -> CFile:
    """A copy of a file with the fault in it; the original is not touched."""
    source = code.source[: fault.start] + fault.after + code.source[fault.end :]
    path = folder / code.path.name
    (folder / code.header_path.name).write_text(code.header, encoding="utf-8", errors="surrogateescape")
    path.write_text(source, encoding="utf-8", errors="surrogateescape")
    return CFile.read(path)


@dataclass(frozen=True, slots=True)
class _Place:
    start: int
    end: int
    bits: int
    what: str

    def flipped(self, bit: int, source: str) -> Fault:
        before = source[self.start : self.end]
        value = int(before, 0) ^ 1 << bit
        after = f"0x{value:0{len(before) - 2}x}" if before[:2] in ("0x", "0X") else str(value)
        return Fault(source.count("\n", 0, self.start) + 1, self.start, self.end, self.what, bit, before, after)


def _places(code: CFile) -> Iterator[_Place]:
    source = code.source
    table_end = table_start = 0
    if code.table is not None:
        data, table_start = code.table
        table_end = source.index("}", table_start)
        noun = f"{code.name}_{'weights' if code.style == 'unrolled' else 'body'}"
        numbers = _NUMBER.finditer(source, table_start, table_end)
        for index, number in zip(range(len(data)), numbers, strict=True):
            yield _Place(number.start(), number.end(), 8, f"byte {index} of {noun}")
    weight = re.compile(rf"\(0U - \((?:\(uint32_t\)|\(unsigned\)){code.name}_weights\[\d+\] >> \d+ & 1U\)\)")
    blank = _without_other_chips(source)
    for pattern in (_COMMENT, _DIRECTIVE, _ARRAY_SIZE, weight):
        blank = pattern.sub(lambda found: re.sub(r"\S", " ", found[0]), blank)
    for number in _NUMBER.finditer(blank):
        if table_start <= number.start() < table_end:
            continue
        value = int(number[1], 0)
        yield _Place(number.start(1), number.end(1), max(1, value.bit_length()), "a constant")


def _without_other_chips(source: str) -> str:
    """The text with blanks where a condition asks for AVR or Thumb: a host, which judges the faults, does not compile that."""
    lines = []
    asks: list[bool] = []
    for line in source.splitlines(keepends=True):
        directive = _CONDITION.match(line)
        if directive is not None:
            kind, condition = directive[1], directive[2]
            if kind in ("elif", "else", "endif"):
                asks.pop()
            if kind != "endif":
                asks.append(_OTHER_CHIP.search(condition) is not None)
        lines.append(re.sub(r"\S", " ", line) if any(asks) else line)
    return "".join(lines)
