# SPDX-License-Identifier: MIT
"""Compiled sensor maps against integers in Python: all counts of 16 bits, extremes and random ones of 32."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from bitneat.codegen import GeneratedC, generate
from bitneat.codegen.sensor import SensorFiles, SensorPlan, plan, sensor_files
from bitneat.codegen.sensor.affine import IntegerMap
from bitneat.codegen.sensor.read import ConstantInput, InputMap, MappedInput, MappedOutput, SensorMap, UnusedInput
from bitneat.controller import Action, BoxAction, Controller, DiscreteAction, Input, Link, Node, Reference, Signal
from bitneat.controller.interval import Interval
from bitneat.native.compiler import zig_compiler

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")

COUNTS = [
    Interval(0, 65535),  # fills its type: nothing to clip
    Interval(-32768, 32767),
    Interval(0, 4095),
    Interval(-2048, 2047),
    Interval(1000, 60000),
    Interval(0, 1),
    Interval(-(2**23), 2**23 - 1),
    Interval(-(2**24), 2**24),
    Interval(-3, 65535),
    Interval(200, 300),
    Interval(-(2**22), 2**22),  # with a slope that clips nearly everywhere
]


def some_map(rng: random.Random, controller: Controller) -> SensorMap:
    """Every kind of range, scales that leave some inputs room, and that clip others."""
    inputs: list[InputMap] = []
    for index in range(len(controller.inputs) - 2):
        counts = COUNTS[index % len(COUNTS)]
        reach = Fraction(rng.randint(1, 4000), 1000) * rng.choice((1, -1))  # of the value ±1 at the ends
        scale = 2 * reach / (counts.high - counts.low)
        if index == len(COUNTS) - 1:
            scale = Fraction(3, 2)
        offset = Fraction(rng.randint(-100, 100), 200) - scale * Fraction(counts.low + counts.high, 2)
        inputs.append(MappedInput(f"m{index}", counts, scale, offset, Fraction(rng.choice((6, 10, 30)), 10)))
    inputs += [ConstantInput(Fraction(-1, 3)), UnusedInput()]
    spans = [(1000, 2000), (255, 0), (-500_000, 500_000), (-128, 127)]
    outputs = [
        MappedOutput(f"a{index}", (Fraction(-1, 1 + index % 2), Fraction(1)), spans[index % 4], Fraction(1))
        for index in range(len(controller.outputs))
    ]
    return SensorMap("map.toml", tuple(inputs), tuple(outputs))


def sensed_controller(num_inputs: int = 13) -> Controller:
    """Outputs that are clamped, and that reach all of int16; two inputs more than there are mapped, the last unread."""
    limits = [2047, 32767, 500, 200, 30000]
    inputs = tuple(Input(index % 3 - 1, limits[index % 5]) for index in range(num_inputs))
    links = tuple(Link(index) for index in range(num_inputs - 1))
    nodes = (Node(links), Node(links, activation="identity"), Node((Link(0), Link(1, sign=-1)), activation="relu"))
    outputs = tuple(Signal(num_inputs + index) for index in (0, 1, 2, 0))
    return Controller(inputs, nodes, outputs)


def build(
    folder: Path, controller: Controller, action: Action, sensor_map: SensorMap
) -> tuple[SensorPlan, SensorFiles]:
    sensors = plan(controller, action, sensor_map)
    code: GeneratedC = generate(controller, "w", "unrolled", action=action)
    files = sensor_files(code, controller, sensors)
    for name, text in {
        "w.h": code.header,
        "w.c": code.source,
        "w_sensors.h": files.header,
        "w_sensors.c": files.source,
        "w_sensors_selftest.c": files.selftest,
    }.items():
        (folder / name).write_text(text, encoding="ascii")
    return sensors, files


def box(controller: Controller) -> BoxAction:
    count = len(controller.outputs)
    return BoxAction((-1.0,) * count, (1.0, 3.0) * (count // 2), (count,), "float32")


def sweep(channels: Sequence[Interval], rng: random.Random) -> np.ndarray:
    """Rows of one value a channel: all of 16 bits where the channel's type has 16, else the edges of its range and random."""
    columns = []
    for held in channels:
        if held.high - held.low == 65535:
            columns.append(np.arange(held.low, held.high + 1))
        else:
            edges = [held.low, held.high, 0, -1, 1]
            columns.append(np.array(edges + [rng.randint(held.low, held.high) for _ in range(65536 - len(edges))]))
    return np.stack(columns, axis=1).astype("<i4")


def held_by(member_type: str) -> Interval:
    return {"uint16_t": Interval(0, 65535), "int16_t": Interval(-32768, 32767)}.get(
        member_type, Interval(-(2**31), 2**31 - 1)
    )


def program(files: SensorFiles, num_inputs: int) -> str:
    """Reads rows of counts and writes observations, then rows of signals and writes counts; int32 all."""
    reads = "".join(f"        s.{m.name} = ({m.type})row[{i}];\n" for i, m in enumerate(files.inputs))
    writes = "".join(f"        row[{i}] = (int32_t)a.{m.name};\n" for i, m in enumerate(files.outputs))
    return f"""
#include <stdio.h>
#include "w_sensors.h"
int main(void)
{{
    int32_t row[64]; int16_t signals[64]; struct w_sensors s; struct w_actuators a;
    for (long i = 0; i < 65536; i++) {{
        if (fread(row, 4, {len(files.inputs)}, stdin) != {len(files.inputs)}) return 3;
{reads}        w_observe(&s, signals);
        fwrite(signals, 2, {num_inputs}, stdout);
    }}
    for (long i = 0; i < 65536; i++) {{
        if (fread(row, 4, {len(files.outputs)}, stdin) != {len(files.outputs)}) return 3;
        for (int j = 0; j < {len(files.outputs)}; j++) signals[j] = (int16_t)row[j];
        w_actuate(signals, &a);
{writes}        fwrite(row, 4, {len(files.outputs)}, stdout);
    }}
    return 0;
}}
"""


def commands() -> dict[str, list[str]]:
    zig = zig_compiler()
    assert zig is not None
    return {
        "gcc -O0, sanitized": ["gcc", *STRICT, *SANITIZERS, "-O0"],
        "gcc -O2": ["gcc", *STRICT, "-O2"],
        "g++ -O2, as C++": ["g++", "-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2"],
        "clang -Os": [*zig.command, *STRICT, "-Os"],
    }


def in_lanes(integer: IntegerMap, x: np.ndarray) -> np.ndarray:
    """The formula of docs/sensor-maps.md for many arguments; some of them in exact integers, too."""
    q = (np.clip(x.astype(np.int64), *integer.domain) - integer.domain.low) >> integer.pre
    total = integer.bias + sum(term.sign * (q << term.shift) for term in integer.terms)
    result = np.clip(total >> integer.post, *integer.image)
    assert [integer(value) for value in x[:300].tolist()] == result[:300].tolist()
    return result


@pytest.mark.parametrize("which", ["gcc -O0, sanitized", "gcc -O2", "g++ -O2, as C++", "clang -Os"])
@pytest.mark.parametrize("seed", [1, 2])
def test_every_16_bit_count_and_many_of_32_give_what_the_integers_say(tmp_path: Path, which: str, seed: int) -> None:
    rng = random.Random(seed)
    controller = sensed_controller()
    sensors, files = build(tmp_path, controller, box(controller), some_map(rng, controller))
    (tmp_path / "main.c").write_text(program(files, len(controller.inputs)))
    command = commands()[which]
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    subprocess.run([*command, "main.c", "w_sensors.c", "w.c", "-o", "main"], cwd=tmp_path, check=True)
    counts = sweep([held_by(member.type) for member in files.inputs], rng)
    signals = sweep([channel.takes or Interval(-32768, 32767) for channel in sensors.outputs], rng)
    done = subprocess.run(
        [tmp_path / "main"], input=counts.tobytes() + signals.tobytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")[:2000]
    split = 65536 * len(controller.inputs) * 2
    observed = np.frombuffer(done.stdout[:split], "<i2").reshape(65536, -1)
    written = np.frombuffer(done.stdout[split:], "<i4").reshape(65536, -1)
    for column, channel in enumerate(sensors.inputs):
        assert (observed[:, channel.index] == in_lanes(channel.integer, counts[:, column])).all(), channel.name
    for column, channel in enumerate(sensors.outputs):
        assert (written[:, column] == in_lanes(channel.integer, signals[:, column])).all(), channel.name
    for index, value in sensors.constants:
        assert (observed[:, index] == value).all()


def test_an_actuator_follows_the_action_space_within_its_bound(tmp_path: Path) -> None:
    """From the definition of the action in floats, not from the map's own numbers."""
    controller = sensed_controller()
    action = box(controller)
    sensor_map = some_map(random.Random(3), controller)
    sensors, _ = build(tmp_path, controller, action, sensor_map)
    for channel, mapped in zip(sensors.outputs, sensor_map.outputs, strict=True):
        (v0, v1), (c0, c1) = mapped.values, mapped.counts
        for y in range(-300, 301):
            low, high = action.low[channel.index], action.high[channel.index]
            value = low + (min(max(y / 256, -1.0), 1.0) + 1) / 2 * (high - low)
            count = float(c0 + (value - float(v0)) * (c1 - c0) / float(v1 - v0))
            count = min(max(count, min(c0, c1)), max(c0, c1))
            assert abs(channel.integer(y) - count) <= float(channel.integer.error) + 1e-6


@pytest.mark.parametrize("compiler", ["gcc-m0", "zig-m0"])
@pytest.mark.parametrize("level", ["-Os", "-O2", "-O3"])
def test_there_is_no_branch_and_no_multiplication(tmp_path: Path, compiler: str, level: str) -> None:
    controller = sensed_controller()
    build(tmp_path, controller, box(controller), some_map(random.Random(4), controller))
    zig = zig_compiler("thumb-freestanding-eabi")
    assert zig is not None
    flags = {
        "gcc-m0": ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb"],
        "zig-m0": [*zig.command, "-mcpu=cortex_m0", "-fno-sanitize=undefined"],
    }
    if shutil.which("arm-none-eabi-objdump") is None or shutil.which(flags[compiler][0]) is None:
        pytest.skip("no cross tools for Arm; tools/install-debian-tools.sh installs them")
    command = [*flags[compiler], "-std=c99", level, "-ffreestanding", "-c", "w_sensors.c", "-o", "w.o"]
    subprocess.run(command, cwd=tmp_path, check=True)
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "w.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    mnemonics = re.findall(r"^\s+[0-9a-f]+:\t[0-9a-f ]+\t([a-z.]+)", listing, re.MULTILINE)
    assert len(mnemonics) > 200
    forbidden = re.compile(r"(mul|[su]div|[us]?ml|cb?n?z|b(eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|hs|lo))(\.|s?$)")
    assert [name for name in mnemonics if forbidden.match(name)] == []
    symbols = subprocess.run(
        ["arm-none-eabi-nm", "-u", "w.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(symbols) <= {"U", "w_step", "__aeabi_unwind_cpp_pr0"}


def run_selftest(folder: Path, *defines: str) -> int:
    command = ["cc", *STRICT, "-DW_SENSORS_SELFTEST_MAIN", *defines, "w_sensors_selftest.c", "w_sensors.c", "w.c"]
    subprocess.run([*command, "-o", "selftest"], cwd=folder, check=True)
    return subprocess.run([folder / "selftest"], check=False).returncode


def test_the_selftest_passes_and_notices_a_changed_shift_or_constant(tmp_path: Path) -> None:
    controller = sensed_controller()
    build(tmp_path, controller, box(controller), some_map(random.Random(5), controller))
    assert run_selftest(tmp_path) == 0
    source = (tmp_path / "w_sensors.c").read_text()
    shifts = [match.start(1) for match in re.finditer(r"opaque\(q << (\d+)\);", source)]
    faults = [source[:at] + str(int(source[at]) ^ 1) + source[at + 1 :] for at in shifts]
    faults += [re.sub(r"observation\[11\] = (-?\d+);", "observation[11] = 1;", source)]
    assert len(faults) > 10
    assert source not in faults
    for fault in faults:
        (tmp_path / "w_sensors.c").write_text(fault)
        assert run_selftest(tmp_path) != 0


AVR_MAIN = """
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include "w_sensors.h"
int w_sensors_selftest(void);
static void put(char c) { while (!(UCSR0A & (1 << UDRE0))) { } UDR0 = (uint8_t)c; }
int main(void)
{
    UCSR0B = 1 << TXEN0;
    put(w_sensors_selftest() == 0 ? 'P' : 'F');
    put('\\n');
    while (!(UCSR0A & (1 << UDRE0))) { }
    cli();
    sleep_mode();
    return 0;
}
"""


@pytest.mark.parametrize("seed", [6, 7])
def test_an_int_of_16_bits_gives_the_same_answers(tmp_path: Path, seed: int) -> None:
    for tool in ("avr-gcc", "simavr"):
        assert shutil.which(tool), f"{tool} is missing: run tools/install-debian-tools.sh"
    controller = sensed_controller()
    build(tmp_path, controller, box(controller), some_map(random.Random(seed), controller))
    (tmp_path / "main.c").write_text(AVR_MAIN)
    sources = ["main.c", "w_sensors_selftest.c", "w_sensors.c", "w.c"]
    subprocess.run(["avr-gcc", "-mmcu=atmega328p", *STRICT, "-Os", *sources, "-o", "m.elf"], cwd=tmp_path, check=True)
    done = subprocess.run(
        ["simavr", "-m", "atmega328p", "-f", "16000000", "m.elf"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search("[PF]", re.sub(r"Loaded.*", "", done.stdout + done.stderr))
    assert found is not None
    assert found.group() == "P"


def test_a_step_from_counts_is_observe_then_step_then_decide(tmp_path: Path) -> None:
    """A recurrent controller that chooses: the state and the choice go through."""
    nodes = (Node((Link(0), Link(1, delay=1))), Node((Link(0, sign=-1), Link(2, delay=1))))
    controller = Controller((Input(),), nodes, (Signal(1), Signal(2)))
    action = DiscreteAction(2, 5)
    entry = MappedInput("knob", Interval(0, 255), Fraction(1, 128), Fraction(-1), Fraction(1))
    sensors, _ = build(tmp_path, controller, action, SensorMap("map.toml", (entry,), ()))
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "w_sensors.h"\n'
        "int main(void) { struct w_state state; struct w_sensors s; w_reset(&state);\n"
        "for (int i = 0; i < 200; i++) { s.knob = (uint16_t)(i * 37 % 256);\n"
        'printf("%ld\\n", (long)w_step_counts(&state, &s)); } return 0; }\n'
    )
    subprocess.run(["cc", *STRICT, "main.c", "w_sensors.c", "w.c", "-o", "main"], cwd=tmp_path, check=True)
    answers = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.split()
    inputs = [[sensors.inputs[0].integer(i * 37 % 256)] for i in range(200)]
    outputs = Reference(controller).run(inputs)
    assert [int(answer) for answer in answers] == [5 + row.index(max(row)) for row in map(list, outputs)]
    assert len(set(answers)) == 2
