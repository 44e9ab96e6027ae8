# SPDX-License-Identifier: MIT
"""``bitneat size``: what a champion takes, packed and compiled."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_json
from bitneat.cli.columns import columns

if TYPE_CHECKING:
    from bitneat.verify.size import SizeReport

HELP = "say what a champion takes: links, packed bytes, flash, RAM, stack and, with --targets, instructions a step"
DESCRIPTION = """\
Compiles both styles of a champion's C and reports bytes of flash, RAM and
stack, and what the packed form takes, part by part. No episode is run."""
EXAMPLE = """\
  bitneat size champion.pkl
  bitneat size champion.pkl --targets all
  bitneat size champion.pkl --targets cortex-m0 --json size.json"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``size``."""
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="champion.pkl or champion.json"
    )
    add_targets(parser)
    add_json(parser)


def add_targets(parser: argparse._ActionsContainer) -> None:
    """Add ``--targets``."""
    parser.add_argument(
        "--targets",
        metavar="T,...",
        help="where to compile it: all, or names with commas between (default: the host, and each chip whose tools are there)",
    )


def target_names(text: str | None) -> list[str] | None:
    """The names in ``--targets``."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    from bitneat.champion import load
    from bitneat.files import write_json
    from bitneat.verify.size import measure_sizes
    from bitneat.verify.targets import select

    champion = load(args.champion)
    names = target_names(args.targets)
    report = measure_sizes(champion, select(names, run=False), speed=names is not None)
    print(render(report))
    if args.json is not None:
        write_json(args.json, report.to_data())
    return 0


def render(report: SizeReport) -> str:
    """The report as text."""
    from bitneat.verify.check import controller_data
    from bitneat.verify.size import device_of

    controller = controller_data(report.controller)
    kind = "ternary" if controller["ternary"] else "power-of-two weights"
    packed = columns(
        ("packed as", "bytes", "header bits", "topology bits", "weight bits", "activation, gain, bias bits"),
        [
            (bits.encoding, bits.num_bytes, bits.header, bits.topology, bits.weights, bits.fields)
            for bits in report.packed
        ],
    )
    smallest, fastest = report.smallest, report.fastest
    rows = []
    for entry in report.compiled:
        examination, device, timing = entry.report.examination, device_of(entry), entry.report.timing
        winners = {"smallest": smallest, "fastest": fastest}
        marks = [mark for mark, best in winners.items() if best.get(device) == entry.report.style]
        rows.append(
            (
                device,
                entry.report.style,
                examination.flash,
                examination.ram,
                entry.report.stack,
                entry.table_bytes,
                None if timing is None else _span(timing.step.instructions),
                None if timing is None else timing.cycles,
                entry.report.compiler,
                ", ".join(marks),
            )
        )
    headings = ("target", "style", "flash", "RAM", "stack", "table", "instructions", "cycles", "compiler", "")
    compiled = columns(headings, rows)
    return "\n".join(
        (
            f"controller {controller['sha256'][:12]}: {controller['nodes']} nodes, {controller['links']} links, {kind}",
            f"packed: {controller['packed_bytes']} bytes, all included",
            packed,
            f"the paper's formula (1.5 bits a link, the topology left out): {controller['paper_bytes']} bytes",
            "compiled, in bytes, and what a step takes:",
            compiled,
        )
    )


def _span(ends: tuple[int, int]) -> int | str:
    return ends[0] if ends[0] == ends[1] else f"{ends[0]}-{ends[1]}"
