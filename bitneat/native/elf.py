# SPDX-License-Identifier: MIT
"""What an object file takes on a device, read from its ELF sections."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from elftools.common.exceptions import ELFError
from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile

from bitneat.errors import BitneatError

# Unwind tables are for debuggers and C++ exceptions; a firmware's linker script drops them.
_DROPPED_SECTIONS = (".ARM.exidx", ".ARM.extab", ".eh_frame", ".note")


@dataclass(frozen=True, slots=True)
class Footprint:
    """Bytes that an object takes: ``flash`` for code, constants and initial values, ``ram`` for all that can be written."""

    flash: int
    ram: int


def measure(path: Path) -> Footprint:
    """The footprint of a compiled object.

    Raises:
        BitneatError: if the file is no ELF object.
    """
    flash = ram = 0
    try:
        with path.open("rb") as file:
            for section in ELFFile(file).iter_sections():
                flags = section["sh_flags"]
                if not flags & SH_FLAGS.SHF_ALLOC or section.name.startswith(_DROPPED_SECTIONS):
                    continue
                writable = bool(flags & SH_FLAGS.SHF_WRITE)
                if writable:
                    ram += section["sh_size"]
                if section["sh_type"] != "SHT_NOBITS":
                    flash += section["sh_size"]
    except (ELFError, OSError) as error:
        raise BitneatError(f"{path}: not an ELF object: {error}") from None
    return Footprint(flash, ram)
