# SPDX-License-Identifier: MIT
"""``bitneat reproduce``: the experiments of the Bit-Pedal Walker paper, as tables, figures and verdicts."""

from __future__ import annotations

import argparse
import json
import sys
import time
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_json, add_workers
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.reproduce.experiments import Job
    from bitneat.reproduce.schedule import State

HELP = "run the Bit-Pedal Walker paper's experiments again: tables, figures, verdicts"
DESCRIPTION = """\
Runs the paper's experiments that have no result yet, then writes tables,
figures and verdicts from all results that there are. Stop it and call it again
as you like; --list says what is done."""
EXAMPLE = """\
  bitneat reproduce --budget smoke                    all of it in minutes, to see that it runs
  bitneat reproduce --budget paper -o docs/paper      the paper's budget; stop it and call it again as you like
  bitneat reproduce --budget paper -o docs/paper --only 'bit-gains-*'"""
FILES = """\
  DIR/             written: results/, runs/, tables, figures, README.md"""

BUDGET_NAMES = ("smoke", "hour", "paper")
_BUDGET = "budget.json"
_LOOK_SECONDS = 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``reproduce``."""
    parser.add_argument(
        "--budget",
        choices=BUDGET_NAMES,
        default="hour",
        help="smoke: minutes; hour: a tenth of the paper's, one run each; paper: the paper's, hours (default hour)",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="where all of it goes (default runs/reproduce-BUDGET)"
    )
    parser.add_argument(
        "--only",
        metavar="PATTERN",
        action="append",
        help="only jobs whose name matches, as in bit-*, and those they need",
    )
    parser.add_argument("--list", action="store_true", help="print the jobs, and which are done, and stop")
    add_workers(parser, "jobs at the same time")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run what has no result yet, then write tables, figures and the page."""
    from bitneat.reproduce.experiments import BUDGETS, jobs
    from bitneat.reproduce.publish import publish
    from bitneat.reproduce.results import load_all
    from bitneat.reproduce.schedule import run_all
    from bitneat.sim.walker.binding import default_threads

    budget = BUDGETS[args.budget]
    folder: Path = args.output or Path("runs") / f"reproduce-{budget.name}"
    chosen = _chosen(jobs(budget), args.only)
    if args.list:
        _is_claimed(folder, budget.name)  # or it is refused
        done = load_all(folder / "results")
        for job in chosen:
            print(f"{'done' if job.name in done else 'open':5} {job.name}")
        return 0
    _claim_folder(folder, budget.name)
    _require_simulator()
    watch = _Watch(len(chosen))

    def command(job: Job) -> str:
        return f"bitneat reproduce --budget {budget.name} --only {job.name}"

    try:
        run_all(chosen, folder, args.workers or default_threads(), command, watch.tell)
    except KeyboardInterrupt as stop:
        stop.args = ("stopped; the same command goes on",)
        raise
    finally:
        watch.close()
    results = load_all(folder / "results")
    for path in publish(results, budget, folder):
        print(f"wrote {path}")
    if args.json is not None:
        from bitneat.files import write_json
        from bitneat.reproduce.tables import table_one

        table = table_one(results)
        write_json(args.json, {"table1": [dict(zip(table.columns, row, strict=True)) for row in table.rows]})
    return 0


def _chosen(all_jobs: list[Job], patterns: list[str] | None) -> list[Job]:
    if not patterns:
        return all_jobs
    for pattern in patterns:
        if not any(fnmatchcase(job.name, pattern) for job in all_jobs):
            raise BitneatError(f"--only {pattern}: matches no job; --list shows them")
    wanted = {job.name for job in all_jobs if any(fnmatchcase(job.name, pattern) for pattern in patterns)}
    by_name = {job.name: job for job in all_jobs}
    pending = list(wanted)
    while pending:  # what they need, too
        needed = set(by_name[pending.pop()].after) - wanted
        wanted |= needed
        pending += needed
    return [job for job in all_jobs if job.name in wanted]


def _claim_folder(folder: Path, budget: str) -> None:
    """Make the folder this budget's: results of different ones must not meet in one table.

    Raises:
        BitneatError: if it is another budget's, or somebody else's.
    """
    from bitneat.files import write_json
    from bitneat.folders import REPRODUCE, begun

    if not _is_claimed(folder, budget):
        with begun(folder, REPRODUCE):
            write_json(folder / _BUDGET, {"budget": budget})


def _is_claimed(folder: Path, budget: str) -> bool:
    """Whether the folder is this budget's.

    Raises:
        BitneatError: if it is another's.
    """
    from bitneat.files import read_capped

    path = folder / _BUDGET
    if not path.exists():
        return False
    try:
        held = json.loads(read_capped(path, 1 << 12, regular=True))["budget"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise BitneatError(f"{path}: damaged: expected a budget's name") from None
    if held != budget:
        raise BitneatError(f"{folder}: holds results of --budget {held}; give another -o")
    return True


def _require_simulator() -> None:
    """Compile it once, before processes would side by side; Gymnasium alone would take days.

    Raises:
        BitneatError: if the native walker cannot be used.
    """
    from bitneat.reproduce.running import WALKER
    from bitneat.sim.walker.binding import library
    from bitneat.sim.walker.original import obstacle

    reason = obstacle(WALKER)
    if reason is not None:
        raise BitneatError(f"reproduce: needs the native simulator, which cannot be used: {reason}")
    library()


class _Watch:
    """A bar and the running jobs on a terminal; elsewhere a line for each result, and now and then how far the others are."""

    def __init__(self, total: int) -> None:
        self._began = self._looked = time.monotonic()
        self._total = total
        self._live = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live

            self._live = Live(console=Console(stderr=True), refresh_per_second=2, transient=True)
            self._live.start()

    def tell(self, state: State) -> None:
        """Show it."""
        from bitneat.reproduce.schedule import elapsed

        if state.skipped is not None:
            self._print(f"{state.skipped[0]}: left out: {state.skipped[1]}")
        if state.finished is not None:
            score = state.finished.heldout
            self._print(
                f"{state.finished.job}: {score['mean']:.1f} ± {score['std']:.1f} held out, {state.finished.links} links"
                f" ({state.done} of {state.total}, {elapsed(self._began)})"
            )
        if self._live is not None:
            from rich.console import Group
            from rich.progress_bar import ProgressBar
            from rich.text import Text

            lines = [Text(f"{name}: {count} generations") for name, count in state.running]
            self._live.update(Group(ProgressBar(total=state.total, completed=state.done), *lines))
        elif time.monotonic() - self._looked > _LOOK_SECONDS and state.running:
            self._looked = time.monotonic()
            self._print("running: " + ", ".join(f"{name} (generation {count})" for name, count in state.running))

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self._live is not None:
            self._live.stop()

    def _print(self, line: str) -> None:
        if self._live is not None:
            self._live.console.print(line, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)
