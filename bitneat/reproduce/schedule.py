# SPDX-License-Identifier: MIT
"""Many jobs side by side, each in a process of its own with one thread, in an order that their needs allow."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from bitneat.errors import BitneatError
from bitneat.files import make_folder, refuse_links, remove_leftovers
from bitneat.orphans import children_ignore_interrupts, end_with_parent
from bitneat.reproduce.experiments import Job
from bitneat.reproduce.results import Result, load_all

_POLL_SECONDS = 1.0


@dataclass(frozen=True)
class State:
    """How far the whole is: for whoever shows it."""

    done: int
    total: int
    running: tuple[tuple[str, int], ...]
    """Names of running jobs, and the generations each has completed."""
    finished: Result | None = None
    """The result that has just come in."""
    skipped: tuple[str, str] | None = None
    """A job that cannot run here, and why."""


@dataclass
class _Running:
    job: Job
    process: SpawnProcess
    connection: Connection


def run_all(
    jobs: Sequence[Job],
    folder: Path,
    workers: int,
    command: Callable[[Job], str],
    tell: Callable[[State], None],
) -> dict[str, Result]:
    """Run what has no result yet in ``folder``, and return all results by name.

    A job that needs what is not installed is told of and skipped, with those that need it; whatever else goes wrong ends it all.
    What is unfinished then, or when the process is killed, goes on from its last generation the next time.

    Raises:
        BitneatError: if a job fails, or a result in ``folder`` is that of another experiment.
    """
    make_folder(folder / "results")
    refuse_links(folder / "results")
    for place in (folder, folder / "results"):
        remove_leftovers(place)
    results = load_all(folder / "results")
    _refuse_others(jobs, folder, results)
    waiting = [job for job in jobs if job.name not in results]
    total = len(jobs)
    running: list[_Running] = []
    skipped: set[str] = set()
    try:
        while waiting or running:
            for job in [job for job in waiting if skipped & set(job.after)]:
                skipped.add(job.name)
                waiting.remove(job)
            ready = [job for job in waiting if set(job.after) <= set(results)]
            for job in ready[: workers - len(running)]:
                waiting.remove(job)
                running.append(_start(job, folder, results, command(job)))
            if not running:
                break  # what is waiting needs what was skipped
            wait([entry.connection for entry in running], _POLL_SECONDS)
            for entry in [entry for entry in running if _over(entry)]:
                running.remove(entry)
                kind, content = _outcome(entry)
                if kind == "result":
                    results[entry.job.name] = content
                    tell(_state(results, jobs, total, running, folder, finished=content))
                elif kind == "missing":
                    skipped.add(entry.job.name)
                    tell(_state(results, jobs, total, running, folder, skipped=(entry.job.name, content)))
                else:
                    raise BitneatError(f"{entry.job.name}: {content}")
            tell(_state(results, jobs, total, running, folder))
        _refuse_others(jobs, folder, results)  # again, now that what they depend on is there
    finally:
        for entry in running:
            entry.process.terminate()
        for entry in running:
            entry.process.join()
    return results


def _refuse_others(jobs: Sequence[Job], folder: Path, results: dict[str, Result]) -> None:
    """A result counts by what was run, not by its name: settings may have changed since."""
    from bitneat.reproduce.running import mismatch

    for job in jobs:
        reason = mismatch(results[job.name], job, results) if job.name in results else None
        if reason is not None:
            path = folder / "results" / f"{job.name}.json"
            raise BitneatError(f"{path}: {reason}; remove it, and it runs again")


def _start(job: Job, folder: Path, results: dict[str, Result], command: str) -> _Running:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    needed = {name: results[name] for name in job.after}
    process = context.Process(target=_work, args=(theirs, job, folder, needed, command), daemon=True)
    with children_ignore_interrupts():
        process.start()
    theirs.close()
    return _Running(job, process, ours)


def _work(connection: Connection, job: Job, folder: Path, results: dict[str, Result], command: str) -> None:
    """What a process does. The result is on disk before anybody is told."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as the parent sees to, unless it started us in a thread
    end_with_parent()
    from bitneat.errors import MissingExtraError
    from bitneat.reproduce.running import run

    try:
        result = run(job, folder / "runs" / job.name, results, command)
        result.save(folder / "results" / f"{job.name}.json")
        connection.send(("result", result))
    except MissingExtraError as error:
        connection.send(("missing", str(error)))
    except (BitneatError, OSError) as error:
        connection.send(("error", str(error)))


def _over(entry: _Running) -> bool:
    return entry.connection.poll() or not entry.process.is_alive()


def _outcome(entry: _Running) -> tuple[str, Any]:
    with contextlib.suppress(EOFError):
        kind, content = entry.connection.recv()
        entry.process.join()
        return kind, content
    entry.process.join()
    return (
        "error",
        f"its process died (exit status {entry.process.exitcode}); the same command goes on from its last generation",
    )


def _state(
    results: dict[str, Result],
    jobs: Sequence[Job],
    total: int,
    running: Sequence[_Running],
    folder: Path,
    **more: Any,
) -> State:
    done = sum(job.name in results for job in jobs)
    return State(done, total, tuple((e.job.name, _generations(folder / "runs" / e.job.name)) for e in running), **more)


def _generations(run: Path) -> int:
    """Completed so far, by the rows of its history."""
    try:
        return max((run / "history.csv").read_bytes().count(b"\n") - 1, 0)
    except OSError:
        return 0


def elapsed(since: float) -> str:
    """Hours, minutes and seconds since a reading of the monotonic clock."""
    seconds = round(time.monotonic() - since)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
