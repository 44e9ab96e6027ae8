# SPDX-License-Identifier: MIT
"""The paper's claims, each with what was measured here and a verdict that follows from it by a stated rule."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass

from bitneat.reproduce.experiments import SCENARIOS
from bitneat.reproduce.results import Result
from bitneat.reproduce.tables import Results, Table, cell, of_system, scenarios

UNTESTED = "not measured yet"
_WALKS = 100.0
"""Held-out mean from which a walker is said to walk: standing still earns about 0, reaching the end about 300."""


@dataclass(frozen=True)
class Claim:
    """What the paper says, how it is put to the test, and what came out."""

    claim: str
    rule: str
    measured: str
    verdict: str
    """``holds``, ``does not hold``, or `UNTESTED`."""


def claims(results: Results) -> list[Claim]:
    """All of them, in the paper's order."""
    return [test(results) for test in _TESTS]


def claims_table(results: Results) -> Table:
    """As a table."""
    rows = tuple((c.claim, c.rule, c.measured, c.verdict) for c in claims(results))
    return Table("claims", ("claim", "rule", "measurement", "verdict"), rows)


def _means(runs: list[Result]) -> list[float]:
    return [run.heldout["mean"] for run in runs]


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


def _claim(claim: str, rule: str, measured: str | None, holds: bool) -> Claim:
    if measured is None:
        return Claim(claim, rule, "", UNTESTED)
    return Claim(claim, rule, measured, "holds" if holds else "does not hold")


def _bit_score(results: Results) -> Claim:
    runs = of_system(results, "bit")
    measured = None
    if runs:
        maxima = [run.paper_max for run in runs if run.paper_max is not None]
        measured = (
            f"maximum of the last generation {_listed(maxima)}; the same champions over {runs[0].heldout['episodes']}"
            f" held-out episodes {_listed(_means(runs))}"
        )
    return _claim(
        "BitGenome reaches 254.29 in 300 generations",
        "the median run's champion has a held-out mean of at least 254",
        measured,
        bool(runs) and statistics.median(_means(runs)) >= 254,
    )


def _default_score(results: Results) -> Claim:
    runs = of_system(results, "default")
    maxima = [run.paper_max for run in runs if run.paper_max is not None]
    measured = f"maximum of the last generation {_listed(maxima)}; held out {_listed(_means(runs))}" if runs else None
    return _claim(
        "The float genome reaches 270 in 300 generations",
        "the median run's champion has a held-out mean of at least 270",
        measured,
        bool(runs) and statistics.median(_means(runs)) >= 270,
    )


def _integer_ptq(results: Results) -> Claim:
    runs = _rounded(results, "int")
    losses = [1 - run.heldout["mean"] / before for run in runs if (before := run.notes["before"]["mean"]) >= _WALKS]
    pairs = _before_and_after(runs)
    middle = statistics.median(losses) if losses else math.nan
    return _claim(
        "Rounding trained weights to integers loses about 17 % of the reward",
        f"the median loss of the float policies that walk (a mean of {_WALKS:g} or more) is between 10 % and 25 %",
        f"{pairs}; median loss {100 * middle:.0f} %" if losses else None,
        0.10 <= middle <= 0.25,
    )


def _rounded(results: Results, target: str) -> list[Result]:
    """Float policies rounded weight by weight: the float genome's champions, and ARS's policy."""
    ars = [run for name, run in results.items() if name.startswith(f"ars-{target}-round-")]
    return [*of_system(results, f"ptq-{target}"), *ars]


def _before_and_after(runs: list[Result]) -> str:
    pairs = (f"{run.config['source']} {run.notes['before']['mean']:.1f} to {run.heldout['mean']:.1f}" for run in runs)
    return "held-out means before and after: " + ", ".join(pairs)


def _integer_genome(results: Results) -> Claim:
    ints, floats = of_system(results, "int"), of_system(results, "default")
    measured = None
    ratio = math.nan
    if ints and floats:
        first, second = statistics.median(_means(ints)), statistics.median(_means(floats))
        ratio = first / second if second > 0 else math.nan
        measured = f"held-out medians {first:.1f} (int, {len(ints)} runs) and {second:.1f} (float, {len(floats)} runs)"
    return _claim(
        "IntGenome is as good as the float genome",
        "its median held-out mean is within 10 % of the float genome's",
        measured,
        abs(ratio - 1) <= 0.1,
    )


def _ternary_ptq(results: Results) -> Claim:
    runs = _rounded(results, "ternary")
    walked = [run for run in runs if run.notes["before"]["mean"] >= _WALKS]
    return _claim(
        "Walkers rounded to ternary weights after training still walk",
        f"of those with a mean of {_WALKS:g} or more before, the median after is still that high",
        _before_and_after(runs) if walked else None,
        bool(walked) and statistics.median(_means(walked)) >= _WALKS,
    )


def _bit_ahead(results: Results) -> Claim:
    bits, floats = of_system(results, "bit"), of_system(results, "default")
    measured, holds = None, False
    if bits and floats:
        first, second = _mean_history(bits), _mean_history(floats)
        ahead = [a > b for a, b in zip(first, second, strict=False)]
        holds = all(ahead)
        measured = (
            f"the mean over {len(bits)} and {len(floats)} runs of each generation's best fitness is higher for bit in"
            f" {sum(ahead)} of {len(ahead)} generations"
        )
    return _claim(
        "BitGenome is ahead of the float genome at every generation",
        "the best fitness, averaged over runs, is higher in all generations",
        measured,
        holds,
    )


def _mean_history(runs: list[Result]) -> list[float]:
    return [statistics.fmean(values) for values in zip(*(run.history["best"] for run in runs), strict=False)]


def _more_scenarios(results: Results) -> Claim:
    table = scenarios(results)
    means = [float(row[1] or 0.0) for row in table.rows]
    complete = len(means) == len(SCENARIOS)
    measured = "; ".join(f"{row[0]}: {row[1]:.1f}" for row in table.rows) if complete else None
    return _claim(
        "More scenarios a fitness help (1, 3, 5, 10)",
        "held-out means over the runs rise from each number of scenarios to the next, at equal nominal episodes",
        measured,
        complete and means == sorted(means) and len(set(means)) == len(means),
    )


def _hardcore(results: Results) -> Claim:
    systems = ("default", "int", "bit", "ars", "ppo")
    runs = [r for system in systems for r in of_system(results, system) if r.hardcore]
    walk = [run for run in runs if run.heldout["mean"] >= _WALKS]
    losses = [run.heldout["mean"] - run.hardcore["mean"] for run in walk if run.hardcore]
    pairs = ", ".join(
        f"{run.job} {run.heldout['mean']:.1f} to {run.hardcore['mean']:.1f}" for run in runs if run.hardcore
    )
    return _claim(
        "Champions trained on flat ground do similarly on the hardcore terrain",
        f"the median difference of those that walk on flat ground (a mean of {_WALKS:g} or more) is at most 30 points",
        pairs if walk else None,
        bool(losses) and statistics.median(losses) <= 30,
    )


def _bytes(results: Results) -> Claim:
    runs = of_system(results, "bit")
    measured = None
    if runs:
        formula = [math.ceil((run.paper_links or 0) * 1.5 / 8) for run in runs]
        measured = (
            f"1.5 bits a link give {', '.join(map(str, formula))} bytes; with topology, activations and header the packed"
            f" controllers take {', '.join(str(run.packed_bytes) for run in runs)}"
        )
    return _claim(
        "The champion takes 22 bytes",
        "the packed controller of the median run, with everything it takes to run it, has at most 22 bytes",
        measured,
        bool(runs) and statistics.median(run.packed_bytes or math.inf for run in runs) <= 22,
    )


def _softmax(results: Results) -> Claim:
    runs = of_system(results, "softmax")
    bits = of_system(results, "bit")
    cells = [r for t in (1.0, 0.5, 0.1) for b in (0.005, 0.03, 0.09) for r in cell(results, t, b)]
    measured = None
    if runs and bits and cells:
        best = max(_means(cells))
        measured = (
            f"best cell of the grid: held out {_listed(_means(runs))}; best single run of the grid {best:.1f};"
            f" default reproduction {_listed(_means(bits))}"
        )
    return _claim(
        "Softmax sampling over fitness does worse than the default reproduction (-88.75)",
        "the median held-out mean of the best temperature is below that of the default reproduction",
        measured,
        bool(runs and bits) and statistics.median(_means(runs)) < statistics.median(_means(bits)),
    )


_TESTS: tuple[Callable[[Results], Claim], ...] = (
    _default_score,
    _bit_score,
    _bit_ahead,
    _integer_genome,
    _integer_ptq,
    _ternary_ptq,
    _softmax,
    _more_scenarios,
    _hardcore,
    _bytes,
)
