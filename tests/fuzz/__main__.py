# SPDX-License-Identifier: MIT
"""Runs a fuzzer until it has done a number of cases: ``python -m tests.fuzz steps --count 10000000 --record``.

It goes on where it was stopped, shows how far it is, and stops at the first finding with exit status 1 and what replays it.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from bitneat.version import __version__
from tests.fuzz import activations, agreement, blobs, files, steps
from tests.fuzz.figures import Totals, committed, forget, note, record, resumed, table
from tests.fuzz.target import FindingError, Target

TARGETS: dict[str, Target] = {
    "activations": activations.TARGET,
    "steps": steps.TARGET,
    **blobs.TARGETS,
    "agreement": agreement.TARGET,
    **files.TARGETS,
}

HELP = "a fuzzer; table prints the recorded figures, corpus commits the fewest blobs that reach all that `blobs` has reached"


def _processor_seconds() -> float:
    return sum(os.times()[:4])


def fuzz(name: str, count: int) -> Totals:
    """Run batches until ``count`` cases are done, those of earlier runs included.

    Raises:
        FindingError: at the first finding; the batch is not counted.
    """
    target = TARGETS[name]
    totals = resumed(name)
    shown = 0.0
    while totals.count < count:
        started = _processor_seconds()
        batch = target.run(totals.batches)
        totals.batches += 1
        totals.count += batch.count
        for unit, value in batch.also.items():
            totals.also[unit] = totals.also.get(unit, 0) + value
        totals.seconds = round(totals.seconds + _processor_seconds() - started, 2)
        note(name, totals)
        if time.monotonic() - shown > 10 or totals.count >= count:
            shown = time.monotonic()
            print(f"{name}: {totals.count:,} of {count:,} {target.unit}, batch {totals.batches}", flush=True)
    return totals


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=[*TARGETS, "table", "corpus"], help=HELP)
    parser.add_argument("--count", type=int, default=1, help="cases in all, those of earlier runs included")
    parser.add_argument("--batch", type=int, metavar="N", help="run batch N alone: what a finding names")
    parser.add_argument("--fresh", action="store_true", help="start from batch 0, whatever was done before")
    parser.add_argument("--record", action="store_true", help="write the totals into tests/fuzz/figures.json")
    options = parser.parse_args()
    if options.target == "corpus":
        blobs.write_corpus()
        return 0
    if options.target == "table":
        print(table(committed()), end="")
        return 0
    name, target = options.target, TARGETS[options.target]
    if options.fresh:
        forget(name)
    try:
        if options.batch is not None:
            print(target.run(options.batch))
            return 0
        totals = fuzz(name, options.count)
    except FindingError as error:
        print(f"FOUND {error}", file=sys.stderr)
        return 1
    if options.record:
        record(
            name,
            {
                "what": target.what,
                "unit": target.unit,
                "count": totals.count,
                "also": totals.also,
                "under": target.under,
                "findings": 0,
                "batches": totals.batches,
                "seconds": round(totals.seconds),
                "tools": target.tools(),
                "bitneat": __version__,
                "command": f"python -m tests.fuzz {name} --count {options.count} --record",
            },
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
