# SPDX-License-Identifier: MIT
"""The emulated processors, a row each. docs/adding-a-target.md shows how to add one."""

from __future__ import annotations

from bitneat.verify.instructions import AVR, I386, POWERPC, RISCV, THUMB, X86_64
from bitneat.verify.targets import cortex_m0
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.simavr_emulator import SimavrEmulator
from bitneat.verify.targets.tracing import SOURCES
from bitneat.verify.targets.unicorn_emulator import UnicornEmulator, arm
from bitneat.verify.targets.wasmtime_emulator import WasmtimeEmulator

_THUMB = ("-target", "thumb-freestanding-eabi")
_RISCV = ("-target", "riscv32-freestanding-none")
_FIXED = ("-fno-pic", "-no-pie", "-fcf-protection=none")

CHIPS: tuple[Chip, ...] = (
    Chip(
        name="cortex-m0",
        gcc=("arm-none-eabi-gcc",),
        gcc_flags=("-mcpu=cortex-m0", "-mthumb"),
        package="gcc-arm-none-eabi",
        zig=(*_THUMB, "-mcpu=cortex_m0"),
        emulator=arm("ARM_CORTEX_M0", THUMB),
        instructions=THUMB,
        timing=cortex_m0.cycles,
        cycles_source=cortex_m0.SOURCE,
    ),
    Chip(
        name="cortex-m3",
        gcc=("arm-none-eabi-gcc",),
        gcc_flags=("-mcpu=cortex-m3", "-mthumb"),
        package="gcc-arm-none-eabi",
        zig=(*_THUMB, "-mcpu=cortex_m3"),
        emulator=arm("ARM_CORTEX_M3", THUMB),
        instructions=THUMB,
    ),
    Chip(
        name="cortex-m4",
        gcc=("arm-none-eabi-gcc",),
        gcc_flags=("-mcpu=cortex-m4", "-mthumb"),
        package="gcc-arm-none-eabi",
        zig=(*_THUMB, "-mcpu=cortex_m4"),
        emulator=arm("ARM_CORTEX_M4", THUMB),
        instructions=THUMB,
    ),
    Chip(
        name="cortex-m33",
        gcc=("arm-none-eabi-gcc",),
        gcc_flags=("-mcpu=cortex-m33", "-mthumb"),
        package="gcc-arm-none-eabi",
        zig=(*_THUMB, "-mcpu=cortex_m33"),
        emulator=arm("ARM_CORTEX_M33", THUMB),
        instructions=THUMB,
    ),
    Chip(
        name="rv32imc",
        gcc=("riscv64-unknown-elf-gcc",),
        gcc_flags=("-march=rv32imc", "-mabi=ilp32"),
        package="gcc-riscv64-unknown-elf",
        zig=(*_RISCV, "-mcpu=generic_rv32+m+c-a-f-d"),
        emulator=UnicornEmulator("RISCV", ("RISCV32",), "RISCV_REG_SP", RISCV),
        instructions=RISCV,
    ),
    Chip(
        name="rv32ec",
        gcc=("riscv64-unknown-elf-gcc",),
        gcc_flags=("-march=rv32ec", "-mabi=ilp32e"),
        package="gcc-riscv64-unknown-elf",
        zig=(*_RISCV, "-mcpu=generic_rv32+e+c", "-mabi=ilp32e"),
        emulator=UnicornEmulator("RISCV", ("RISCV32",), "RISCV_REG_SP", RISCV),
        instructions=RISCV,
        chip="CH32V003",
        ram=2048,
        flash=16384,
    ),
    Chip(
        name="avr",
        gcc=("avr-gcc",),
        gcc_flags=("-mmcu=atmega328p",),
        package="gcc-avr avr-libc",
        zig=("-target", "avr-freestanding-none", "-mcpu=atmega328p", "-isystem", str(SOURCES)),
        emulator=SimavrEmulator("atmega328p"),
        instructions=AVR,
        cycles_source="simavr",
        chip="ATmega328P",
        ram=2048,
        flash=32768,
    ),
    Chip(
        name="x86-64",
        gcc=("x86_64-linux-gnu-gcc",),
        gcc_flags=_FIXED,
        package="gcc-x86-64-linux-gnu",
        zig=("-target", "x86_64-freestanding-none", "-mcpu=x86_64"),
        emulator=UnicornEmulator("X86", ("64",), "X86_REG_RSP", X86_64, return_bytes=8),
        instructions=X86_64,
    ),
    Chip(
        name="i386",
        gcc=("i686-linux-gnu-gcc",),
        gcc_flags=_FIXED,
        package="gcc-i686-linux-gnu",
        zig=("-target", "x86-freestanding-none", "-mcpu=i386"),
        emulator=UnicornEmulator("X86", ("32",), "X86_REG_ESP", I386, return_bytes=4),
        instructions=I386,
    ),
    Chip(
        name="ppc",
        zig=("-target", "powerpc-freestanding-eabi"),
        emulator=UnicornEmulator("PPC", ("PPC32", "BIG_ENDIAN"), "PPC_REG_1", POWERPC, byte_order="big"),
        instructions=POWERPC,
    ),
    Chip(
        name="wasm32",
        zig=("-target", "wasm32-freestanding", "-mcpu=mvp"),
        emulator=WasmtimeEmulator(),
        instructions=None,
    ),
)
