# SPDX-License-Identifier: MIT
"""Plain text: small tables, and what comes from files made fit to print."""

from __future__ import annotations

from collections.abc import Sequence


def columns(head: Sequence[str], rows: Sequence[Sequence[object]], *, indent: str = "  ") -> str:
    """A table with aligned columns, numbers to the right; None is printed as ``-``."""
    texts = [list(head), *(["-" if cell is None else str(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in texts) for i in range(len(head))]
    right = [all(isinstance(row[i], int | None) for row in rows) for i in range(len(head))]
    lines = [
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(row, widths, right, strict=True)
        )
        for row in texts
    ]
    return "\n".join(indent + line.rstrip() for line in lines)
