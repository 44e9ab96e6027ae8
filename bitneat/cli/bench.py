# SPDX-License-Identifier: MIT
"""``bitneat bench``: measure bitneat against what it is compared with."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, whole_number

if TYPE_CHECKING:
    from bitneat.bench.measurement import Measurement

HELP = "measure speed against neat-python, Gymnasium and Python's own start"
DESCRIPTION = """\
Measures the speed of the runtime, of evolve, of the native walker, of codegen
and of the command line's start, each beside what it is compared with, in turns
on this machine. A goal that is missed is said, and is no failure. All of it
takes some minutes on a machine that does nothing else."""
EXAMPLE = """\
  bitneat bench                    all of it, as the table of docs/benchmarks.md
  bitneat bench runtime --json runtime.json
  bitneat bench sim                the native walker against Gymnasium, and EnvPool where it is installed"""
FILES = """\
  nothing but what --json names; native builds go into the cache folder"""

SUBJECTS = ("runtime", "evolve", "sim", "codegen", "startup")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``bench``."""
    parser.add_argument("subject", nargs="?", choices=(*SUBJECTS, "all"), default="all", help="what to measure")
    parser.add_argument(
        "--repetitions",
        type=whole_number(1),
        default=9,
        metavar="N",
        help="turns of each side, whose median counts (default 9)",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Measure and print one table; a goal that is missed is said, but is no failure, as machines differ."""
    subjects = SUBJECTS if args.subject == "all" else (args.subject,)
    measurements: list[Measurement] = []
    comparison = None
    for subject in subjects:
        if subject == "sim":
            from bitneat.bench.simulator import compare

            comparison = compare(args.repetitions)
            measurements += comparison.measurements()
        else:
            measurements += _measure(subject)(args.repetitions)
    machine = describe_machine()
    packages = [f"{name} {version}" for name, version in machine["packages"].items()]
    print(", ".join([machine["processor"], machine["compiler"], f"Python {machine['python']}", *packages]))
    if comparison is not None:
        print(comparison.heading)
    print()
    print(table(measurements))
    if comparison is not None and comparison.notes:
        print()
        print("\n".join(comparison.notes))
    if args.json is not None:
        from bitneat.files import write_json

        data: dict[str, Any] = {
            "machine": machine,
            "repetitions": args.repetitions,
            "measurements": [line.to_data() for line in measurements],
        }
        if comparison is not None:
            data |= comparison.to_data()
        write_json(args.json, data)
    return 0


def table(measurements: Sequence[Measurement]) -> str:
    """Lay the measurements out as a Markdown table."""
    rows = [("what", "bitneat", "compared with", "its figure", "result", "goal", "met")]
    for line in measurements:
        met = "" if line.met is None else "yes" if line.met else "no"
        rows.append(
            (
                line.what,
                f"{_rounded(line.ours)} {line.unit}",
                line.compared_with,
                f"{_rounded(line.baseline)} {line.unit}",
                f"{_rounded(line.figure)} {line.figure_means}",
                line.goal,
                met,
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def describe_machine() -> dict[str, Any]:
    """Say what the figures depend on."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from bitneat.native import host_compiler

    packages = {name: version(name) for name in ("neat-python", "gymnasium", "numpy")}
    with suppress(PackageNotFoundError):
        packages["envpool"] = version("envpool")
    return {
        "processor": _processor(),
        "compiler": host_compiler().title,
        "python": platform.python_version(),
        "packages": packages,
    }


def _processor() -> str:
    import os
    import platform
    from pathlib import Path

    name = platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    return f"{name}, {os.cpu_count()} cores"


def _measure(subject: str) -> Callable[[int], list[Measurement]]:
    if subject == "runtime":
        from bitneat.bench import runtime

        return runtime.measure
    if subject == "evolve":
        from bitneat.bench import evolve

        return evolve.measure
    from bitneat.bench import startup

    return startup.measure_codegen if subject == "codegen" else startup.measure_help


def _rounded(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
