# SPDX-License-Identifier: MIT
"""What the commands cost beyond the start of Python itself."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from bitneat.bench.measurement import Measurement, seconds_of
from bitneat.bench.network import champion_of, hundred_links
from bitneat.champion import save_pickle
from bitneat.errors import BitneatError

HELP_GOAL = 0.4
CODEGEN_GOAL = 0.5
_PYTHON = [sys.executable, "-c", "pass"]
_BASELINE = "python -c pass"


def measure_help(repetitions: int) -> list[Measurement]:
    """Measure ``bitneat --help`` from start to end."""
    total, bare, _ = _beside_python([sys.executable, "-m", "bitneat", "--help"], repetitions)
    goal = f"< {HELP_GOAL}"
    return [
        Measurement(
            "bitneat --help", total, _BASELINE, bare, "s", total, "s from start to end", goal, total < HELP_GOAL
        )
    ]


def measure_codegen(repetitions: int) -> list[Measurement]:
    """Measure ``bitneat codegen`` of the 100-link network, beyond Python's start."""
    controller = hundred_links()
    with tempfile.TemporaryDirectory() as temporary:
        champion, out = Path(temporary) / "champion.pkl", Path(temporary) / "walker.c"
        save_pickle(champion_of(controller), champion)
        command = [sys.executable, "-m", "bitneat", "codegen", str(champion), "-o", str(out)]
        total, bare, beyond = _beside_python(command, repetitions)
    what = f"bitneat codegen of {controller.num_links} links"
    goal = f"< {CODEGEN_GOAL}"
    means = "s beyond Python's start"
    return [Measurement(what, total, _BASELINE, bare, "s", beyond, means, goal, beyond < CODEGEN_GOAL)]


def _beside_python(command: list[str], repetitions: int) -> tuple[float, float, float]:
    """Medians of the command, of Python alone, and of the differences between neighbours in time."""

    def run(arguments: list[str]) -> None:
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BitneatError(f"{' '.join(arguments[1:])}: {done.stderr.strip() or 'failed'}")

    run(command)  # fills the caches of bytecode and of compiled code
    totals, bares = [], []
    for _ in range(repetitions):
        totals.append(seconds_of(lambda: run(command)))
        bares.append(seconds_of(lambda: run(_PYTHON)))
    beyond = statistics.median(total - bare for total, bare in zip(totals, bares, strict=True))
    return statistics.median(totals), statistics.median(bares), beyond
