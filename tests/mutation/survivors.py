# SPDX-License-Identifier: MIT
"""The mutants that no test can tell from the original, each with the argument why: ``survivors.toml``."""

from __future__ import annotations

import tomllib
from pathlib import Path

TABLE = Path(__file__).with_name("survivors.toml")


def arguments_of(kind: str) -> dict[tuple[str, ...], str]:
    """For each equivalent mutant of ``python`` or ``c``, by its key, why it is one.

    A row of the table may stand for several mutants: ``after`` is then a list.
    """
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))[kind]
    found: dict[tuple[str, ...], str] = {}
    for row in rows:
        afters = row["after"] if isinstance(row["after"], list) else [row["after"]]
        for after in afters:
            place = (row["path"], row["function"]) if kind == "python" else (row["path"],)
            found[*place, row["before"], after] = row["why"]
    return found
