# SPDX-License-Identifier: MIT
"""Builds a candidate for a Cortex-M0, links it alone, runs it in Unicorn, and counts.

Every candidate is compiled by arm-none-eabi-gcc at -Os with sections dropped that nothing uses, and linked with libgcc (software
floats, multiplication of 64 bits) and plain loops for memcpy and memset, which count where they are used. Flash is all that is
loaded, less an empty program's; RAM is static data without the arrays that carry inputs and outputs.
"""

from __future__ import annotations

import io
import random
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elftools.elf.elffile import ELFFile

from benchmarks.peers.candidate import Candidate
from bitneat.controller import Controller, Reference

HERE = Path(__file__).parent
VECTORS = 16
SEED = 5
FLAGS = (
    *("-mcpu=cortex-m0", "-mthumb", "-std=c99", "-Os", "-ffreestanding", "-w"),
    *("-ffunction-sections", "-fdata-sections", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables"),
)
LINK = ("-nostdlib", "-Wl,--gc-sections", "-Wl,--entry=run")
RAM_START, RAM_SIZE = 0x20000000, 0x100000
FLASH_SIZE = 0x100000
STACK_END, STACK_SIZE = RAM_START + RAM_SIZE, 0x4000
FORMATS = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "float": "f"}

_MAIN = """
#include <stdint.h>
#include <stddef.h>
{prologue}
{element} input[{inputs}] __attribute__((section(".io")));
{element} output[{outputs}] __attribute__((section(".io")));
void run(void) {{ {call} __asm__ volatile("" : : : "memory"); }}
"""


@dataclass(frozen=True)
class Measured:
    """What one candidate takes: bytes, and instructions of one step, fewest and most over all vectors.

    ``largest_difference`` is that of any output from what it should be, in units of 1.0.
    """

    flash: int
    ram: int
    stack: int
    instructions: tuple[int, int]
    largest_difference: float


def measure(candidate: Candidate, controller: Controller) -> Measured:
    """Build, link, run, count.

    Raises:
        subprocess.CalledProcessError: if the compiler or linker refuses it.
    """
    sizes = len(controller.inputs), len(controller.outputs)
    with tempfile.TemporaryDirectory(prefix="bitneat-peers-") as name:
        folder = Path(name)
        for path, text in candidate.sources.items():
            (folder / path).write_text(text, encoding="utf-8")
        main = _MAIN.format(
            prologue=candidate.prologue,
            element=candidate.element,
            inputs=sizes[0],
            outputs=sizes[1],
            call=candidate.call,
        )
        elf = _link(folder, main, [path for path in candidate.sources if path.endswith(".c")], candidate.include)
        empty = _link(folder, _MAIN.format(prologue="", element="int8_t", inputs=1, outputs=1, call=""), [], ())
        machine = _Machine(elf)
        flash, ram = machine.flash - _Machine(empty).flash, machine.ram
    vectors = _vectors(controller)
    differences, counts = [0.0], []
    reference = Reference(controller)
    for signals in vectors:
        inputs, expected = _converted(candidate, controller, signals, reference)
        outputs = machine.run(inputs, FORMATS[candidate.element], sizes[1])
        counts.append(machine.instructions)
        differences += [abs(a - b) / candidate.unit for a, b in zip(outputs, expected, strict=True)]
    return Measured(flash, ram, machine.stack, (min(counts), max(counts)), max(differences))


def _converted(
    candidate: Candidate, controller: Controller, signals: Sequence[int], reference: Reference
) -> tuple[list[float], list[float]]:
    """Inputs and expected outputs in the candidate's own numbers."""
    if candidate.expected is not None:
        inputs = [max(-127, min(127, round(signal * candidate.unit / controller.one))) for signal in signals]
        return list(inputs), list(candidate.expected(inputs))
    factor = candidate.unit / controller.one
    return [signal * factor for signal in signals], [value * factor for value in reference.step(signals)]


def _vectors(controller: Controller) -> list[list[int]]:
    rng = random.Random(SEED)
    limits = [entry.limit for entry in controller.inputs]
    rows = [limits, [-limit for limit in limits], [0] * len(limits)]
    while len(rows) < VECTORS:
        reach = 1 << rng.randint(4, 11)
        rows.append([max(-limit, min(limit, rng.randint(-reach, reach))) for limit in limits])
    return rows


def _link(folder: Path, main: str, sources: Sequence[str], include: Sequence[Path]) -> bytes:
    (folder / "main.c").write_text(main, encoding="utf-8")
    command = ["arm-none-eabi-gcc", *FLAGS, *LINK, "-T", HERE / "cortex-m0.ld", f"-I{folder}", f"-I{HERE / 'include'}"]
    command += [*(f"-I{path}" for path in include), folder / "main.c", *(folder / path for path in sources)]
    command += [HERE / "library.c", "-lgcc", "-o", folder / "program.elf"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return (folder / "program.elf").read_bytes()


class _Machine:
    """A Cortex-M0 with one program; ``instructions`` are those of the last run, ``stack`` is the deepest of all."""

    def __init__(self, elf: bytes) -> None:
        import unicorn
        from unicorn import arm_const

        self._registers = arm_const
        file = ELFFile(io.BytesIO(elf))
        self._symbols = {
            symbol.name: symbol["st_value"] for symbol in file.get_section_by_name(".symtab").iter_symbols()
        }
        self.flash = self.ram = 0
        self._machine: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._machine.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M0)
        self._machine.mem_map(0, FLASH_SIZE)
        self._machine.mem_map(RAM_START, RAM_SIZE)
        for section in file.iter_sections():
            if not section["sh_flags"] & 2 or section["sh_size"] == 0:
                continue
            if section.name == ".io":
                continue
            if section["sh_type"] != "SHT_NOBITS":
                self.flash += section["sh_size"]
                self._machine.mem_write(section["sh_addr"], section.data())
            if section["sh_flags"] & 1:
                self.ram += section["sh_size"]
        self._machine.hook_add(unicorn.UC_HOOK_CODE, self._count)
        self.instructions = self.stack = 0

    def _count(self, machine: Any, address: int, size: int, data: Any) -> None:
        self.instructions += 1

    def run(self, inputs: Sequence[float], form: str, num_outputs: int) -> list[float]:
        """The outputs of one step."""
        values = inputs if form == "f" else [int(value) for value in inputs]
        self._machine.mem_write(STACK_END - STACK_SIZE, b"\xa5" * STACK_SIZE)
        self._machine.mem_write(self._symbols["input"], struct.pack(f"<{len(values)}{form}", *values))
        self._machine.reg_write(self._registers.UC_ARM_REG_SP, STACK_END)
        end = FLASH_SIZE - 16
        self._machine.reg_write(self._registers.UC_ARM_REG_LR, end | 1)
        self.instructions = 0
        self._machine.emu_start(self._symbols["run"] | 1, end)
        used = bytes(self._machine.mem_read(STACK_END - STACK_SIZE, STACK_SIZE)).lstrip(b"\xa5")
        self.stack = max(self.stack, len(used))
        data = self._machine.mem_read(self._symbols["output"], num_outputs * struct.calcsize(form))
        return list(struct.unpack(f"<{num_outputs}{form}", data))
