# SPDX-License-Identifier: MIT
"""A processor for which code is compiled, and on which it runs in an emulator. A row of `bitneat.verify.targets.chips` is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bitneat.codegen import Style
from bitneat.native.compiler import identify, zig_compiler
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import Implementation, entries
from bitneat.verify.instructions import InstructionSet
from bitneat.verify.machine import Toolchain
from bitneat.verify.targets.emulated import EmulatedC, Emulator
from bitneat.verify.targets.image import build_image, driver_data


@dataclass(frozen=True, slots=True)
class Chip:
    """How to compile for a processor, and how to run and count.

    Args:
        name: as ``--targets`` takes it.
        zig: flags of ziglang's clang, which is taken where there is no gcc.
        emulator: runs what was compiled.
        instructions: for the disassembly; None where the object is no ELF file.
        gcc: names of gcc cross compilers, of which the first that works is taken.
        gcc_flags: their flags.
        package: the Debian package of the first of them.
        timing: cycles of a run through machine code, by the processor's published timings, where those depend on nothing
            else; takes code, its address and the addresses executed.
        cycles_source: who counts cycles, or whose timings ``timing`` sums; None where none are claimed.
        chip: the device that `ram` and `flash`, its bytes, belong to.
    """

    name: str
    zig: tuple[str, ...]
    emulator: Emulator
    instructions: InstructionSet | None
    gcc: tuple[str, ...] = ()
    gcc_flags: tuple[str, ...] = ()
    package: str = ""
    timing: Callable[[bytes, int, tuple[int, ...]], int] | None = None
    cycles_source: str | None = None
    chip: str = ""
    ram: int | None = None
    flash: int | None = None
    styles: tuple[Style, ...] = ("unrolled", "table")

    @property
    def loads_on_host(self) -> bool:
        """It does not."""
        return False

    @property
    def needs(self) -> str:
        """What to install."""
        debian = f"Debian: apt install {self.package}; anywhere: " if self.package else ""
        return f"a cross compiler ({debian}pip install ziglang)"

    def toolchain(self) -> Toolchain | None:
        """The gcc for it, else ziglang's clang."""
        for name in self.gcc:
            gcc = identify([name])
            if gcc is not None:
                return Toolchain(gcc, self.gcc_flags, self.instructions)
        zig = zig_compiler()
        return None if zig is None else Toolchain(zig, self.zig, self.instructions)

    def missing_to_run(self) -> str | None:
        """The emulator, where it is missing."""
        return self.emulator.missing()

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """``name_step``, and in the table style ``name_run`` too."""
        return [self.implementation(code, toolchain, entry) for entry in entries(code)]

    def implementation(
        self,
        code: CFile,
        toolchain: Toolchain,
        entry: str,
        *,
        optimization: str = "-Os",
        compiled: Path | None = None,
    ) -> EmulatedC:
        """One entry point, linked and loaded.

        Args:
            code: the file.
            toolchain: this chip's.
            entry: ``step`` or ``run``.
            optimization: of the compiler.
            compiled: an object file to be taken for what the compiler makes of the C file.

        Raises:
            CompilerError: if compiler or linker refuse.
        """
        image = build_image(
            code,
            toolchain,
            entry,
            batch=self.emulator.batch,
            link_flags=self.emulator.link_flags((f"{code.name}_{entry}", *driver_data(code, entry))),
            optimization=optimization,
            compiled=compiled,
        )
        return EmulatedC(image, self.emulator, f"{self.name} {code.style} ({image.function})")

    def cycles(self, code: bytes, address: int, path: tuple[int, ...]) -> int | None:
        """By `timing`."""
        return None if self.timing is None else self.timing(code, address, path)
