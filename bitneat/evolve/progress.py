# SPDX-License-Identifier: MIT
"""What a run says while it goes on, and the figures behind it: speed, the time that is left, whether it is solved."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TextIO

from bitneat.controller.packing import pack
from bitneat.network import FloatNetwork
from bitneat.sim.environment import reward_threshold

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
        """Nothing more will come; called once or more."""


@dataclass(frozen=True)
class Reading:
    """A generation with what follows from it and the clock."""

    row: Generation
    packed_bytes: int | None
    """Of the best candidate; None of a float network, which has no packed form."""
    seconds: float
    """That the generation took."""
    left: float
    """Seconds to the end of the run, if it goes on at its mean pace so far."""
    solved: float | None
    """The environment's threshold, if the selection score has reached it."""

    @property
    def steps_per_second(self) -> float:
        """Simulated steps in a second of the generation's time."""
        return self.row.steps / max(self.seconds, 1e-9)


class Readings:
    """Makes a `Reading` of each generation of a run."""

    def __init__(self) -> None:
        self.generations = 0
        self.completed = 0
        self.linear_generations = 0
        self.threshold: float | None = None
        self.began = 0.0
        """When, by the monotonic clock."""
        self._first = 0
        self._seconds: float | None = None
        self._most_steps = self._first_steps = self._steps = 0
        self._last = 0.0
        self._measured: tuple[Candidate, int | None] | None = None

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """The run begins or continues."""
        settings = search.config["evolve"]
        self.generations, self._seconds = generations, seconds
        self.completed = self._first = search.generation
        self.linear_generations = settings["linear_generations"]
        self.threshold = reward_threshold(search.spec)
        self._most_steps = settings["max_total_steps"]
        self._first_steps = self._steps = search.total_steps
        self.began = self._last = time.monotonic()

    def read(self, row: Generation, best: Candidate | None) -> Reading:
        """A generation is complete."""
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        self.completed = row.generation + 1
        done = self.completed - self._first
        left = (now - self.began) / done * (self.generations - self.completed)
        self._steps += row.steps
        if self._most_steps:
            pace = (now - self.began) / max(self._steps - self._first_steps, 1)
            left = min(left, max(self._most_steps - self._steps, 0) * pace)
        if self._seconds is not None:
            left = min(left, max(self._seconds - (now - self.began), 0.0))
        solved = self.threshold if self.threshold is not None and row.selection >= self.threshold else None
        return Reading(row, self._packed_bytes(best), elapsed, left, solved)

    @property
    def in_linear_start(self) -> bool:
        """True while the generation that runs belongs to the linear start."""
        return self.completed < self.linear_generations

    @property
    def is_linear_alone(self) -> bool:
        """True if the run ends before NEAT could begin."""
        return 0 < self.generations <= self.linear_generations

    def _packed_bytes(self, best: Candidate | None) -> int | None:
        if best is None:
            return None
        if self._measured is None or self._measured[0] is not best:
            policy = best.controller
            self._measured = best, None if isinstance(policy, FloatNetwork) else len(pack(policy))
        return self._measured[1]


class PlainProgress:
    """A line a generation, and one for each thing that happens once."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._readings = Readings()
        self._told_solved = False

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Say what runs."""
        self._readings.start(search, generations, seconds)
        self._print(
            f"{search.spec.id}: generation {search.generation} of {generations},"
            f" population {search.config['NEAT']['pop_size']}, seed {search.seed}"
        )

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Print the row."""
        was_linear = self._readings.in_linear_start
        reading = self._readings.read(row, best)
        columns = {
            "generation": str(row.generation),
            "best": f"{row.best:.1f}",
            "mean": f"{row.mean:.1f}",
            "selection": f"{row.selection:.1f}",
            "species": str(row.species),
            "links": str(row.best_links),
            "bytes": "-" if reading.packed_bytes is None else str(reading.packed_bytes),
            "steps/s": f"{reading.steps_per_second:.0f}",
            "left": duration(reading.left),
        }
        self._print(" ".join(f"{name} {value}" for name, value in columns.items()))
        if was_linear and not self._readings.in_linear_start and not self._readings.is_linear_alone:
            self._print("the linear start is over; NEAT goes on from its policy")
        if reading.solved is not None and not self._told_solved:
            self._told_solved = True
            self._print(solved_text(row.selection, reading.solved))

    def choosing(self) -> None:
        """Say so."""
        self._print(CHOOSING)

    def close(self) -> None:
        """Nothing to do."""

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


class Together:
    """Several that are told the same, in their order."""

    def __init__(self, parts: Sequence[Progress]) -> None:
        self._parts = parts

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Tell all."""
        for part in self._parts:
            part.start(search, generations, seconds)

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Tell all."""
        for part in self._parts:
            part.generation(row, best)

    def choosing(self) -> None:
        """Tell all."""
        for part in self._parts:
            part.choosing()

    def close(self) -> None:
        """Tell all, whatever comes in between."""
        with ExitStack() as stack:
            for part in reversed(self._parts):
                stack.callback(part.close)


CHOOSING = "choosing the champion on the selection seeds, scoring it on the report seeds"


def solved_text(score: float, threshold: float) -> str:
    """What is said of a selection score that reaches the environment's threshold."""
    return f"solved on the selection seeds: {score:.1f}, and {threshold:g} is asked for"


def duration(seconds: float) -> str:
    """Hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def progress_for(stream: TextIO | None = None, *, plain: bool = False) -> Progress:
    """The live view on a terminal that can move its cursor; plain lines elsewhere, or if they are asked for."""
    stream = sys.stderr if stream is None else stream
    if plain or not stream.isatty():
        return PlainProgress(stream)
    from rich.console import Console

    from bitneat.evolve.live import LiveProgress

    console = Console(file=stream)
    return PlainProgress(stream) if console.is_dumb_terminal else LiveProgress(console)
