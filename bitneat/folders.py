# SPDX-License-Identifier: MIT
"""Folders that commands keep their runs in: whose one is, and what a new run must not find there.

A new run writes files by fixed names. What is there by one of these names already is somebody's: the user's own, another command's,
or what is left of a run whose own record is gone, which the new run would even go on from.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bitneat.errors import BitneatError
from bitneat.files import make_folder, refuse_links, sole_user

_CHAMPION = ("champion.pkl", "champion.json")


@dataclass(frozen=True)
class Kind:
    """What a command keeps in a folder."""

    command: str
    states: tuple[str, ...]
    """Names of the files that make a folder the command's."""
    written: tuple[str, ...]
    """Patterns of all else that it overwrites, takes away or goes on from."""
    resumed_by: str = "the same command"
    """How the user goes on with a run."""

    def is_in(self, folder: Path) -> bool:
        """Whether a folder holds a run of this kind."""
        return any(os.path.exists(folder / name) for name in self.states)  # noqa: PTH110 - False where it may not look


EVOLVE = Kind(
    "evolve",
    ("run.json",),
    ("config.ini", "history.csv", "report.json", *_CHAMPION, "checkpoints/generation-*.json"),
    "--resume {folder}",
)
POLISH = Kind(
    "polish",
    ("polish.json", "polish-previous.json"),
    ("history.csv", "front.csv", *_CHAMPION, "front/*.pkl"),
    "--resume {folder}",
)
LINEAR = Kind("linear", ("linear.json", "linear-previous.json"), _CHAMPION, "--resume {folder}")
DISTILL = Kind("distill", ("distill.json",), ("imitation.pt", "reinforcement.pt", *_CHAMPION))
BASELINE = Kind(
    "baseline",
    ("baseline.json",),
    ("checkpoint.pt", "policy.npz", "result.json", "history.csv", "model.zip", "vecnormalize.pkl", "champion.pkl"),
)
REPRODUCE = Kind(
    "reproduce",
    ("budget.json",),
    (
        "README.md", "claims.csv", "table1.csv", "quantization.csv", "grid.csv", "temperatures.csv", "scenarios.csv",
        "hardcore.csv", "figure[234]-*.svg", "figure[234]-*.png", "fitness-by-steps.*",
    ),
)  # fmt: skip
KINDS = (EVOLVE, POLISH, LINEAR, DISTILL, BASELINE, REPRODUCE)


def refuse_begun(folder: Path, kind: Kind) -> None:
    """Refuse a folder that holds a run, of this command or of another.

    Raises:
        BitneatError: naming the file that says so.
    """
    for other in KINDS:
        for name in other.states:
            if not (folder / name).exists():
                continue
            if other is kind:
                how = kind.resumed_by.format(folder=folder)
                raise BitneatError(f"{folder}: holds a run already; continue it with {how}, or give another -o")
            raise BitneatError(f"{folder}: holds a run already: {name} is of bitneat {other.command}; give another -o")


def refuse_taken(folder: Path, kind: Kind) -> None:
    """Refuse a folder for a new run if it holds a run, or any file that the new one would write or go on from.

    Raises:
        BitneatError: naming the file.
    """
    refuse_begun(folder, kind)
    for pattern in kind.written:
        for path in sorted(folder.glob(pattern)):
            raise BitneatError(f"{path}: exists and would be overwritten; move it elsewhere, or give another -o")


@contextlib.contextmanager
def begun(folder: Path, kind: Kind) -> Iterator[bool]:
    """Be the only process in a folder in which a new run begins; it is made if it is missing. Gives whether it was.

    What is there is looked at when nobody else can write there any more: of two that begin at once, one is refused.

    Raises:
        BitneatError: as of `refuse_taken`; or if the folder cannot be made, holds a link, or another process is at work there.
    """
    refuse_taken(folder, kind)  # before a folder is made in vain, and to tell of a run rather than of its process
    made = make_folder(folder)
    with sole_user(folder):
        refuse_links(folder)
        refuse_taken(folder, kind)
        yield made
