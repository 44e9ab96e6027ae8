# SPDX-License-Identifier: MIT
"""A run's figures as event files for TensorBoard. Nothing that the run does or writes elsewhere depends on them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.errors import MissingExtraError
from bitneat.evolve.progress import Reading, Readings

if TYPE_CHECKING:
    from bitneat.evolve.search import Candidate, Generation, Search


class TensorBoardProgress:
    """A scalar of each figure for each generation, its number as the step.

    Args:
        folder: where the event files go; a run that is resumed adds one.

    Raises:
        MissingExtraError: if tensorboardX is not installed.
    """

    def __init__(self, folder: Path) -> None:
        try:
            from tensorboardX import SummaryWriter
        except ImportError:
            raise MissingExtraError(
                "--tensorboard: tensorboardX is not installed; pip install bitneat[tensorboard]"
            ) from None
        self._make_writer = SummaryWriter
        self._folder = folder
        self._writer: Any = None
        self._readings = Readings()

    def start(self, search: Search, generations: int, seconds: float | None) -> None:
        """Open a file. Readers drop what an earlier one has from its first step on, so that no generation is there twice."""
        self._readings.start(search, generations, seconds)
        # A run that was killed may have saved its last generation without a word about it here, so that one comes again.
        first = max(search.generation - 1, 0)
        self._writer = self._make_writer(str(self._folder), purge_step=first, filename_suffix=f".{first:06d}")
        if search.history:
            self._write(search.history[-1], search.candidates[0], None)

    def generation(self, row: Generation, best: Candidate | None) -> None:
        """Write a generation, and leave nothing of it in memory."""
        self._write(row, best, self._readings.read(row, best))

    def choosing(self) -> None:
        """Nothing to write."""

    def close(self) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _write(self, row: Generation, best: Candidate | None, reading: Reading | None) -> None:
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
        for name, value in values.items():
            self._writer.add_scalar(name, value, row.generation)
        self._writer.flush()
