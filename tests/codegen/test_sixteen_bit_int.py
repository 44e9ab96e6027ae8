# SPDX-License-Identifier: MIT
"""The generated C on a machine whose int has 16 bits: an emulated ATmega328P runs the self-tests."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.codegen import generate, selftest
from bitneat.controller import ACTIVATION_NAMES, Constant, Controller, Input, Link, Node, Signal
from bitneat.native.elf import measure
from tests.strategies import random_controller

MAIN = """
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
static void put(char c) {{ while (!(UCSR0A & (1 << UDRE0))) {{ }} UDR0 = (uint8_t)c; }}
int main(void)
{{
    UCSR0B = 1 << TXEN0;
{calls}
    put('\\n');
    while (!(UCSR0A & (1 << UDRE0))) {{ }}
    cli();
    sleep_mode();
    return 0;
}}
"""
AVR_GCC = ("avr-gcc", "-mmcu=atmega328p", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


def require(*tools: str) -> None:
    for tool in tools:
        assert shutil.which(tool), f"{tool} is missing: run tools/install-debian-tools.sh"


def run_on_avr(folder: Path, controllers: list[Controller], style: str, level: str) -> str:
    """The answers of the controllers' self-tests, a letter each: P for passed, F for failed."""
    calls = []
    for number, controller in enumerate(controllers):
        code = generate(controller, f"c{number}", style)  # type: ignore[arg-type]
        (folder / f"c{number}.h").write_text(code.header)
        (folder / f"c{number}.c").write_text(code.source + selftest(code, controller))
        calls.append(f"    put(c{number}_selftest() == 0 ? 'P' : 'F');")
    includes = "".join(f'#include "c{number}.c"\n' for number in range(len(controllers)))
    (folder / "main.c").write_text(includes + MAIN.format(calls="\n".join(calls)))
    subprocess.run([*AVR_GCC, level, "main.c", "-o", "main.elf"], cwd=folder, check=True)
    done = subprocess.run(
        ["simavr", "-m", "atmega328p", "-f", "16000000", "main.elf"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search(f"[PF]{{{len(controllers)}}}", done.stdout + done.stderr)
    assert found, (done.stdout + done.stderr)[-500:]
    return found.group()


@pytest.mark.parametrize("style", ["unrolled", "table"])
@pytest.mark.parametrize("level", ["-Os", "-O2"])
def test_random_controllers_give_the_reference_answers(tmp_path: Path, style: str, level: str) -> None:
    require("avr-gcc", "simavr")
    controllers: list[Controller] = []
    seed = 900
    while len(controllers) < 8:
        candidate = random_controller(random.Random(seed), size="small")
        seed += 1
        if not all(isinstance(output, Constant) for output in candidate.canonical.outputs):
            controllers.append(candidate)
    assert run_on_avr(tmp_path, controllers, style, level) == "P" * 8


@pytest.mark.parametrize("style", ["unrolled", "table"])
def test_every_activation_gives_the_reference_answers(tmp_path: Path, style: str) -> None:
    require("avr-gcc", "simavr")
    controllers = [
        Controller((Input(),), (Node((Link(0),), gain=-1, activation=name),), (Signal(1),), 4 + index % 9)
        for index, name in enumerate(ACTIVATION_NAMES)
    ]
    assert run_on_avr(tmp_path, controllers, style, "-Os") == "P" * 10


@pytest.mark.parametrize("style", ["unrolled", "table"])
@pytest.mark.parametrize("level", ["-Os", "-O2"])
def test_tables_take_no_ram(tmp_path: Path, style: str, level: str) -> None:
    require("avr-gcc")
    controller = random_controller(random.Random(5), size="medium", feed_forward=True, ternary=True)
    code = generate(controller, "c", style)  # type: ignore[arg-type]
    (tmp_path / "c.h").write_text(code.header)
    (tmp_path / "c.c").write_text(code.source)
    subprocess.run([*AVR_GCC, level, "-c", "c.c", "-o", "c.o"], cwd=tmp_path, check=True)
    sections = subprocess.run(
        ["avr-objdump", "-ht", "c.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert measure(tmp_path / "c.o").ram == 0
    assert "_weights" not in sections
    # On AVR even constants are copied to RAM, unless they are placed in flash.
    assert ".rodata" not in sections
    assert (".progmem" in sections) == (style == "table")
