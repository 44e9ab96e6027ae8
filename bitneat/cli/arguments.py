# SPDX-License-Identifier: MIT
"""Arguments that several sub-commands share, and the types that check a value while it is read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from bitneat.errors import BitneatError


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add ``--json FILE``; write the result with `bitneat.files.write_json` if ``args.json`` is not None."""
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the result as JSON to FILE, too")


NO_LIMIT = math.inf
"""What ``--time none`` is read as."""


def add_time(parser: argparse._ActionsContainer) -> None:
    """Add ``--time``; `time_limit` says what it comes to."""
    parser.add_argument(
        "--time",
        metavar="SECONDS",
        type=_seconds,
        help="stop after SECONDS; a run that this cuts short is not reproducible. With --resume, none lifts the limit",
    )


def _seconds(text: str) -> float:
    try:
        return NO_LIMIT if text == "none" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds, or none") from None


def time_limit(given: float | None, before: float | None = None) -> float | None:
    """Seconds after which to stop, or None: as ``--time`` says, or as ``before`` if it was not given.

    Raises:
        BitneatError: if it is no time.
    """
    if given is None:
        return before
    if not given > 0:
        raise BitneatError(f"--time {given}: expected a number of seconds above 0, or none")
    return None if given == NO_LIMIT else given


MAX_WORKERS = 256
"""On one machine: the native simulators have at most so many threads, and each process takes its share of memory."""


def add_workers(parser: argparse._ActionsContainer, what: str) -> None:
    """Add ``--workers``; ``what`` says of what there are so many."""
    parser.add_argument(
        "--workers",
        metavar="N",
        type=whole_number(1),
        help=f"{what}, {MAX_WORKERS} at most (default: one a core)",
    )


def require_few_workers(args: argparse.Namespace) -> None:
    """Refuse more ``--workers`` than one machine is asked for; a Ray cluster may have any number of cores.

    Raises:
        BitneatError: if there are too many.
    """
    workers = getattr(args, "workers", None)
    if workers is not None and workers > MAX_WORKERS and getattr(args, "evaluator", None) != "ray":
        raise BitneatError(f"--workers {workers}: expected a whole number in 1..{MAX_WORKERS}")


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return an argument type for the integers from ``least`` to ``most``."""
    expected = f"a whole number of {least} or more" if most is None else f"a whole number in {least}..{most}"

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or value < least or (most is not None and value > most):
            raise argparse.ArgumentTypeError(f"{text!r:.80} is not {expected}")
        return value

    return parse


def seed(text: str) -> int:
    """The argument type of the seed of a run's whole randomness."""
    from bitneat.evolve.randomness import MAX_SEED

    try:
        value = int(text)
    except ValueError:
        value = -1
    if not 0 <= value < MAX_SEED:
        bits = MAX_SEED.bit_length() - 1
        raise argparse.ArgumentTypeError(f"{text!r:.80} is not a whole number of 0 or more, of at most {bits} bits")
    return value
