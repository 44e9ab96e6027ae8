# SPDX-License-Identifier: MIT
"""AVR microcontrollers in simavr, through its library, cycle by cycle.

The loop over instructions is C (csrc/simavr.c), compiled against simavr's own headers, since its structs differ between versions.
"""

from __future__ import annotations

import ctypes.util
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cffi

from bitneat.errors import BitneatError
from bitneat.native.build import shared_library
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.instructions import AVR
from bitneat.verify.targets.emulated import BLOCK_LIMIT, ByteOrder
from bitneat.verify.targets.image import Image, nop_faults, require_symbols
from bitneat.verify.targets.tracing import SOURCES, TRACE_DECLARATIONS, Recorder, Trace

_DECLARATIONS = """
void *bitneat_avr_new(const char *, const uint8_t *, uint32_t);
void bitneat_avr_free(void *);
uint32_t bitneat_avr_ram_end(void *);
uint8_t *bitneat_avr_data(void *);
int bitneat_avr_run(void *, uint32_t, uint32_t, uint64_t, struct bitneat_trace *);
"""
_HEADERS = (Path("/usr/include/simavr"), Path("/usr/local/include/simavr"))
_DATA = 0x800000  # where gcc's and clang's AVR files have the data space
_RUNAWAY = 1


@dataclass(frozen=True, slots=True)
class SimavrEmulator:
    """One of simavr's microcontrollers."""

    mcu: str
    batch: int = 1

    @property
    def byte_order(self) -> ByteOrder:
        """As the compilers have it."""
        return "little"

    def link_flags(self, image_names: tuple[str, ...]) -> tuple[str, ...]:
        """Flash, then RAM."""
        del image_names
        return (f"-Wl,-T,{SOURCES / 'avr.ld'}",)

    def missing(self) -> str | None:
        """Library and headers."""
        there = ctypes.util.find_library("simavr") and any((path / "sim_core.h").is_file() for path in _HEADERS)
        return None if there else "the emulator simavr (Debian: apt install libsimavr-dev)"

    def load(self, image: Image, *, traced_steps: int = 0) -> SimavrMachine:
        """A machine of its own."""
        return SimavrMachine(self, image, traced_steps)

    def faults(self, image: Image, trace: Trace) -> list[tuple[str, Image]]:
        """Additions and subtractions replaced by instructions that do nothing."""
        return nop_faults(image, trace, AVR)


@cache
def _library() -> tuple[cffi.FFI, Any]:
    ffi = cffi.FFI()
    ffi.cdef(TRACE_DECLARATIONS + _DECLARATIONS)
    path = shared_library(
        [SOURCES / "simavr.c", SOURCES / "trace.c"], name="simavr", flags=("-std=gnu99", "-O2", "-lsimavr")
    )
    return ffi, ffi.dlopen(str(path))


class SimavrMachine:
    """An image in simavr."""

    def __init__(self, emulator: SimavrEmulator, image: Image, traced_steps: int) -> None:
        require_symbols(image, ("bitneat_steps", "bitneat_halt", "bitneat_data_end", image.function))
        self._image = image
        self._ffi, self._library = _library()
        code = [(address, content) for address, content in image.segments if address < _DATA]
        flash = bytearray(max(address + len(content) for address, content in code))
        for address, content in code:
            flash[address : address + len(content)] = content
        self._machine = self._library.bitneat_avr_new(emulator.mcu.encode(), bytes(flash), len(flash))
        if not self._machine:
            raise BitneatError(f"simavr: cannot load {image.code.path} into its {emulator.mcu}")
        self._memory = self._library.bitneat_avr_data(self._machine)
        self._end = int(self._library.bitneat_avr_ram_end(self._machine)) + 1
        stack = range(image.symbols["bitneat_data_end"] - _DATA, self._end)
        self._recorder = Recorder(self._ffi, image.code_range, stack, traced_steps) if traced_steps else None
        if self._recorder is not None:
            self._recorder.struct.entry = image.symbols[image.function]

    def call(self, function: str) -> None:
        """Run until the driver halts."""
        symbols = self._image.symbols
        trace = self._ffi.NULL if self._recorder is None else self._recorder.struct
        result = self._library.bitneat_avr_run(
            self._machine, symbols[function], symbols["bitneat_halt"], BLOCK_LIMIT, trace
        )
        if result == _RUNAWAY:
            raise ImplementationError(f"did not come back within {BLOCK_LIMIT} instructions")
        if result:
            raise ImplementationError("crashed (simavr stopped)")

    def write(self, symbol: str, content: bytes) -> None:
        """To the RAM."""
        self._ffi.memmove(self._memory + self._at(symbol, len(content)), content, len(content))

    def read(self, symbol: str, size: int) -> bytes:
        """From the RAM."""
        return bytes(self._ffi.buffer(self._memory + self._at(symbol, size), size))

    def trace(self) -> Trace:
        """Of all steps so far."""
        assert self._recorder is not None
        return self._recorder.result(return_bytes=2, has_cycles=True)

    def close(self) -> None:
        """End the machine."""
        if self._machine is not None:
            self._library.bitneat_avr_free(self._machine)
            self._machine = None

    def _at(self, symbol: str, size: int) -> int:
        address = self._image.symbols[symbol] - _DATA
        if address + size > self._end:
            raise BitneatError(f"{self._image.code.path}: its inputs and outputs do not fit into the RAM")
        return address
