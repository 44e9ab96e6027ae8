# SPDX-License-Identifier: MIT
"""Measures the C that is generated for one sparse ternary network, side by side with what was written by hand for it.

``python benchmarks/netb.py`` needs arm-none-eabi-gcc, avr-gcc, simavr and the package unicorn; what is missing is said, and its
rows are left out. The network is random: 24 inputs, 31 clamped nodes, 101 links, 4 outputs, inputs limited to ±2047. It
stands for what evolution finds, without depending on one run of it.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bitneat.champion import load
from bitneat.codegen import GeneratedC, generate
from bitneat.controller import Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.packing import Layout

NETWORK = Path(__file__).with_name("netb.json")
LIMIT = 2047
SEED = 1
ARM = ("arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb", "-std=c99", "-ffreestanding")
AVR = ("avr-gcc", "-mmcu=atmega328p", "-std=c99", "-ffreestanding")
SPEEDS = (("-Os", "-DNET_FAST"), ("-O2",), ("-O2", "-DNET_FAST"), ("-O3",), ("-Os",))
"""What the fastest setting of the unrolled style is looked for among."""


@dataclass(frozen=True, slots=True)
class Row:
    """One figure, with the goal and what was reached by hand for this network (None: not measured there)."""

    what: str
    unit: str
    measured: int
    goal: int | None = None
    by_hand: int | None = None


def network(path: Path = NETWORK) -> Controller:
    """The network of ``netb.json``: links are (source, target, weight), signals in topological order, outputs last."""
    data = json.loads(path.read_text())
    first = data["num_inputs"]
    links: dict[int, list[Link]] = {first + i: [] for i in range(data["num_nodes"])}
    for source, target, weight in data["links"]:
        links[target].append(Link(source, sign=weight))
    total = first + data["num_nodes"]
    return Controller(
        inputs=tuple(Input(0, LIMIT) for _ in range(first)),
        nodes=tuple(Node(tuple(one), activation="clamped") for one in links.values()),
        outputs=tuple(Signal(index) for index in range(total - data["num_outputs"], total)),
        frac_bits=data["frac_bits"],
    )


def write(code: GeneratedC, folder: Path) -> Path:
    """The source and header in a folder."""
    (folder / code.header_name).write_text(code.header)
    path = folder / f"{code.style}.c"
    path.write_text(code.source)
    return path


def run(*command: object) -> str:
    """The output of a tool."""
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True).stdout


def flash(compiler: Sequence[str], source: Path, *flags: str) -> int:
    """Bytes of code and constants of a whole object."""
    out = source.with_suffix(".o")
    run(*compiler, *flags, "-c", source, "-o", out)
    return sum(int(field) for field in run("size", out).splitlines()[1].split()[:2])


def run_flash(compiler: Sequence[str], source: Path) -> int:
    """Bytes of ``net_run`` and its table: what an object takes without the ``net_step`` around it."""
    whole = flash(compiler, source, "-Os")
    for line in run("nm", "-S", source.with_suffix(".o")).splitlines():
        fields = line.split()
        if fields[-1] == "net_step":
            return whole - int(fields[1], 16)
    raise SystemExit("netb: net_step is not in the object")


def instructions(source: Path, controller: Controller, flags: Sequence[str], function: str) -> tuple[int, int]:
    """Instructions of one call on a Cortex-M0 and the bytes of stack it takes; its outputs are checked against the reference."""
    from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc
    from unicorn import arm_const as arm

    code, data, stack, back = 0x10000, 0x20000000, 0x20008000, 0x40000
    program = source.with_suffix(".elf")
    linking = ("-nostdlib", f"-Wl,-Ttext={code:#x}", "-e", function)
    run(*ARM, *flags, *linking, source, "-o", program)
    image = program.with_suffix(".bin")
    run("arm-none-eabi-objcopy", "-O", "binary", program, image)
    names = {line.split()[-1]: int(line.split()[0], 16) for line in run("nm", program).splitlines()}
    rng = random.Random(SEED)
    counts = set()
    lowest = stack
    for _ in range(20):
        inputs = [rng.randint(-LIMIT, LIMIT) >> rng.randrange(8) for _ in controller.inputs]
        machine = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        machine.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M0)
        machine.mem_map(code, 0x40000)
        machine.mem_map(data, 0x10000)
        machine.mem_write(code, image.read_bytes())
        machine.mem_write(data, struct.pack(f"<{len(inputs)}h", *inputs))
        registers = {arm.UC_ARM_REG_SP: stack, arm.UC_ARM_REG_LR: back | 1, arm.UC_ARM_REG_R0: data}
        for register, value in (registers | {arm.UC_ARM_REG_R1: data + 0x1000}).items():
            machine.reg_write(register, value)
        seen: list[int] = []
        machine.hook_add(UC_HOOK_CODE, lambda m, *_, seen=seen: seen.append(m.reg_read(arm.UC_ARM_REG_SP)))
        machine.emu_start(names[function] | 1, back)
        num_outputs = len(controller.outputs)
        last = 2 * (Layout(controller.canonical).workspace_length - num_outputs)
        where = data + (0x1000 if function.endswith("step") else last)
        found = list(struct.unpack(f"<{num_outputs}h", machine.mem_read(where, 2 * num_outputs)))
        if found != Reference(controller).step(inputs):
            raise SystemExit(
                f"netb: {function} {' '.join(flags)} gives {found} for {inputs}, not what the reference gives"
            )
        counts.add(len(seen))
        lowest = min(lowest, *seen)
    if len(counts) != 1:
        raise SystemExit(f"netb: the number of instructions depends on the inputs: {sorted(counts)}")
    return counts.pop(), stack - lowest


_TIMER = """
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/interrupt.h>
#include "{source}"
static int16_t in[{signals}];
static int16_t out[{outputs}];
static void put(char c) {{ while (!(UCSR0A & (1 << UDRE0))) {{ }} UDR0 = (uint8_t)c; }}
__attribute__((noinline, noclone)) static void nothing(const int16_t *a, int16_t *b) {{ __asm__ volatile("" : : "r"(a), "r"(b)); }}
void (*volatile subjects[2])(const int16_t *, int16_t *) = {{ nothing, {call} }};
int main(void)
{{
    UCSR0B = 1 << TXEN0;
    TCCR1B = 1 << CS10;
    for (uint8_t turn = 0; turn < 2; turn++) {{
        void (*const subject)(const int16_t *, int16_t *) = subjects[turn];
        TCNT1 = 0;
        subject(in, out);
        uint16_t took = TCNT1;
        put(turn ? 'B' : 'A');
        for (uint8_t i = 0; i < 4; i++) {{ put((char)('a' + (took >> 12))); took = (uint16_t)(took << 4); }}
    }}
    put('\\n');
    while (!(UCSR0A & (1 << UDRE0))) {{ }}
    cli();
    sleep_mode();
    return 0;
}}
"""


def avr_cycles(source: Path, controller: Controller, *flags: str) -> int:
    """Cycles of one ``net_step`` on an emulated ATmega328P, from its call to its return without both."""
    folder = source.parent
    text = _TIMER.format(
        source=source.name, signals=controller.num_signals, outputs=len(controller.outputs), call="net_step"
    )
    (folder / "timer.c").write_text(text)
    run(*AVR[:2], "-std=gnu99", *flags, f"-I{folder}", folder / "timer.c", "-o", folder / "timer.elf")
    done = subprocess.run(
        ["simavr", "-m", "atmega328p", "-f", "16000000", str(folder / "timer.elf")],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    text = done.stdout + done.stderr
    start = text.index("A")
    while text[start + 5] != "B":
        start = text.index("A", start + 1)
    empty, full = (
        sum((ord(c) - 97) << 4 * (3 - i) for i, c in enumerate(text[at + 1 : at + 5])) for at in (start, start + 5)
    )
    return full - empty


def rows(controller: Controller, folder: Path, *, goals: bool) -> list[Row]:
    """All figures of one controller; goals and figures by hand are those of netb alone."""
    code = {style: generate(controller, "net", style, header_name=f"{style}.h") for style in ("table", "unrolled")}  # type: ignore[arg-type]
    table, unrolled = (write(code[style], folder) for style in ("table", "unrolled"))
    found: list[Row] = []

    def add(what: str, unit: str, measured: int, goal: int | None = None, by_hand: int | None = None) -> None:
        found.append(Row(what, unit, measured, goal if goals else None, by_hand if goals else None))

    if available("arm-none-eabi-gcc"):
        add("Cortex-M0 table, run in place, -Os", "bytes", run_flash(ARM, table), 180, 193)
        add("Cortex-M0 table, step around it, -Os", "bytes", flash(ARM, table, "-Os"), 225)
        add("Cortex-M0 unrolled, -Os", "bytes", flash(ARM, unrolled, "-Os"), 640, 642)
        try:
            import unicorn
        except ImportError:
            print("netb: no instructions counted; pip install unicorn", file=sys.stderr)
        else:
            del unicorn
            if not controller.is_recurrent:
                count, stack = instructions(table, controller, ("-Os",), "net_run")
                add("Cortex-M0 table, run in place, -Os", "instructions", count, None, 2251)
                add("Cortex-M0 table, run in place, -Os", "bytes of stack", stack, 32)
                add(
                    "Cortex-M0 unrolled, -Os",
                    "instructions",
                    instructions(unrolled, controller, ("-Os",), "net_step")[0],
                    None,
                    650,
                )
                best = min((instructions(unrolled, controller, flags, "net_step")[0], flags) for flags in SPEEDS)
                add(f"Cortex-M0 unrolled, {' '.join(best[1])} (fastest)", "instructions", best[0], 520, 530)
    if available("avr-gcc"):
        add("AVR table, run in place, -Os", "bytes", run_flash(AVR, table), 215)
        add("AVR unrolled, -Os", "bytes", flash(AVR, unrolled, "-Os"), 1100, 1074)
        if available("simavr"):
            add("AVR table, step, -Os", "cycles", avr_cycles(table, controller, "-Os"))
            for flags in (("-Os",), ("-Os", "-DNET_FAST"), ("-O2",)):
                add(f"AVR unrolled, {' '.join(flags)}", "cycles", avr_cycles(unrolled, controller, *flags), 1450)
    return found


def available(tool: str) -> bool:
    """Whether a tool is there; says so if not."""
    if shutil.which(tool):
        return True
    print(f"netb: nothing measured with {tool}, which is missing; see tools/install-debian-tools.sh", file=sys.stderr)
    return False


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a Markdown table for each network."""
    parser = argparse.ArgumentParser(description="Measure generated C for a small network, on the small chips.")
    parser.add_argument("champions", nargs="*", type=Path, help="champion files to measure as well")
    args = parser.parse_args(arguments)
    subjects = {"netb": network()} | {str(path): load(path).controller for path in args.champions}
    for name, controller in subjects.items():
        print(f"{name}: {len(controller.nodes)} nodes, {controller.num_links} links")
        print()
        print("| what | unit | measured | goal | by hand |\n|---|---|---|---|---|")
        with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
            for row in rows(controller, Path(folder), goals=name == "netb"):
                cells = ["" if value is None else f"{value:,}" for value in (row.measured, row.goal, row.by_hand)]
                print(f"| {row.what} | {row.unit} | {' | '.join(cells)} |")
        print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
