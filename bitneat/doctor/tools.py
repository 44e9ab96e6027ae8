# SPDX-License-Identifier: MIT
"""Which compilers and emulators are there, and which targets they serve. Nothing is built or run."""

from __future__ import annotations

import shutil
import subprocess

from bitneat.doctor.finding import Finding
from bitneat.errors import BitneatError
from bitneat.native.compiler import host_compiler, identify, zig_compiler
from bitneat.verify.targets import TARGETS
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.simavr_emulator import SimavrEmulator
from bitneat.version import installed_version


def compilers() -> list[Finding]:
    """The host's C compiler, ziglang's, clang, and each gcc that a target names."""
    section = "compilers"
    found = [_host()]
    zig = zig_compiler()
    served = [target.name for target in TARGETS.values() if isinstance(target, Chip)]
    enables = f"any of the {len(served)} chips that has no gcc here; C for this machine where there is no other"
    found.append(
        Finding(section, "ziglang", "found", f"ziglang {installed_version('ziglang')}, {zig.title}", enables)
        if zig
        else Finding(section, "ziglang", "missing", "", enables, "pip install ziglang")
    )
    for command, package, enables in [*_crosses(), ("clang", "clang", "a second opinion on the C, in the tests")]:
        compiler = identify([command])
        if compiler is None:
            found.append(Finding(section, command, "missing", "", enables, f"apt install {package}"))
        else:
            found.append(Finding(section, command, "found", compiler.title, enables))
    return found


def emulators() -> list[Finding]:
    """What runs code for chips."""
    found = []
    for name, enables in (
        ("unicorn", "the targets on Arm, RISC-V, x86 and PowerPC"),
        ("wasmtime", "the target wasm32"),
    ):
        number = installed_version(name)
        remedy = "" if number else f"pip install {name}"
        found.append(Finding("emulators", name, "found" if number else "missing", number or "", enables, remedy))
    missing = SimavrEmulator("atmega328p").missing()
    enables = "the target avr, examples/firmware-atmega328p"
    remedy = "apt install libsimavr-dev" if missing else ""
    found.append(Finding("emulators", "simavr (library)", "missing" if missing else "found", "", enables, remedy))
    title, enables = _title("qemu-system-arm"), "examples/firmware-cortex-m0"
    remedy = "" if title else "apt install qemu-system-arm"
    found.append(Finding("emulators", "qemu-system-arm", "found" if title else "missing", title or "", enables, remedy))
    return found


def targets() -> list[Finding]:
    """Each target of verify, with the compiler that it would take and whether code runs there."""
    found = []
    for target in TARGETS.values():
        try:
            toolchain = target.toolchain()
        except BitneatError as error:
            found.append(Finding("targets", target.name, "failed", str(error), remedy=target.needs))
            continue
        missing = target.needs if toolchain is None else target.missing_to_run()
        detail = "" if toolchain is None else toolchain.compiler.title
        found.append(Finding("targets", target.name, "missing" if missing else "found", detail, remedy=missing or ""))
    return found


def _host() -> Finding:
    enables = "evolve at full speed, verify, size"
    try:
        compiler = host_compiler()
    except BitneatError as error:
        remedy = "apt install gcc, or pip install ziglang; unset CC if it is set"
        return Finding("compilers", "host C compiler", "missing", str(error), enables, remedy, required=True)
    return Finding("compilers", "host C compiler", "found", compiler.title, enables, required=True)


def _crosses() -> list[tuple[str, str, str]]:
    """Each gcc that targets name: command, Debian package, and the targets that it serves."""
    served: dict[tuple[str, str], list[str]] = {}
    for target in TARGETS.values():
        if isinstance(target, Chip) and target.gcc:
            served.setdefault((target.gcc[0], target.package), []).append(target.name)
    return [(command, package, f"gcc's code on {', '.join(names)}") for (command, package), names in served.items()]


def _title(command: str) -> str | None:
    """The first line that a program says of its version; None if it is not there or does not answer."""
    program = shutil.which(command)
    if program is None:
        return None
    answer = subprocess.run(
        [program, "--version"], capture_output=True, stdin=subprocess.DEVNULL, text=True, errors="replace", check=False
    )
    lines = answer.stdout.splitlines()
    return lines[0].strip() if answer.returncode == 0 and lines else None
