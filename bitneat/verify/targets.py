# SPDX-License-Identifier: MIT
"""The table of targets: where a controller's C is compiled, looked at and, where that is possible, run.

To add a target, write what `Target` asks for and put it into `TARGETS`; nothing else needs to know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from bitneat.codegen import Style
from bitneat.errors import BitneatError
from bitneat.native.compiler import host_compiler, identify, zig_compiler
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import HostC, Implementation, entries
from bitneat.verify.machine import Toolchain


class Target(Protocol):
    """A place where the C goes."""

    @property
    def name(self) -> str:
        """As ``--targets`` takes it."""

    @property
    def styles(self) -> tuple[Style, ...]:
        """The styles that are judged there, an entry of the report each."""

    @property
    def runs(self) -> bool:
        """Whether code runs there, and is not only compiled and measured."""

    @property
    def needs(self) -> str:
        """What to install where it is missing."""

    def toolchain(self) -> Toolchain | None:
        """The compiler for it; None if it is missing.

        Raises:
            CompilerError: if a compiler was asked for by name and does not work.
        """

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """What to run in the loop, one for each entry point; empty where code is only compiled and measured."""


@dataclass(frozen=True, slots=True)
class HostTarget:
    """This machine, one style."""

    style: Style

    @property
    def name(self) -> str:
        """``host-unrolled`` or ``host-table``."""
        return f"host-{self.style}"

    @property
    def styles(self) -> tuple[Style, ...]:
        """The one of the name."""
        return (self.style,)

    @property
    def runs(self) -> bool:
        """It does."""
        return True

    @property
    def needs(self) -> str:
        """What to install."""
        return "a C compiler (Debian: apt install gcc; anywhere: pip install ziglang)"

    def toolchain(self) -> Toolchain:
        """The host's compiler."""
        return Toolchain(host_compiler())

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """``name_step``, and in the table style ``name_run`` too."""
        return [
            HostC(code, entry, compiler=toolchain.compiler, title=f"{self.name} ({code.name}_{entry})")
            for entry in entries(code)
        ]


@dataclass(frozen=True, slots=True)
class ChipTarget:
    """A chip for which code is compiled, measured and disassembled, but not run."""

    name: str
    gcc: str
    gcc_flags: tuple[str, ...]
    zig_triple: str
    zig_flags: tuple[str, ...]
    package: str
    styles: tuple[Style, ...] = ("unrolled", "table")

    @property
    def runs(self) -> bool:
        """It does not."""
        return False

    @property
    def needs(self) -> str:
        """What to install."""
        return f"a cross compiler (Debian: apt install {self.package}; anywhere: pip install ziglang)"

    def toolchain(self) -> Toolchain | None:
        """The gcc for the chip, else ziglang's clang."""
        gcc = identify([self.gcc])
        if gcc is not None:
            return Toolchain(gcc, self.gcc_flags, "thumb")
        zig = zig_compiler(self.zig_triple)
        return None if zig is None else Toolchain(zig, self.zig_flags, "thumb")

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """None."""
        del code, toolchain
        return []


_TARGETS: tuple[Target, ...] = (
    HostTarget("unrolled"),
    HostTarget("table"),
    ChipTarget(
        name="cortex-m0",
        gcc="arm-none-eabi-gcc",
        gcc_flags=("-mcpu=cortex-m0", "-mthumb"),
        zig_triple="thumb-freestanding-eabi",
        zig_flags=("-mcpu=cortex_m0",),
        package="gcc-arm-none-eabi",
    ),
)

TARGETS: dict[str, Target] = {target.name: target for target in _TARGETS}


@dataclass(frozen=True, slots=True)
class ReadyTarget:
    """A target with the compiler that was found for it."""

    target: Target
    toolchain: Toolchain


def select(names: Sequence[str] | None) -> list[ReadyTarget]:
    """The targets that are asked for, with their compilers.

    Args:
        names: from `TARGETS`, or the single name ``all``; None for the host and every other target whose tools are there.

    Raises:
        BitneatError: if there is no name, one is unknown, or a target that was asked for cannot be served.
    """
    if names is None:
        found = [(target, target.toolchain()) for target in TARGETS.values()]
        return [ReadyTarget(target, toolchain) for target, toolchain in found if toolchain is not None]
    if not names:
        raise BitneatError(f"--targets: names no target; the targets are {', '.join(TARGETS)}, or all")
    wanted = list(TARGETS) if "all" in names else list(dict.fromkeys(names))
    ready = []
    for name in wanted:
        if name not in TARGETS:
            raise BitneatError(f"--targets {name}: no such target; the targets are {', '.join(TARGETS)}, or all")
        toolchain = TARGETS[name].toolchain()
        if toolchain is None:
            raise BitneatError(f"--targets {name}: its tools are missing; install {TARGETS[name].needs}")
        ready.append(ReadyTarget(TARGETS[name], toolchain))
    return ready
