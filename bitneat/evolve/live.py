# SPDX-License-Identifier: MIT
"""The live view of a run: a dozen lines, redrawn in place, that stay as a summary when it ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.constrain import Constrain
from rich.live import Live
from rich.padding import Padding
from rich.progress_bar import ProgressBar
from rich.text import Text

from bitneat.evolve.progress import CHOOSING, Reading, Readings, duration, solved_text

if TYPE_CHECKING:
    from bitneat.evolve.search import Candidate, Generation, Search

WIDTH = 80
"""Columns that the view takes at most: it looks the same on any terminal that has them."""
_ECHO = 2
"""Columns left free on the right, for the ^C that a terminal writes at the cursor: were it to wrap, all would move by a line."""
_REDRAWS = 2
"""In a second: the clock moves smoothly, and little is sent over a slow line."""
_LABEL = 11
_NUMBER = 8
_BLOCKS = "▁▂▃▄▅▆▇█"
_ASCII_BLOCKS = "_.-=+*%#"


class LiveProgress:
    """Title, phase, the best walk, curves of the best and the mean, species, speed, time, a bar."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._readings = Readings()
        self._title = self._state = ""
        self._curves: list[tuple[float, float]] = []
        """Best and mean of each generation in one, since the thread that draws may look at any moment."""
        self._reading: Reading | None = None
        self._candidate: Candidate | None = None
        self._closed_at: float | None = None
        self._read_at = 0.0
        self._live = Live(
            console=console, get_renderable=self._view, refresh_per_second=_REDRAWS, vertical_overflow="crop"
        )

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Begin to draw."""
        self._readings.start(search, generations, seconds)
        self._title = f"{search.spec.id}, population {search.config['NEAT']['pop_size']}, seed {search.seed}"
        self._curves = [(row.best, row.mean) for row in search.history]
        self._candidate = search.candidates[0] if search.candidates else None
        self._read_at = time.monotonic()
        self._live.start(refresh=True)

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Take the row in; the next redraw shows it."""
        self._reading = self._readings.read(row, best)
        self._candidate = best
        self._read_at = time.monotonic()
        self._curves.append((row.best, row.mean))

    def choosing(self) -> None:
        """Say so."""
        self._state = CHOOSING

    def close(self) -> None:
        """Leave the last picture standing."""
        if self._closed_at is None:
            self._closed_at = time.monotonic()
            self._state = ""
            self._live.stop()

    def _view(self) -> RenderableType:
        width = max(min(self._console.width, WIDTH) - _ECHO, 1)
        readings, reading = self._readings, self._reading
        parts: list[RenderableType] = [_line((self._title, "bold"))]
        parts += [_line((f"{label:{_LABEL}} ", "dim"), (value, "")) for label, value in self._lines(width - _LABEL - 1)]
        bar = ProgressBar(total=max(readings.generations, 1), completed=readings.completed, width=width)
        parts.append(Padding(bar, 0))  # which ends its line; the bar does not
        if reading is not None and reading.solved is not None:
            parts.append(_line((solved_text(reading.row.selection, reading.solved), "bold green")))
        if self._state:
            parts.append(_line((self._state, "dim")))
        return Constrain(Group(*parts), width)

    def _lines(self, width: int) -> list[tuple[str, str]]:
        readings, reading = self._readings, self._reading
        lines = [("generation", f"{readings.completed} of {readings.generations}")]
        if readings.linear_generations:
            lines.append(("phase", self._phase()))
        if self._candidate is not None:
            lines.append(("best walk", _candidate_text(self._candidate, reading)))
        if curves := self._curves[:]:
            best, mean = [pair[0] for pair in curves], [pair[1] for pair in curves]
            low, high = min(mean + best), max(best + mean)
            blocks = _ASCII_BLOCKS if self._console.options.ascii_only else _BLOCKS
            room = max(width - _NUMBER - 1, 1)
            lines.append(
                (
                    "best",
                    f"{sparkline(best, room, low, high, pool=max, blocks=blocks)} {best[-1]:{_NUMBER}.1f}",
                )
            )
            lines.append(
                (
                    "mean",
                    f"{sparkline(mean, room, low, high, pool=_mean, blocks=blocks)} {mean[-1]:{_NUMBER}.1f}",
                )
            )
        if reading is not None:
            row = reading.row
            kinds = "1 species" if row.species == 1 else f"{row.species} species"
            lines.append(("last", f"{kinds}, {row.steps / max(row.episodes, 1):.0f} steps an episode"))
            lines.append(("speed", f"{reading.steps_per_second:,.0f} steps/s, {reading.seconds:.1f} s a generation"))
        lines.append(("time", self._time()))
        return lines

    def _phase(self) -> str:
        count = self._readings.linear_generations
        if self._readings.is_linear_alone:
            return f"linear start, which takes {count} generations, and no NEAT after it"
        if self._readings.in_linear_start:
            return f"linear start, generation {self._readings.completed + 1} of {count}, then NEAT"
        return f"NEAT, after {count} generations of linear start"

    def _time(self) -> str:
        if self._closed_at is not None:
            return f"{duration(self._closed_at - self._readings.began)} in all"
        now = time.monotonic()
        text = duration(now - self._readings.began)
        if self._reading is None or self._state:
            return text
        return f"{text}, about {duration(max(self._reading.left - (now - self._read_at), 0.0))} left"


def _line(*parts: tuple[str, str]) -> Text:
    """Text in styles, cut where the terminal ends."""
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis", end="\n")


def sparkline(
    values: Sequence[float],
    width: int,
    low: float,
    high: float,
    *,
    pool: Callable[[Sequence[float]], float] = max,
    blocks: str = _BLOCKS,
) -> str:
    """The values as blocks of ``width`` columns in all, the lowest block for ``low`` and the highest for ``high``.

    More values than columns are pooled, as many for each column as possible; fewer are stretched.
    """
    bars = []
    for column in range(width):
        first = column * len(values) // width
        last = max((column + 1) * len(values) // width, first + 1)
        value = pool(values[first:last])
        share = (value - low) / (high - low) if high > low else 0.0
        bars.append(blocks[min(int(share * len(blocks)), len(blocks) - 1)])
    return "".join(bars)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _candidate_text(candidate: Candidate, reading: Reading | None) -> str:
    size = "" if reading is None or reading.packed_bytes is None else f", {reading.packed_bytes} bytes"
    seeds = len(candidate.rewards)
    return (
        f"{candidate.mean:.1f} over {seeds} selection seed{'' if seeds == 1 else 's'},"
        f" {candidate.controller.num_links} links{size}, generation {candidate.generation}"
    )
