# SPDX-License-Identifier: MIT
"""Processors of the Unicorn engine, called through its C interface.

The hooks that watch every instruction are C as well (csrc/trace.c): from Python one would take a microsecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cffi

from bitneat.errors import BitneatError
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.instructions import InstructionSet
from bitneat.verify.targets.emulated import BLOCK_LIMIT, ByteOrder
from bitneat.verify.targets.image import Image, nop_faults, require_symbols
from bitneat.verify.targets.tracing import SOURCES, TRACE_DECLARATIONS, Recorder, Trace, trace_library

_DECLARATIONS = """
int uc_open(int, int, void **);
int uc_close(void *);
const char *uc_strerror(int);
int uc_ctl(void *, int, ...);
int uc_mem_map(void *, uint64_t, size_t, uint32_t);
int uc_mem_write(void *, uint64_t, const void *, size_t);
int uc_mem_read(void *, uint64_t, void *, size_t);
int uc_reg_write(void *, int, const void *);
int uc_reg_read(void *, int, void *);
int uc_emu_start(void *, uint64_t, uint64_t, uint64_t, size_t);
int uc_emu_stop(void *);
int uc_hook_add(void *, size_t *, int, void *, void *, uint64_t, uint64_t, ...);
"""
_HOOKS = """
void bitneat_on_code(void *, uint64_t, uint32_t, void *);
void bitneat_on_access(void *, int, uint64_t, int, int64_t, void *);
void bitneat_on_block(void *, uint64_t, uint32_t, void *);
"""
_PAGE = 0x1000
_STACK_BYTES = 0x10000
_SET_CPU_MODEL = 7 | 1 << 26 | 1 << 30  # UC_CTL_WRITE(UC_CTL_CPU_MODEL, 1) of unicorn.h
_READ, _WRITE, _EXECUTE = 1, 2, 4


@dataclass(frozen=True, slots=True)
class UnicornEmulator:
    """One of Unicorn's processors; the names are those of its constants, without ``UC_``.

    Args:
        arch: as in ``UC_ARCH_ARM``.
        modes: as in ``UC_MODE_THUMB``.
        stack_pointer: as in ``UC_ARM_REG_SP``.
        instructions: what it executes.
        cpu: as in ``UC_CPU_ARM_CORTEX_M0``; Unicorn's default if None.
        byte_order: of the processor.
        return_bytes: what a call pushes.
        thumb: whether the lowest bit of an address says how to execute what is there.
    """

    arch: str
    modes: tuple[str, ...]
    stack_pointer: str
    instructions: InstructionSet
    cpu: str | None = None
    byte_order: ByteOrder = "little"
    return_bytes: int = 0
    thumb: bool = False
    batch: int = 512

    def link_flags(self, image_names: tuple[str, ...]) -> tuple[str, ...]:
        """One script for all."""
        del image_names
        return (f"-Wl,-T,{SOURCES / 'image.ld'}",)

    def missing(self) -> str | None:
        """The package."""
        return None if find_spec("unicorn") is not None else "the emulator unicorn (pip install unicorn)"

    def load(self, image: Image, *, traced_steps: int = 0) -> UnicornMachine:
        """A machine of its own."""
        return UnicornMachine(self, image, traced_steps)

    def constant(self, name: str) -> int:
        """One of Unicorn's constants, from the module of the architecture or the general one."""
        for module in (f"unicorn.{self.arch.lower()}_const", "unicorn.unicorn_const"):
            value = getattr(import_module(module), f"UC_{name}", None)
            if value is not None:
                return int(value)
        raise BitneatError(f"unicorn: does not know {name}; a newer version is needed (pip install --upgrade unicorn)")

    def faults(self, image: Image, trace: Trace) -> list[tuple[str, Image]]:
        """Additions and subtractions replaced by instructions that do nothing."""
        return nop_faults(image, trace, self.instructions)


@cache
def _libraries() -> tuple[cffi.FFI, Any, Any]:
    ffi = cffi.FFI()
    ffi.cdef(TRACE_DECLARATIONS + _DECLARATIONS + _HOOKS)
    package = import_module("unicorn")
    folder = Path(str(package.__file__)).parent / "lib"
    paths = sorted([*folder.glob("libunicorn.so*"), *folder.glob("libunicorn*.dylib"), *folder.glob("unicorn.dll")])
    if not paths:
        raise BitneatError(f"{folder}: has no Unicorn library; install unicorn again")
    return ffi, ffi.dlopen(str(paths[0])), ffi.dlopen(str(trace_library()))


class UnicornMachine:
    """An image in Unicorn, with a limit on what a step may take, and hooks if it is to be traced."""

    def __init__(self, emulator: UnicornEmulator, image: Image, traced_steps: int) -> None:
        require_symbols(image, ("bitneat_steps", "bitneat_halt", "bitneat_data_end", image.function))
        self._emulator, self._image = emulator, image
        self._ffi, self._unicorn, self._hooks = _libraries()
        engine = self._ffi.new("void **")
        mode = 0
        for name in emulator.modes:
            mode |= emulator.constant(f"MODE_{name}")
        self._engine = None
        self._check(self._unicorn.uc_open(emulator.constant(f"ARCH_{emulator.arch}"), mode, engine))
        self._engine = engine[0]
        if emulator.cpu is not None:
            model = self._ffi.cast("int", emulator.constant(f"CPU_{emulator.cpu}"))
            self._check(self._unicorn.uc_ctl(self._engine, self._ffi.cast("int", _SET_CPU_MODEL), model))
        self._sp_register = emulator.constant(emulator.stack_pointer)
        stack = self._load()
        self._stack_top = stack.stop - 0x200  # above it callers of some machines have a frame of their own
        self._recorder = Recorder(self._ffi, image.code_range, stack, traced_steps)
        self._watch(traced=traced_steps > 0)

    def _load(self) -> range:
        """Map and fill the memory; where the stack lies."""
        image = self._image
        code = range(image.code_range.start, -(-image.symbols["bitneat_code_end"] // _PAGE) * _PAGE)
        data = range(code.stop, -(-image.symbols["bitneat_data_end"] // _PAGE) * _PAGE)
        stack = range(data.stop + _PAGE, data.stop + _PAGE + _STACK_BYTES)
        # A page between data and stack, and the whole rest, is not there: what strays faults. The driver's code is among the data.
        for where, rights in ((code, _READ), (data, _READ | _WRITE), (stack, _READ | _WRITE)):
            executable = _EXECUTE if where is not stack else 0
            self._check(self._unicorn.uc_mem_map(self._engine, where.start, len(where), rights | executable))
        for address, content in image.segments:
            self._check(self._unicorn.uc_mem_write(self._engine, address, content, len(content)))
        return stack

    def _watch(self, *, traced: bool) -> None:
        struct, ffi, emulator = self._recorder.struct, self._ffi, self._emulator
        struct.entry = self._image.symbols[self._image.function] & ~int(emulator.thumb)
        struct.blocks_left = struct.block_limit = BLOCK_LIMIT
        struct.stop = ffi.addressof(self._unicorn, "uc_emu_stop")
        hooks = [("HOOK_BLOCK", "bitneat_on_block")]
        if traced:
            struct.read_register = ffi.addressof(self._unicorn, "uc_reg_read")
            struct.sp_register = self._sp_register
            hooks += [("HOOK_CODE", "bitneat_on_code")]
            hooks += [("HOOK_MEM_READ", "bitneat_on_access"), ("HOOK_MEM_WRITE", "bitneat_on_access")]
        for kind, function in hooks:
            handle = ffi.new("size_t *")
            self._check(
                self._unicorn.uc_hook_add(
                    self._engine,
                    handle,
                    emulator.constant(kind),
                    ffi.cast("void *", ffi.addressof(self._hooks, function)),
                    struct,
                    ffi.cast("uint64_t", 1),  # beginning after the end: everywhere
                    ffi.cast("uint64_t", 0),
                )
            )

    def call(self, function: str) -> None:
        """Run until the driver halts."""
        symbols, thumb = self._image.symbols, int(self._emulator.thumb)
        self._check(self._unicorn.uc_reg_write(self._engine, self._sp_register, self._word(self._stack_top)))
        begin, until = symbols[function] | thumb, symbols["bitneat_halt"] & ~thumb
        error = self._unicorn.uc_emu_start(self._engine, begin, until, 0, 0)
        if self._recorder.struct.runaway:
            raise ImplementationError(f"did not come back within {BLOCK_LIMIT} basic blocks")
        if error:
            raise ImplementationError(f"crashed ({self._reason(error)})")

    def write(self, symbol: str, content: bytes) -> None:
        """To the memory."""
        address = self._image.symbols[symbol]
        self._check(self._unicorn.uc_mem_write(self._engine, address, content, len(content)))

    def read(self, symbol: str, size: int) -> bytes:
        """From the memory."""
        content = self._ffi.new("char[]", size)
        self._check(self._unicorn.uc_mem_read(self._engine, self._image.symbols[symbol], content, size))
        return bytes(self._ffi.buffer(content, size))

    def trace(self) -> Trace:
        """Of all steps so far."""
        return self._recorder.result(return_bytes=self._emulator.return_bytes, has_cycles=False)

    def close(self) -> None:
        """End the engine."""
        if self._engine is not None:
            self._unicorn.uc_close(self._engine)
            self._engine = None

    def _word(self, value: int) -> Any:
        return self._ffi.new("uint64_t *", value)

    def _check(self, error: int) -> None:
        if error:
            raise BitneatError(f"unicorn: {self._reason(error)}")

    def _reason(self, error: int) -> str:
        return bytes(self._ffi.string(self._unicorn.uc_strerror(error))).decode()


def arm(cpu: str, instructions: InstructionSet) -> UnicornEmulator:
    """A Cortex-M."""
    return UnicornEmulator("ARM", ("THUMB", "MCLASS"), "ARM_REG_SP", instructions, cpu=cpu, thumb=True)
