# SPDX-License-Identifier: MIT
"""This machine as a target, in one style."""

from __future__ import annotations

from dataclasses import dataclass

from bitneat.codegen import Style
from bitneat.native.compiler import host_compiler
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import HostC, Implementation, entries
from bitneat.verify.machine import Toolchain


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
    def loads_on_host(self) -> bool:
        """It does."""
        return True

    @property
    def needs(self) -> str:
        """What to install."""
        return "a C compiler (Debian: apt install gcc; anywhere: pip install ziglang)"

    @property
    def chip(self) -> str:
        """This machine."""
        return "host"

    @property
    def ram(self) -> int | None:
        """Plenty."""
        return None

    @property
    def flash(self) -> int | None:
        """Plenty."""
        return None

    def toolchain(self) -> Toolchain:
        """The host's compiler."""
        return Toolchain(host_compiler())

    def missing_to_run(self) -> None:
        """Nothing."""
        return

    def implementations(self, code: CFile, toolchain: Toolchain) -> list[Implementation]:
        """``name_step``, and in the table style ``name_run`` too."""
        return [
            HostC(code, entry, compiler=toolchain.compiler, title=f"{self.name} ({code.name}_{entry})")
            for entry in entries(code)
        ]

    @property
    def cycles_source(self) -> str | None:
        """Nobody."""
        return None

    def cycles(self, code: bytes, address: int, path: tuple[int, ...]) -> int | None:
        """No processor of this kind has fixed ones."""
        del code, address, path
        return None
