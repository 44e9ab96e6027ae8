# SPDX-License-Identifier: MIT
"""What is run in the place of a command that a page shows: ``commands.toml``, and what its rows mean."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.shown.blocks import Command

TABLE = Path(__file__).with_name("commands.toml")


@dataclass(frozen=True)
class Row:
    """A row: for a command as it is shown on some pages, or on any (``*``).

    Args:
        run: what is run in its place; empty if nothing is. None: the command itself, whose exit status or tolerance is another.
        why: for people.
        status: the exit status that is expected.
        tolerance: by what part of itself a number that it prints may differ from what the page shows.
        long: whether it is run by ``make test-long`` only.
    """

    pages: tuple[str, ...]
    shown: str
    why: str
    run: str | None = None
    status: int = 0
    tolerance: float = 0.0
    long: bool = False

    def serves(self, command: Command) -> bool:
        """Whether it is for this command."""
        return command.text == self.shown and (self.pages == ("*",) or command.page in self.pages)


@dataclass(frozen=True)
class Table:
    """All of it.

    Args:
        rows: for single commands.
        inputs: for a page, the files that lie in its folder before its first command: each with a kind of `tests.shown.inputs`.
        repeating: pages of which a command that another page shows, too, is run there alone.
        elsewhere: pages that another test runs, each with that test.
        needs: for a page, the programs and files (by their absolute paths) that its commands need beyond Python's packages.
    """

    rows: tuple[Row, ...]
    inputs: Mapping[str, Mapping[str, str]]
    repeating: frozenset[str]
    elsewhere: Mapping[str, str]
    needs: Mapping[str, Sequence[str]]

    def row(self, command: Command) -> Row | None:
        """The row of a command; None if it is run as it is."""
        return next((row for row in self.rows if row.serves(command)), None)


def read(path: Path = TABLE) -> Table:
    """Read the table; a key that nobody knows is an error."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    rows = tuple(_row(dict(entry)) for entry in data.pop("command"))
    inputs, elsewhere = data.pop("inputs"), data.pop("elsewhere")
    repeating, needs = frozenset(data.pop("repeating")), data.pop("needs")
    assert not data, f"{path.name}: unknown keys {sorted(data)}"
    return Table(rows, inputs, repeating, elsewhere, needs)


def _row(entry: dict[str, Any]) -> Row:
    pages = tuple(entry.pop("pages"))
    row = Row(pages, **entry)
    assert row.why.strip(), f"{row.shown}: a row says why"
    return row


def stale(table: Table, shown: Iterable[Command]) -> list[str]:
    """The rows, and the pages of rows, that no command on a page needs."""
    commands = list(shown)
    found = []
    for row in table.rows:
        for page in row.pages:
            if not any(command.text == row.shown and page in ("*", command.page) for command in commands):
                found.append(f"{page}: {row.shown}")
    pages = {command.page for command in commands}
    return found + [
        page for page in (*table.inputs, *table.repeating, *table.elsewhere, *table.needs) if page not in pages
    ]
