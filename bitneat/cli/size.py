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

HELP = "say what a champion takes: links, packed bytes, flash, RAM and stack"
EXAMPLE = """\
  bitneat size champion.pkl
  bitneat size champion.pkl --targets cortex-m0 --json size.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``size``."""
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="champion.pkl or champion.json"
    )
    add_targets(parser)
    add_json(parser)


def add_targets(parser: argparse.ArgumentParser) -> None:
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
    report = measure_sizes(champion, select(target_names(args.targets), run=False))
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
    smallest = report.smallest
    rows = []
    for entry in report.compiled:
        examination, device = entry.report.examination, device_of(entry)
        mark = "smallest" if smallest[device] == entry.report.style else ""
        rows.append(
            (
                device,
                entry.report.style,
                examination.flash,
                examination.ram,
                examination.stack,
                entry.table_bytes,
                entry.report.compiler,
                mark,
            )
        )
    compiled = columns(("target", "style", "flash", "RAM", "stack", "table", "compiler", ""), rows)
    return "\n".join(
        (
            f"controller {controller['sha256'][:12]}: {controller['nodes']} nodes, {controller['links']} links, {kind}",
            f"packed: {controller['packed_bytes']} bytes, all included",
            packed,
            f"the paper's formula (1.5 bits a link, the topology left out): {controller['paper_bytes']} bytes",
            "compiled, in bytes:",
            compiled,
        )
    )
