# SPDX-License-Identifier: MIT
"""The table of docs/benchmarks.md: every network by every generator."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from importlib.metadata import version
from math import ceil
from pathlib import Path

from benchmarks.peers.candidate import Candidate, CannotExpressError
from benchmarks.peers.emlearn_code import emlearn_code
from benchmarks.peers.emx_code import emx_float, emx_int8
from benchmarks.peers.measure import Measured, measure
from benchmarks.peers.networks import networks
from benchmarks.peers.ours import bitneat_code
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.native.compiler import identify
from bitneat.version import __version__

START, END = "<!-- peers -->\n", "<!-- /peers -->\n"

GENERATORS: dict[str, Callable[[Controller], Candidate]] = {
    "bitneat, table": lambda controller: bitneat_code(controller, "table"),
    "bitneat, unrolled": lambda controller: bitneat_code(controller, "unrolled"),
    "emx-onnx-cgen, int8": emx_int8,
    "emx-onnx-cgen, float": emx_float,
    "emlearn, float": emlearn_code,
}


def rows(announce: Callable[[str], None]) -> Iterator[tuple[str, str, Measured | str, str]]:
    """Network, generator, what was measured or why not, and a note."""
    for network, controller in networks().items():
        for name, generator in GENERATORS.items():
            announce(f"{network}: {name}")
            try:
                candidate = generator(controller)
                yield network, name, measure(candidate, controller), candidate.note
            except CannotExpressError as error:
                yield network, name, "cannot", str(error)
            except subprocess.CalledProcessError as error:
                lines = [line for line in (error.stderr or "").splitlines() if "error" in line]
                yield network, name, "failed", lines[0][:100] if lines else f"exit status {error.returncode}"


def section(announce: Callable[[str], None]) -> str:
    """The whole section, between its marks."""
    compiler = identify(["arm-none-eabi-gcc"])
    assert compiler is not None
    lines = [
        f"bitneat {__version__}, emlearn {version('emlearn')}, emx-onnx-cgen {version('emx-onnx-cgen')}; {compiler.title}, -Os",
        "",
        "| network | generator | flash | static RAM | stack | instructions a step | largest difference | note |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for network, name, measured, note in rows(announce):
        if isinstance(measured, str):
            lines.append(f"| {network} | {name} | {measured} | | | | | {note} |")
            continue
        low, high = measured.instructions
        steps = f"{low:,}" if low == high else f"{low:,} to {high:,}"
        difference = f"{measured.largest_difference:.2g}"
        lines.append(
            f"| {network} | {name} | {measured.flash:,} | {measured.ram} | {measured.stack:,} | {steps} | {difference} | {note} |"
        )
    lines += [
        "",
        "| network | links | the paper's formula, links · 1.5 bit | bitneat's packed form, all in |",
        "|---|---|---|---|",
    ]
    for network, controller in networks().items():
        links = controller.num_links
        lines.append(f"| {network} | {links} | {ceil(links * 1.5 / 8)} bytes | {len(pack(controller))} bytes |")
    return START + "\n".join(lines) + "\n" + END


def replaced(page: str, new: str) -> str:
    """The page with its section replaced.

    Raises:
        ValueError: if the page has no section.
    """
    before, rest = page.split(START)
    _, after = rest.split(END)
    return before + new + after


def write(path: Path, announce: Callable[[str], None]) -> None:
    """Measure, and write the section into the page."""
    page = path.read_text(encoding="utf-8")
    replaced(page, "")  # before minutes of work
    from bitneat.files import write_atomic

    write_atomic(path, replaced(page, section(announce)).encode())
