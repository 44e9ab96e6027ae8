# SPDX-License-Identifier: MIT
"""The linked program that an emulator loads: the code under test, exactly as it is examined, and the driver that calls it."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from elftools.elf.elffile import ELFFile
from elftools.elf.sections import Section, SymbolTableSection

from bitneat.errors import BitneatError
from bitneat.files import read_capped
from bitneat.native.build import compile_object, link_program
from bitneat.verify.cfile import MAX_FILE_BYTES, CFile
from bitneat.verify.instructions import InstructionSet
from bitneat.verify.machine import FREESTANDING_FLAGS, OBJECT_FLAGS, Toolchain
from bitneat.verify.targets.tracing import SOURCES, Trace


@dataclass(frozen=True)
class Image:
    """A linked file, and the function in it that computes a step.

    ``entry`` is ``step`` or ``run``; ``batch`` is how many steps the driver's arrays hold.
    """

    content: bytes
    code: CFile
    entry: str
    batch: int

    @property
    def function(self) -> str:
        """The name of the function that computes a step."""
        return f"{self.code.name}_{self.entry}"

    @cached_property
    def symbols(self) -> dict[str, int]:
        """The addresses of all global names; of an ELF file."""
        return {
            symbol.name: int(symbol["st_value"])
            for table in self._elf.iter_sections()
            if isinstance(table, SymbolTableSection)
            for symbol in table.iter_symbols()
            if symbol.name and symbol["st_info"]["bind"] == "STB_GLOBAL"
        }

    @cached_property
    def segments(self) -> list[tuple[int, bytes]]:
        """What is to be loaded where; of an ELF file."""
        return [
            (int(section["sh_addr"]), section.data())
            for section in self._elf.iter_sections()
            if section["sh_flags"] & 2 and section["sh_type"] != "SHT_NOBITS" and section["sh_size"]
        ]

    @cached_property
    def code_range(self) -> range:
        """Where the code under test lies; of an ELF file."""
        section = self._section
        return range(int(section["sh_addr"]), int(section["sh_addr"]) + int(section["sh_size"]))

    @cached_property
    def controller(self) -> bytes:
        """The bytes in `code_range`."""
        return bytes(self._section.data())

    def patched(self, address: int, instruction: bytes) -> Image:
        """A copy with other bytes at an address of the code under test, as a wrong compiler might have put them there.

        Raises:
            ValueError: if that is outside the code under test.
        """
        section = self._section
        if address not in self.code_range or address + len(instruction) > self.code_range.stop:
            raise ValueError(f"{address:#x} is outside the code under test")
        return self.overwritten(int(section["sh_offset"]) + address - self.code_range.start, instruction)

    def overwritten(self, offset: int, content: bytes) -> Image:
        """A copy with other bytes at an offset of the file."""
        return replace(self, content=self.content[:offset] + content + self.content[offset + len(content) :])

    @cached_property
    def _section(self) -> Section:
        section = self._elf.get_section_by_name(".controller")
        if section is None:
            raise BitneatError(f"{self.code.path}: the linked program has no code of it")
        return section

    @cached_property
    def _elf(self) -> ELFFile:
        return ELFFile(io.BytesIO(self.content))


def driver_data(code: CFile, entry: str) -> tuple[str, ...]:
    """The arrays that the driver has for a file, which the host reads and writes."""
    own = ("bitneat_signals",) if entry == "run" else ("bitneat_observation", "bitneat_action")
    state = ("bitneat_state",) if code.num_state else ()
    choices = ("bitneat_choices",) if code.has_decide else ()
    return ("bitneat_inputs", "bitneat_outputs", "bitneat_count", *own, *state, *choices)


def build_image(
    code: CFile,
    toolchain: Toolchain,
    entry: str,
    *,
    batch: int,
    link_flags: Sequence[str],
    optimization: str = "-Os",
    compiled: Path | None = None,
) -> Image:
    """Compile a C file with the flags under which it is examined, and link it with the driver.

    Args:
        code: the file that is handed out.
        toolchain: of the target.
        entry: ``step`` or ``run``.
        batch: how many steps the driver's arrays hold.
        link_flags: of the linker, called through the compiler.
        optimization: of the compiler, for the file; the driver is always compiled alike.
        compiled: an object file to be taken for what the compiler makes of the C file.

    Raises:
        CompilerError: if compiler or linker refuse.
    """
    flags = [*toolchain.flags, *OBJECT_FLAGS]
    with tempfile.TemporaryDirectory(prefix="bitneat-") as name:
        folder = Path(name)
        controller, driver, linked = folder / "controller.o", folder / "driver.o", folder / "image"
        if compiled is None:
            wanted = [*toolchain.flags, optimization, *FREESTANDING_FLAGS]
            compile_object(code.path, toolchain.compiler, wanted, controller)
        else:
            controller.write_bytes(read_capped(compiled, MAX_FILE_BYTES))
        compile_object(SOURCES / "driver.c", toolchain.compiler, [*flags, *_macros(code, entry, batch)], driver)
        # zig's linker leaves out the symbols unless debugging was asked for.
        debug = ["-g"] if toolchain.compiler.family == "zig" else []
        arguments = [*toolchain.flags, "-nostdlib", "-static", *debug, *link_flags]
        link_program([controller, driver], toolchain.compiler, arguments, linked, what=str(compiled or code.path))
        return Image(linked.read_bytes(), code, entry, batch)


def _macros(code: CFile, entry: str, batch: int) -> list[str]:
    name = code.name
    return [
        f"-D{'RUN' if entry == 'run' else 'STEP'}={name}_{entry}",
        *([f"-DRESET={name}_reset"] if code.num_state else []),
        *([f"-DDECIDE={name}_decide"] if code.has_decide else []),
        f"-DNUM_INPUTS={code.num_inputs}",
        f"-DNUM_OUTPUTS={code.num_outputs}",
        f"-DNUM_SIGNALS={code.num_signals or 0}",
        f"-DNUM_STATE={code.num_state or 0}",
        f"-DBATCH={batch}",
    ]


def require_symbols(image: Image, names: Sequence[str]) -> None:
    """Say clearly what an image lacks.

    Raises:
        BitneatError: if a name is missing.
    """
    missing = [name for name in names if name not in image.symbols]
    if missing:
        raise BitneatError(f"{image.code.path}: the linked program lacks {missing[0]}")


def nop_faults(image: Image, trace: Trace, instructions: InstructionSet) -> list[tuple[str, Image]]:
    """Copies of an image with one executed addition or subtraction replaced by instructions that do nothing."""
    sums = instructions.executed_sums(image.controller, image.code_range.start, trace.path)
    return [
        (f"without {one.mnemonic} {one.operands} at {one.address:#x}", image.patched(one.address, nothing))
        for one, nothing in sums
    ]
