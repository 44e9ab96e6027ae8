# SPDX-License-Identifier: MIT
"""What a target is to everything else: a place where a controller's C is compiled, looked at and, where that is possible, run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bitneat.codegen import Style
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import Implementation
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
    def loads_on_host(self) -> bool:
        """Whether what is run is loaded into a process of this machine, which must be safe."""

    @property
    def needs(self) -> str:
        """The compilers to choose from, where there is none."""

    @property
    def chip(self) -> str:
        """The device whose memory `ram` and `flash` are."""

    @property
    def ram(self) -> int | None:
        """Bytes of RAM of the chip; None if it is no particular chip."""

    @property
    def flash(self) -> int | None:
        """Bytes of flash of the chip; None if it is no particular chip."""

    def toolchain(self) -> Toolchain | None:
        """The compiler for it; None if it is missing.

        Raises:
            CompilerError: if a compiler was asked for by name and does not work.
        """

    def missing_to_run(self) -> str | None:
        """What to install so that code runs there; None if all is there."""

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """What to run in the loop, one for each entry point."""

    @property
    def cycles_source(self) -> str | None:
        """Who counts cycles, or whose timings are summed; None where no cycles are claimed."""

    def cycles(self, code: bytes, address: int, path: tuple[int, ...]) -> int | None:
        """The cycles of a run through some code by the published timings of the processor; None if it has none that hold.

        Args:
            code: the machine code.
            address: where it starts.
            path: the addresses executed, in order.
        """


@dataclass(frozen=True, slots=True)
class ReadyTarget:
    """A target with the compiler that was found for it.

    ``runs`` says whether code can be run there and not only compiled and measured, ``asked`` whether it was asked for by name.
    """

    target: Target
    toolchain: Toolchain
    runs: bool
    asked: bool
