# SPDX-License-Identifier: MIT
"""A run's figures as event files for TensorBoard. Nothing that the run does or writes elsewhere depends on them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.errors import MissingExtraError
from bitneat.evolve.progress import Reading, Readings

if TYPE_CHECKING:
    from bitneat.evolve.search import Candidate, Generation, Search


class TensorBoardProgress:
    """A scalar of each figure for each generation, its number as the step.

    A generation is one record, on disk before the next begins: a run that is killed at any moment lacks the record of its last
    checkpoint at most. So the writer is the one below tensorboardX's `SummaryWriter`, whose thread has a queue that nothing
    drains, and whose callers wait for ever if it dies.

    Args:
        folder: where the event files go; a run that is resumed adds one.
        warn: told, once, if no more can be written; the run goes on without.

    Raises:
        MissingExtraError: if tensorboardX is not installed.
    """

    def __init__(self, folder: Path, warn: Callable[[str], None] = lambda text: None) -> None:
        try:
            from tensorboardX import event_file_writer
            from tensorboardX.proto import event_pb2, summary_pb2
        except ImportError:
            raise MissingExtraError(
                "--tensorboard: tensorboardX is not installed; pip install 'bitneat[tensorboard]'"
            ) from None
        self._make_writer, self._events, self._summaries = event_file_writer.EventsWriter, event_pb2, summary_pb2
        self._folder = folder
        self._warn = warn
        self._writer: Any = None
        self._readings = Readings()

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Open a file. Readers drop what an earlier one has from its first step on, so that no generation is there twice.

        Raises:
            OSError: if it cannot be made.
        """
        self._readings.start(search, generations, seconds)
        # A run that was killed may have saved its last generation without a word about it here, so that one comes again.
        first = max(search.generation - 1, 0)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._writer = self._make_writer(str(self._folder / "events"), f".{first:06d}")
        session = self._events.SessionLog(status=self._events.SessionLog.START)
        self._put(self._events.Event(wall_time=time.time(), step=first, session_log=session))
        if search.history:
            self._write(search.history[-1], search.candidates[0], None)

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Write a generation, and leave nothing of it in memory."""
        self._write(row, best, self._readings.read(row, best))

    def choosing(self) -> None:
        """Nothing to write."""

    def close(self) -> None:
        """Close the file."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with contextlib.suppress(OSError):  # all of it is on disk already
                writer.close()

    def _write(self, row: Generation, best: Candidate | None, reading: Reading | None) -> None:
        if self._writer is not None:
            values = [
                self._summaries.Summary.Value(tag=name, simple_value=value)
                for name, value in _scalars(row, best, reading).items()
            ]
            summary = self._summaries.Summary(value=values)
            self._put(self._events.Event(wall_time=time.time(), step=row.generation, summary=summary))

    def _put(self, event: Any) -> None:
        try:
            self._writer.write_event(event)
            self._writer.flush()
        except OSError as error:
            self._warn(
                f"--tensorboard: {self._folder}: cannot write: {error.strerror or error}; the run goes on without"
            )
            self.close()


def _scalars(row: Generation, best: Candidate | None, reading: Reading | None) -> Mapping[str, float]:
    values: dict[str, float] = {
        "reward/best": row.best,
        "reward/mean": row.mean,
        "reward/selection": row.selection,
        "population/species": row.species,
        "population/duplicates": row.duplicates,
        "population/mean_links": row.mean_links,
        "leader/nodes": row.best_nodes,
        "leader/links": row.best_links,
        "race/episodes": row.episodes,
        "race/steps": row.steps,
    }
    if best is not None:
        values["best_candidate/links"] = best.controller.num_links
    if reading is not None:
        values["race/steps_per_second"] = reading.steps_per_second
        if reading.packed_bytes is not None:
            values["best_candidate/packed_bytes"] = reading.packed_bytes
    return values
