# SPDX-License-Identifier: MIT
"""What every fuzzer is to the driver: batches that are numbered, so that each can be run again, and a finding that says how."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "fuzz"
"""Where fuzzers keep what they have found interesting, and note how far they are."""

MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
"""Where files go that are written and read a million times; None for the usual place of temporary files."""


@cache
def workshop() -> Path:
    """A folder for what this process compiles; gone when it ends."""
    WORK.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix="compiled-", dir=WORK))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


class FindingError(Exception):
    """Something is wrong in what is tested; the message says what, and what replays it."""


@dataclass(frozen=True)
class Batch:
    """What a batch did: how many cases in the target's unit, and other things worth counting."""

    count: int
    also: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Target:
    """A fuzzer.

    Attributes:
        what: what is done with each case, for the table.
        unit: what ``count`` counts.
        under: the sanitizers or other limits under which it runs.
        tools: says what it was compiled or run by.
        run: runs batch number N; the same N does the same, unless ``explores``.
        explores: whether batches build on what earlier ones found.
    """

    what: str
    unit: str
    under: str
    tools: Callable[[], str]
    run: Callable[[int], Batch]
    explores: bool = False
