# SPDX-License-Identifier: MIT
"""``bitneat doctor``: what of bitneat works on this machine."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_json
from bitneat.cli.columns import columns
from bitneat.errors import printable

if TYPE_CHECKING:
    from bitneat.doctor import Finding

HELP = "say which compilers, emulators and extras are there, and test a controller"
DESCRIPTION = """\
Looks for what bitneat can use, says what each thing is for and how to get what
is missing, then compiles a small controller for this machine and for each
emulated chip, compares it bit for bit, and compares the native walker with
Gymnasium. Takes seconds; the first time it compiles the native parts."""
EXAMPLE = """\
  bitneat doctor
  bitneat doctor --json doctor.json
  bitneat doctor --no-trials                  only look what is there"""
STATUS = """\
  0    evolve, codegen and verify can work
  1    one of them cannot; lines marked ! say why"""
FILES = """\
  nothing but what --json names; native builds go into the cache folder"""

_STYLES = {"found": "green", "missing": "yellow", "failed": "red"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``doctor``."""
    parser.add_argument("--no-trials", action="store_true", help="build and run nothing")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Look, print, and say by the exit status whether the main commands can work."""
    from bitneat.doctor import findings

    found = []
    shown: list[Finding] = []
    for finding in findings(trials=not args.no_trials):
        if shown and shown[-1].section != finding.section:
            _show(shown)
            shown = []
        shown.append(finding)
        found.append(finding)
    _show(shown)
    blocking = [finding for finding in found if finding.blocks]
    print(verdict(blocking))
    if args.json is not None:
        from bitneat.files import write_json

        write_json(
            args.json,
            {"verdict": "fail" if blocking else "pass", "findings": [finding.to_data() for finding in found]},
        )
    return 1 if blocking else 0


def verdict(blocking: Sequence[Finding]) -> str:
    """The last line."""
    if not blocking:
        return "evolve, codegen and verify can work here"
    return f"not everything can work here: see {', '.join(finding.name for finding in blocking)}"


def _show(section: Sequence[Finding]) -> None:
    """Print a section: as a table on a terminal, else in plain columns."""
    if sys.stdout.isatty():
        _show_table(section)
        return
    rows = [(_mark(one), one.name, printable(_said(one))) for one in section]
    print(f"{section[0].section}:\n{columns(('', 'what', ''), rows).partition(chr(10))[2]}\n", flush=True)


def _show_table(section: Sequence[Finding]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=section[0].section, title_justify="left", show_header=False, expand=True)
    table.add_column(width=7)
    table.add_column(no_wrap=True)
    table.add_column(ratio=3)
    table.add_column(ratio=2)
    for one in section:
        said = "; ".join(part for part in (one.detail, one.remedy) if part)
        state = Text(one.state, style=_STYLES[one.state])
        # As Text, since square brackets are markup in plain strings.
        table.add_row(state, *(Text(printable(text)) for text in (one.name, said, one.enables)))
    Console().print(table)


def _mark(finding: Finding) -> str:
    if finding.blocks:
        return "!"
    return {"found": "+", "missing": "-", "failed": "x"}[finding.state]


def _said(finding: Finding) -> str:
    """What there is to say in one line."""
    if finding.state == "found":
        return "; ".join(part for part in (finding.detail, finding.enables and f"for {finding.enables}") if part)
    reason = "; ".join(part for part in (finding.state, finding.detail) if part)
    need = f"; needed for {finding.enables}" if finding.enables else ""
    return f"{reason}{need}: {finding.remedy}" if finding.remedy else f"{reason}{need}"
