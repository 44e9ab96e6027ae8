# SPDX-License-Identifier: MIT
"""What a run shows while it goes on: a live line on a terminal, a plain line a generation elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Protocol, TextIO

from bitneat.controller.packing import pack
from bitneat.network import FloatNetwork, Policy

if TYPE_CHECKING:
    from bitneat.evolve.search import Candidate, Generation, Search


class Progress(Protocol):
    """What a run tells."""

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """The run begins or continues."""

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """A generation is complete and saved."""

    def choosing(self) -> None:
        """The champion is being chosen and scored."""

    def close(self) -> None:
        """Nothing more will come."""


class PlainProgress:
    """A line a generation."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._clock = _Clock()

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Say what runs."""
        self._clock.start(search, generations, seconds)
        self._print(
            f"{search.spec.id}: generation {search.generation} of {generations},"
            f" population {search.config['NEAT']['pop_size']}, seed {search.seed}"
        )

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Print the row."""
        self._print(" ".join(f"{name} {value}" for name, value in self._clock.columns(row, best).items()))

    def choosing(self) -> None:
        """Say so."""
        self._print("choosing the champion on the selection seeds, scoring it on the report seeds")

    def close(self) -> None:
        """Nothing to do."""

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


class RichProgress:
    """A table of the last generations and a bar, redrawn in place."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self._clock = _Clock()
        self._rows: list[dict[str, str]] = []
        self._title = ""
        self._live = Live(console=Console(stderr=True), refresh_per_second=4, transient=False)

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Begin to draw."""
        self._clock.start(search, generations, seconds)
        self._title = f"{search.spec.id}, population {search.config['NEAT']['pop_size']}, seed {search.seed}"
        self._live.start()
        self._draw("first generation")

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Add the row."""
        self._rows = [*self._rows[-11:], self._clock.columns(row, best)]
        self._draw("evolving")

    def choosing(self) -> None:
        """Say so."""
        self._draw("choosing the champion")

    def close(self) -> None:
        """Leave the last picture standing."""
        self._live.stop()

    def _draw(self, state: str) -> None:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        table = Table(title=self._title, box=None, pad_edge=False)
        for name in self._rows[-1] if self._rows else ():
            table.add_column(name, justify="right")
        for row in self._rows:
            table.add_row(*row.values())
        bar = ProgressBar(total=max(self._clock.generations, 1), completed=self._clock.completed)
        self._live.update(Group(table, bar, Text(state, style="dim")))


class _Clock:
    """Turns a row into the columns shown, speed and remaining time among them."""

    def __init__(self) -> None:
        self.generations = 0
        self.completed = 0
        self._first = 0
        self._seconds: float | None = None
        self._most_steps = self._first_steps = self._steps = 0
        self._began = self._last = 0.0

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        self.generations, self._seconds = generations, seconds
        self.completed = self._first = search.generation
        self._most_steps = search.config["evolve"]["max_total_steps"]
        self._first_steps = self._steps = search.total_steps
        self._began = self._last = time.monotonic()

    def columns(self, row: Generation, best: Candidate | None) -> dict[str, str]:
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        self.completed = row.generation + 1
        done = self.completed - self._first
        left = (now - self._began) / done * (self.generations - self.completed)
        self._steps += row.steps
        if self._most_steps:
            pace = (now - self._began) / max(self._steps - self._first_steps, 1)
            left = min(left, max(self._most_steps - self._steps, 0) * pace)
        if self._seconds is not None:
            left = min(left, max(self._seconds - (now - self._began), 0.0))
        return {
            "generation": str(row.generation),
            "best": f"{row.best:.1f}",
            "mean": f"{row.mean:.1f}",
            "selection": f"{row.selection:.1f}",
            "species": str(row.species),
            "links": str(row.best_links),
            "bytes": "-" if best is None else _size(best.controller),
            "steps/s": f"{row.steps / max(elapsed, 1e-9):.0f}",
            "left": _duration(left),
        }


def _size(policy: Policy) -> str:
    """Packed bytes; a float network has no packed form."""
    return "-" if isinstance(policy, FloatNetwork) else str(len(pack(policy)))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def progress_for(stream: TextIO | None = None) -> Progress:
    """Rich on a terminal, plain lines elsewhere."""
    stream = sys.stderr if stream is None else stream
    return RichProgress() if stream.isatty() else PlainProgress(stream)
