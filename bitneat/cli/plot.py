# SPDX-License-Identifier: MIT
"""``bitneat plot``: draw a figure."""

from __future__ import annotations

import argparse
from pathlib import Path

from bitneat.cli.arguments import whole_number

HELP = "draw the activations against neat-python's (needs bitneat[plot])"
DESCRIPTION = """\
Draws a figure into one file. The bytes depend on the arguments and on the
version of Matplotlib."""
EXAMPLE = """\
  bitneat plot activations -o activations.svg
  bitneat plot activations -o activations.png --frac-bits 6"""
FILES = """\
  FILE             written: .svg or .png"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``plot``."""
    parser.add_argument("figure", choices=("activations",), help="what to draw")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="an .svg or .png file")
    parser.add_argument(
        "--frac-bits", metavar="F", type=whole_number(4, 12), default=8, help="fractional bits of a signal (default 8)"
    )


def run(args: argparse.Namespace) -> int:
    """Draw the figure and write it."""
    from bitneat.files import write_atomic
    from bitneat.report.activations import activations_figure
    from bitneat.report.figure import file_format

    file_type = file_format(args.output)
    write_atomic(args.output, activations_figure(args.frac_bits, file_type))
    print(f"wrote {args.output}")
    return 0
