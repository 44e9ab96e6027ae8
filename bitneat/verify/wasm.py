# SPDX-License-Identifier: MIT
"""WebAssembly files: as much of the format as it takes to measure an object and to find its instructions.

After the WebAssembly Core Specification 2.0, chapter 5 (binary format), and the tool conventions' Linking.md for objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bitneat.errors import BitneatError

MAGIC = b"\0asm\1\0\0\0"
_CUSTOM, _IMPORT, _EXPORT, _CODE, _DATA = 0, 2, 7, 10, 11
_SEGMENT_INFO, _INIT_FUNCTIONS = 5, 6

I32_ADD, I32_SUB = 0x6A, 0x6B
_MULTIPLICATIONS = {
    **dict.fromkeys((0x6C, 0x7E), "mul"),
    **dict.fromkeys((0x6D, 0x6E, 0x7F, 0x80), "div"),
    **dict.fromkeys((0x6F, 0x70, 0x81, 0x82), "rem"),
}
_CONDITIONALS = {0x04: "if", 0x0D: "br_if", 0x0E: "br_table"}
_BLOCKS, _LEBS = (
    frozenset({0x02, 0x03, 0x04}),
    frozenset({0x0C, 0x0D, 0x10, *range(0x20, 0x27), 0x3F, 0x40, 0x41, 0x42, 0xD2}),
)


@dataclass(frozen=True, slots=True)
class Opcode:
    """One instruction: where it is in the file, and its first byte."""

    offset: int
    code: int


@dataclass(frozen=True, slots=True)
class WasmObject:
    """What an object or a module holds.

    ``functions`` has the instructions of each function that it defines, in the order of their numbers, of which the first is
    ``first_function``; ``exports`` the numbers of the functions that it exports; ``imports`` the functions that it needs;
    ``segments`` the name and size of each part of its memory, of objects only; ``starters`` how many functions run by themselves.
    """

    functions: tuple[tuple[Opcode, ...], ...]
    first_function: int
    exports: dict[str, int]
    imports: tuple[str, ...]
    segments: tuple[tuple[str, int], ...]
    code_bytes: int
    starters: int


class _Reader:
    def __init__(self, content: bytes, at: int, end: int) -> None:
        self.content, self.at, self.end = content, at, end

    def byte(self) -> int:
        if self.at >= self.end:
            raise BitneatError("WebAssembly file: ends too early")
        self.at += 1
        return self.content[self.at - 1]

    def leb(self) -> int:
        """An unsigned number; of a signed one only the length is right."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    def name(self) -> str:
        size = self.leb()
        self.at += size
        return self.content[self.at - size : self.at].decode(errors="replace")

    def limits(self) -> None:
        flags = self.leb()
        self.leb()
        if flags & 1:
            self.leb()


def read_wasm(content: bytes) -> WasmObject:
    """Read an object or a module.

    Raises:
        BitneatError: if it is none, or holds what is not known here.
    """
    if not content.startswith(MAGIC):
        raise BitneatError("not a WebAssembly file of version 1")
    functions: list[tuple[Opcode, ...]] = []
    exports: dict[str, int] = {}
    imports: list[str] = []
    sizes: list[int] = []
    names: list[str] = []
    code_bytes = starters = 0
    reader = _Reader(content, len(MAGIC), len(content))
    while reader.at < len(content):
        kind, size = reader.byte(), reader.leb()
        section = _Reader(content, reader.at, reader.at + size)
        if kind == _IMPORT:
            imports = list(_imports(section))
        elif kind == _EXPORT:
            for _ in range(section.leb()):
                name, what, number = section.name(), section.byte(), section.leb()
                if what == 0:
                    exports[name] = number
        elif kind == _CODE:
            for _ in range(section.leb()):
                length = section.leb()
                functions.append(tuple(_body(_Reader(content, section.at, section.at + length))))
                section.at += length
                code_bytes += length
        elif kind == _DATA:
            sizes = list(_data(section))
        elif kind == _CUSTOM and section.name() == "linking":
            names, starters = _linking(section)
        reader.at += size
    names += [".data"] * (len(sizes) - len(names))
    return WasmObject(
        functions=tuple(functions),
        first_function=len(imports),
        exports=exports,
        imports=tuple(imports),
        segments=tuple(zip(names, sizes, strict=True)),
        code_bytes=code_bytes,
        starters=starters,
    )


def violations(wasm: WasmObject, *, straight: bool) -> list[str]:
    """What an object has that generated code has not; ``straight`` is the unrolled style, without any condition."""
    found = [
        f"{size} bytes of static data in {name}, expected none" for name, size in wasm.segments if _written(name, size)
    ]
    found += [f"needs {name} from elsewhere, expected to need nothing" for name in wasm.imports]
    if wasm.starters:
        found.append(f"{wasm.starters} functions run by themselves, expected none")
    for opcodes in wasm.functions:
        for one in opcodes:
            if one.code in _MULTIPLICATIONS:
                found.append(f"{one.offset:#x}: {_MULTIPLICATIONS[one.code]} is a multiplication or division")
            elif straight and one.code in _CONDITIONALS:
                found.append(f"{one.offset:#x}: {_CONDITIONALS[one.code]} is a conditional branch")
    return found


def _written(name: str, size: int) -> bool:
    return size > 0 and not name.startswith(".rodata")


def _imports(section: _Reader) -> Iterator[str]:
    """The functions; memory, tables and the stack's global are of the machine, not of someone's code."""
    for _ in range(section.leb()):
        _, name, kind = section.name(), section.name(), section.byte()
        if kind == 0:
            section.leb()
            yield name
        elif kind == 1:
            section.byte()
            section.limits()
        elif kind == 2:
            section.limits()
        elif kind == 3:
            section.byte()
            section.byte()
        else:
            raise BitneatError(f"WebAssembly file: import of unknown kind {kind}")


def _data(section: _Reader) -> Iterator[int]:
    for _ in range(section.leb()):
        flags = section.leb()
        if flags == 2:
            section.leb()
        if flags in (0, 2):
            while (code := section.byte()) != 0x0B:
                if code in (0x41, 0x42, 0x23):
                    section.leb()
        size = section.leb()
        section.at += size
        yield size


def _linking(section: _Reader) -> tuple[list[str], int]:
    names: list[str] = []
    starters = 0
    section.leb()
    while section.at < section.end:
        kind, size = section.byte(), section.leb()
        part = _Reader(section.content, section.at, section.at + size)
        if kind == _SEGMENT_INFO:
            for _ in range(part.leb()):
                names.append(part.name())
                part.leb()
                part.leb()
        elif kind == _INIT_FUNCTIONS:
            starters = part.leb()
        section.at += size
    return names, starters


def _body(reader: _Reader) -> Iterator[Opcode]:
    for _ in range(reader.leb()):
        reader.leb()
        reader.byte()
    while reader.at < reader.end:
        offset = reader.at
        code = reader.byte()
        yield Opcode(offset, code)
        _skip_immediates(reader, code, offset)


def _skip_immediates(reader: _Reader, code: int, offset: int) -> None:
    if code in _BLOCKS or code in _LEBS:
        reader.leb()
    elif code == 0x0E:
        for _ in range(reader.leb() + 1):
            reader.leb()
    elif code == 0x11 or 0x28 <= code <= 0x3E:
        reader.leb()
        reader.leb()
    elif code == 0x1C:
        for _ in range(reader.leb()):
            reader.byte()
    elif code == 0x43:
        reader.at += 4
    elif code == 0x44:
        reader.at += 8
    elif code == 0xFC:
        extended = reader.leb()
        for _ in range({8: 2, 9: 1, 10: 2, 11: 1, 12: 2, 13: 1, 14: 2, 15: 1, 16: 1, 17: 1}.get(extended, 0)):
            reader.leb()
    elif not (code <= 0x01 or code in (0x05, 0x0B, 0x0F, 0x1A, 0x1B, 0xD1) or 0x45 <= code <= 0xC4):
        raise BitneatError(f"WebAssembly file: unknown instruction {code:#x} at {offset:#x}")
