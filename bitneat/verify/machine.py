# SPDX-License-Identifier: MIT
"""What a compiler made of a C file: its size, its stack, and whether it kept what the C promises.

A compiler may turn masks into branches, shifts into a multiplication and a loop into a call of memcpy, so the promises are
checked on the object, not on the source.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import Section, SymbolTableSection

from bitneat.codegen import Style
from bitneat.native.build import compile_object
from bitneat.native.compiler import Compiler
from bitneat.native.elf import measure
from bitneat.verify.cfile import CFile
from bitneat.verify.instructions import InstructionSet
from bitneat.verify.wasm import MAGIC, WasmObject, read_wasm
from bitneat.verify.wasm import violations as wasm_violations

_SELF_STARTING = re.compile(r"\.((preinit|init|fini)(_array|\d)?|ctors|dtors|deplibs|linker-options)(\.|$)")

# As firmware is compiled: what a hosted system's compiler adds of its own accord would be found and blamed on the code.
FREESTANDING_FLAGS = (
    "-std=c99",
    "-ffreestanding",
    "-fno-stack-protector",
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
)
OBJECT_FLAGS = ("-Os", *FREESTANDING_FLAGS)


@dataclass(frozen=True, slots=True)
class Toolchain:
    """A compiler set up for a target.

    Args:
        compiler: which.
        flags: what makes it compile for the target, beyond `OBJECT_FLAGS`.
        instructions: the instruction set whose code can be looked into, or None.
    """

    compiler: Compiler
    flags: tuple[str, ...] = ()
    instructions: InstructionSet | None = None


@dataclass(frozen=True, slots=True)
class Examination:
    """What the object of a C file takes, and the promises it breaks.

    ``flash`` is code and constants; ``ram`` is what must be kept between steps, static data (none) and the caller's state;
    ``stack`` is the deepest chain of calls from ``name_step``, None where the compiler does not say.
    """

    flash: int
    ram: int
    stack: int | None
    violations: tuple[str, ...]


def examine(code: CFile, toolchain: Toolchain) -> Examination:
    """Compile a C file as firmware would, and look at the object.

    Raises:
        CompilerError: if the compiler refuses the file.
    """
    with tempfile.TemporaryDirectory(prefix="bitneat-") as name:
        folder = Path(name)
        out = folder / "code.o"
        flags = [*toolchain.flags, *OBJECT_FLAGS]
        if _writes_call_graphs(toolchain.compiler):
            flags.append("-fcallgraph-info=su")
        compile_object(code.path, toolchain.compiler, flags, out)
        if out.read_bytes().startswith(MAGIC):
            return _examine_wasm(code, read_wasm(out.read_bytes()))
        static = _static_data(out)
        violations = _foreign_parts(out)
        if toolchain.instructions is not None:
            violations += instruction_violations(out, code.style, toolchain.instructions)
        flash = measure(out).flash
        graphs = list(folder.glob("*.ci"))
        stack = stack_depth(graphs[0].read_text(errors="replace"), f"{code.name}_step") if graphs else None
    return Examination(
        flash=flash,
        ram=sum(static.values()) + 2 * (code.num_state or 0),
        stack=stack,
        violations=tuple(violations),
    )


def _examine_wasm(code: CFile, wasm: WasmObject) -> Examination:
    violations = wasm_violations(wasm, straight=code.style == "unrolled")
    return Examination(
        flash=wasm.code_bytes + sum(size for _, size in wasm.segments),
        ram=2 * (code.num_state or 0),
        stack=None,
        violations=tuple(violations),
    )


def _writes_call_graphs(compiler: Compiler) -> bool:
    """Whether it does; gcc has since version 10, and Debian's for AVR is older."""
    version = re.search(r"\) (\d+)\.", compiler.title)
    return compiler.family == "gcc" and (version is None or int(version[1]) >= 10)


def loading_violations(code: CFile, compiler: Compiler, flags: Sequence[str]) -> list[str]:
    """What speaks against loading a C file into a process of this machine, as found in the object that would be loaded.

    Args:
        code: the file.
        compiler: the host's.
        flags: those that it is compiled with to be run.

    Raises:
        CompilerError: if the compiler refuses the file.
    """
    with tempfile.TemporaryDirectory(prefix="bitneat-") as name:
        out = Path(name) / "code.o"
        compile_object(code.path, compiler, [*flags, "-fPIC"], out)
        return _foreign_parts(out)


def _foreign_parts(out: Path) -> list[str]:
    """What no generated code has on any target."""
    return [
        *(f"{size} bytes of static data in {section}, expected none" for section, size in _static_data(out).items()),
        *(f"needs {symbol} from elsewhere, expected to need nothing" for symbol in _undefined_symbols(out)),
        *(f"{what} runs by itself, expected none" for what in _self_starters(out)),
    ]


def _self_starters(path: Path) -> list[str]:
    """Sections whose code a loader runs or whose libraries it adds, and functions that it calls to choose another."""
    with path.open("rb") as file:
        elf = ELFFile(file)
        found = [section.name for section in elf.iter_sections() if _SELF_STARTING.match(section.name)]
        found += [
            str(symbol.name)
            for table in elf.iter_sections()
            if isinstance(table, SymbolTableSection)
            for symbol in table.iter_symbols()
            if symbol["st_info"]["type"] in ("STT_GNU_IFUNC", "STT_LOOS")
        ]
    return found


def _static_data(path: Path) -> dict[str, int]:
    """The bytes of each section that can be written."""
    with path.open("rb") as file:
        return {
            section.name: int(section["sh_size"])
            for section in ELFFile(file).iter_sections()
            if section["sh_flags"] & SH_FLAGS.SHF_ALLOC
            and section["sh_flags"] & SH_FLAGS.SHF_WRITE
            and section["sh_size"]
            # Constants with addresses in position-independent code: a loader writes them once, a program never.
            and not section.name.startswith(".data.rel.ro")
        }


def _undefined_symbols(path: Path) -> list[str]:
    """Names from elsewhere: a libc, or the compiler's support library."""
    with path.open("rb") as file:
        return sorted(
            {
                str(symbol.name)
                for table in ELFFile(file).iter_sections()
                if isinstance(table, SymbolTableSection)
                for symbol in table.iter_symbols()
                # The linker makes the last one itself, where position-independent code wants it.
                if symbol["st_shndx"] == "SHN_UNDEF" and symbol.name not in ("", "_GLOBAL_OFFSET_TABLE_")
            }
        )


def instruction_violations(path: Path, style: Style, instructions: InstructionSet) -> Iterator[str]:
    """Multiplications and divisions, and in the unrolled style conditional branches, in the code of an ELF file.

    Raises:
        BitneatError: if a part of the code cannot be read.
    """
    with path.open("rb") as file:
        elf = ELFFile(file)
        for index, section in enumerate(elf.iter_sections()):
            if section["sh_flags"] & SH_FLAGS.SHF_EXECINSTR and section["sh_size"]:
                for start, end in _code_ranges(elf, index, section, instructions.code_mark):
                    code = instructions.decode_all(section.data()[start:end], start, section.name)
                    branches = instructions.conditional_branches(code) if style == "unrolled" else []
                    for found, what in (
                        (filter(instructions.is_multiplication, code), "a multiplication or division"),
                        (branches, "a conditional branch"),
                    ):
                        for one in found:
                            yield f"{section.name}+{one.address:#x}: {one.mnemonic} {one.operands} is {what}"


def _code_ranges(elf: ELFFile, index: int, section: Section, code_mark: str | None) -> list[tuple[int, int]]:
    """Where code lies between the constants of a section, by ARM's mapping symbols $t (Thumb) and $d (data)."""
    if code_mark is None:
        return [(0, int(section["sh_size"]))]
    marks = sorted(
        (int(symbol["st_value"]), symbol.name[:2])
        for table in elf.iter_sections()
        if isinstance(table, SymbolTableSection)
        for symbol in table.iter_symbols()
        if symbol["st_shndx"] == index and symbol.name[:2] in (code_mark, "$d")
    )
    ends = [start for start, _ in marks[1:]] + [int(section["sh_size"])]
    return [(start, end) for (start, kind), end in zip(marks, ends, strict=True) if kind == code_mark]


_GRAPH_NODE = re.compile(r'^node: \{ title: "([^"]*)" label: "[^"]*?(?:\\n(\d+) bytes \((\w+)[^"]*)?"', re.MULTILINE)
_GRAPH_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', re.MULTILINE)


def stack_depth(graph: str, root: str) -> int | None:
    """The deepest stack of a function with all it calls, from gcc's call graph (``-fcallgraph-info=su``).

    None where that cannot be told: a call out of the file, a recursion, a frame of varying size.
    """
    frames = {
        title: int(size) if size and kind == "static" else None for title, size, kind in _GRAPH_NODE.findall(graph)
    }
    calls: dict[str, set[str]] = {}
    for source, target in _GRAPH_EDGE.findall(graph):
        calls.setdefault(source, set()).add(target)

    def depth(function: str, above: tuple[str, ...]) -> int | None:
        own = frames.get(function)
        if own is None or function in above:
            return None
        deepest = 0
        for callee in calls.get(function, ()):
            below = depth(callee, (*above, function))
            if below is None:
                return None
            deepest = max(deepest, below)
        return own + deepest

    return depth(root, ())
