# SPDX-License-Identifier: MIT
"""The tables: rows of plain values from results, and as CSV."""

from __future__ import annotations

import csv
import io
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from bitneat.reproduce.experiments import BASELINES, BETAS, QUANTIZATIONS, SCENARIOS, SURVIVAL_THRESHOLDS, SYSTEMS
from bitneat.reproduce.results import Result

Value = str | int | float | None
Results = Mapping[str, Result]

_ROWS = (*SYSTEMS, "ptq-int", "ptq-ternary", *BASELINES, "ars-ternary")
"""Of Table 1; the last is ARS's policy by quantization with gains, which has C."""
_PTQ_METHOD = "round"
"""The rows ptq-int and ptq-ternary are the paper's rounding; the quantization table has the other methods."""


@dataclass(frozen=True)
class Table:
    """Named columns and rows."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    def to_csv(self) -> bytes:
        """With a header line; an absent value is an empty field."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(tuple(_shown(value) for value in row) for row in self.rows)
        return out.getvalue().encode()


def tables(results: Results) -> list[Table]:
    """All of them; rows for which there is no result yet are absent."""
    return [
        table_one(results),
        quantization(results),
        grid(results),
        temperatures(results),
        scenarios(results),
        hardcore(results),
    ]


def of_system(results: Results, system: str) -> list[Result]:
    """The runs behind a system's row in Table 1."""
    if system == "ars-ternary":
        return [r for name, r in results.items() if name.startswith("ars-ternary-gains-")]
    if system.startswith("ptq-"):
        target = system.removeprefix("ptq-")
        return [r for name, r in results.items() if name.startswith(f"ptq-{target}-{_PTQ_METHOD}-")]
    group = "baselines" if system in BASELINES else "table"
    return [r for r in results.values() if r.group == group and r.system == system]


def median_run(runs: Sequence[Result]) -> Result:
    """The run with the median held-out mean; of an even number the lower one."""
    return sorted(runs, key=lambda r: r.heldout["mean"])[(len(runs) - 1) // 2]


def table_one(results: Results) -> Table:
    """A row for each system: its median run, and the spread of all."""
    rows = []
    for system in _ROWS:
        runs = of_system(results, system)
        if not runs:
            continue
        run = median_run(runs)
        means = [r.heldout["mean"] for r in runs]
        maxima = [r.paper_max for r in runs if r.paper_max is not None]
        rows.append(
            (
                system,
                run.heldout["mean"],
                run.heldout["std"],
                len(runs),
                min(means),
                max(means),
                run.heldout["episodes"],
                run.episodes,
                run.steps,
                run.generations,
                run.nodes,
                run.links,
                run.packed_bytes,
                run.float_bytes,
                run.paper_max,
                max(maxima) if maxima else None,
                run.paper_nodes,
                run.paper_links,
                run.command,
            )
        )
    columns = (
        "system", "heldout_mean", "heldout_std", "runs", "worst_run_mean", "best_run_mean", "heldout_episodes",
        "episodes", "steps", "generations", "nodes", "links", "packed_bytes", "float_bytes",
        "paper_max", "best_run_paper_max", "paper_nodes", "paper_links", "command",
    )  # fmt: skip
    return Table("table1", columns, tuple(rows))


def quantization(results: Results) -> Table:
    """Quantization after training by every method, and beside it evolving in integers and ternary from the start."""
    rows: list[tuple[Value, ...]] = []
    for prefix, source in (("ptq", "default"), ("ars", "ars")):
        for target, method in QUANTIZATIONS:
            runs = [r for name, r in results.items() if name.startswith(f"{prefix}-{target}-{method}-")]
            if runs:
                before = statistics.fmean(r.notes["before"]["mean"] for r in runs)
                rows.append((target, f"after training of {source}: {method}", before, *_summary(runs)))
    for target, system in (("int", "int"), ("ternary", "bit"), ("ternary", "bit-gains")):
        runs = of_system(results, system)
        if runs:
            rows.append((target, f"evolved: {system}", None, *_summary(runs)))
    columns = (
        "weights",
        "method",
        "float_mean",
        "heldout_mean",
        "runs",
        "worst_run",
        "best_run",
        "links",
        "packed_bytes",
    )
    return Table("quantization", columns, tuple(rows))


def _summary(runs: Sequence[Result]) -> tuple[Value, ...]:
    means = [r.heldout["mean"] for r in runs]
    sizes = [r.packed_bytes for r in runs if r.packed_bytes is not None]
    return (
        statistics.fmean(means),
        len(runs),
        min(means),
        max(means),
        statistics.fmean(r.links for r in runs),
        statistics.fmean(sizes) if sizes else None,
    )


def grid(results: Results) -> Table:
    """Softmax sampling: survival threshold by beta."""
    rows = []
    for threshold in SURVIVAL_THRESHOLDS:
        for beta in BETAS:
            runs = cell(results, threshold, beta)
            if runs:
                rows.append((threshold, beta, *_over_runs(runs)))
    return Table("grid", ("survival_threshold", "beta", *_OVER_RUNS), tuple(rows))


def temperatures(results: Results) -> Table:
    """Softmax sampling over the whole population: beta alone."""
    rows = [(beta, *_over_runs(runs)) for beta in BETAS if (runs := cell(results, 1.0, beta))]
    return Table("temperatures", ("beta", *_OVER_RUNS), tuple(rows))


def scenarios(results: Results) -> Table:
    """Episodes a fitness, at the same number of episodes in all."""
    rows = []
    for count in SCENARIOS:
        runs = [r for name, r in results.items() if name.startswith(f"scenarios-{count}-")]
        if runs:
            rows.append((count, *_over_runs(runs)))
    return Table("scenarios", ("scenarios", *_OVER_RUNS), tuple(rows))


def hardcore(results: Results) -> Table:
    """Champions of the flat terrain on the hardcore one."""
    rows = []
    for system in _ROWS:
        runs = [r for r in of_system(results, system) if r.hardcore is not None]
        if runs:
            flat = statistics.fmean(r.heldout["mean"] for r in runs)
            hard = [r.hardcore["mean"] for r in runs if r.hardcore is not None]
            rows.append((system, len(runs), flat, statistics.fmean(hard), min(hard), max(hard)))
    return Table("hardcore", ("system", "runs", "flat_mean", "hardcore_mean", "worst_run", "best_run"), tuple(rows))


_OVER_RUNS = ("heldout_mean", "worst_run", "best_run", "runs", "paper_max", "generations", "episodes")


def _over_runs(runs: Sequence[Result]) -> tuple[Value, ...]:
    means = [r.heldout["mean"] for r in runs]
    maxima = [r.paper_max for r in runs if r.paper_max is not None]
    return (
        statistics.fmean(means),
        min(means),
        max(means),
        len(runs),
        statistics.fmean(maxima) if maxima else None,
        runs[0].generations,
        round(statistics.fmean(r.episodes for r in runs)),
    )


def cell(results: Results, threshold: float, beta: float) -> list[Result]:
    """The runs of one cell of the grid."""
    return [r for name, r in results.items() if name.startswith(f"grid-{threshold:g}-{beta:g}-")]


def markdown(table: Table, columns: Iterable[str] | None = None) -> str:
    """The table, or some of its columns, for a page."""
    names = list(columns or table.columns)
    indices = [table.columns.index(name) for name in names]
    lines = ["| " + " | ".join(name.replace("_", " ") for name in names) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join(_rounded(row[i]) for i in indices) + " |" for row in table.rows]
    return "\n".join(lines)


def _shown(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4f}".rstrip("0").rstrip(".")
    return str(value)


def _rounded(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:g}" if abs(value) <= 1 and round(value, 3) == value else f"{value:.1f}"
    return f"{value:,}" if isinstance(value, int) else value
