# SPDX-License-Identifier: MIT
"""Arguments that several sub-commands share, and the types that check a value while it is read."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add ``--json FILE``; write the result with `bitneat.files.write_json` if ``args.json`` is not None."""
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the result as JSON to FILE, too")


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return an argument type for the integers from ``least`` to ``most``."""
    expected = f"a whole number of {least} or more" if most is None else f"a whole number in {least}..{most}"

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or value < least or (most is not None and value > most):
            raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")
        return value

    return parse
