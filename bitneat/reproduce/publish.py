# SPDX-License-Identifier: MIT
"""From results to files: tables as CSV, figures, and a page that says what agrees with the paper and what does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bitneat.files import write_atomic
from bitneat.reproduce.claims import UNTESTED, claims, claims_table
from bitneat.reproduce.experiments import SYSTEMS, Budget
from bitneat.reproduce.results import Result, policy_from_data
from bitneat.reproduce.running import WALKER
from bitneat.reproduce.tables import Results, Table, markdown, median_run, of_system, tables

_STAGES = 8
_FRAMES = 8
_FRAME_WIDTH = 240
_STRIP_SEED = 7
_MAIN_COLUMNS = (
    "system",
    "heldout_mean",
    "heldout_std",
    "runs",
    "episodes",
    "nodes",
    "links",
    "packed_bytes",
    "paper_max",
)


def publish(results: Results, budget: Budget, folder: Path) -> list[Path]:
    """Write whatever the results so far allow; the paths written.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    made = tables(results)
    written = [_write(folder / f"{table.name}.csv", table.to_csv()) for table in made]
    written.append(_write(folder / "claims.csv", claims_table(results).to_csv()))
    figures = _figures(results, folder)
    written += figures
    written.append(_write(folder / "README.md", _page(results, budget, made, figures).encode()))
    return written


def _write(path: Path, content: bytes) -> Path:
    write_atomic(path, content)
    return path


def _figures(results: Results, folder: Path) -> list[Path]:
    from bitneat.report.film import strip
    from bitneat.report.paper import fitness_figure, growth_figure, steps_figure
    from bitneat.report.pictures import Episode, spread
    from bitneat.sim.environment import inspect

    written = []
    histories = {
        system: [list(map(float, run.history["best"])) for run in runs]
        for system in SYSTEMS
        if system != "bit-gains" and (runs := _longest(of_system(results, system)))
    }
    if histories:
        for kind in ("svg", "png"):
            written.append(_write(folder / f"figure4-fitness.{kind}", fitness_figure(histories, kind)))
    by_steps = {
        system: [(list(map(float, run.history["best"])), list(map(float, run.history["steps"]))) for run in runs]
        for system in SYSTEMS
        if (runs := _longest(of_system(results, system)))
    }
    if by_steps:
        for kind in ("svg", "png"):
            written.append(_write(folder / f"fitness-by-steps.{kind}", steps_figure(by_steps, kind)))
    for system in ("bit", "bit-gains"):
        runs = [run for run in of_system(results, system) if run.growth]
        if not runs:
            continue
        growth = median_run(runs).growth
        stages = [(entry["generation"], policy_from_data(entry["policy"])) for entry in _spread(growth, _STAGES)]
        for kind in ("svg", "png"):
            written.append(_write(folder / f"figure2-growth-{system}.{kind}", growth_figure(stages, kind)))
    for system in ("default", "bit", "bit-gains"):
        runs = [run for run in of_system(results, system) if run.policy is not None]
        if not runs:
            continue
        best = max(runs, key=lambda run: run.heldout["mean"])
        assert best.policy is not None
        taken = spread(Episode(WALKER, policy_from_data(best.policy), inspect(WALKER).action, _STRIP_SEED), _FRAMES)
        content = strip(taken, _FRAME_WIDTH, f"{best.job}, seed {_STRIP_SEED}")
        written.append(_write(folder / f"figure3-walk-{system}.png", content))
    return written


def _longest(runs: Sequence[Result]) -> list[Result]:
    """Those that are not cut far shorter than the longest, as what got a tenth of the budget is."""
    most = max((run.generations for run in runs), default=0)
    return [run for run in runs if run.generations > most / 2]


def _spread(entries: Sequence[Mapping[str, Any]], count: int) -> list[Mapping[str, Any]]:
    """About ``count`` of the entries, the first and the last among them."""
    if len(entries) <= count:
        return list(entries)
    return [entries[i] for i in sorted({round(i * (len(entries) - 1) / (count - 1)) for i in range(count)})]


def _page(results: Results, budget: Budget, made: Sequence[Table], figures: Sequence[Path]) -> str:
    by_name = {table.name: table for table in made}
    parts = [
        "# The Bit-Pedal Walker paper, run again",
        f"Written by `bitneat reproduce --budget {budget.name}`; nothing on this page is typed by hand. `results/` holds what each"
        " run came to, the CSV files all figures.",
        _budget_text(budget),
        "## Table 1",
        "`heldout mean ± std` is the official reward over 100 episodes that nothing was chosen on, of the median run's champion;"
        " `paper max` is what the paper prints: the largest fitness in the last generation of that run (of `wann` a mean over its"
        " six shared weights), `table1.csv` has the best run's, too."
        " `nodes` do not count the inputs, `packed bytes` are everything it takes to run the controller.",
        markdown(by_name["table1"], _MAIN_COLUMNS),
        "## The claims",
        *[_claim_lines(results)],
        "## Quantization: after training, or in training",
        markdown(by_name["quantization"]),
        "## Softmax sampling",
        markdown(by_name["grid"]),
        "## Scenarios a fitness, at equal nominal episodes (copies do not run again)",
        markdown(by_name["scenarios"]),
        "## Trained flat, tested on the hardcore terrain",
        markdown(by_name["hardcore"]),
        "## Figures",
        *[f"![{path.stem}]({path.name})" for path in figures if path.suffix == ".png"],
        "## Where this differs from the paper",
        _DIFFERENCES,
        "## Each run",
        _runs(results),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _budget_text(budget: Budget) -> str:
    seeds = ", ".join(f"{system} {count}" for system, count in budget.seeds.items())
    return (
        f"Budget `{budget.name}`: {budget.population} genomes, {budget.generations} generations, 5 episodes a genome;"
        f" runs: {seeds}. The grid, the scenarios and `bit-flips` have {budget.small_generations} generations"
        f" ({_part(budget)} of that budget), {budget.small_seeds} run{'s' if budget.small_seeds > 1 else ''} each."
    )


def _part(budget: Budget) -> str:
    ratio = budget.generations / budget.small_generations
    return "a tenth" if ratio == 10 else f"1/{ratio:.3g}"


def _claim_lines(results: Results) -> str:
    lines = ["| the paper's claim | counts as holding if | measured here | verdict |", "|---|---|---|---|"]
    lines += [f"| {c.claim} | {c.rule} | {c.measured} | {c.verdict} |" for c in claims(results)]
    open_ones = sum(c.verdict == UNTESTED for c in claims(results))
    if open_ones:
        lines.append(f"\n{open_ones} of them wait for runs that are not finished.")
    return "\n".join(lines)


def _runs(results: Results) -> str:
    lines = ["| run | held out | on hardcore | episodes | steps | command |", "|---|---|---|---|---|---|"]
    for name in sorted(results):
        run = results[name]
        hard = "" if run.hardcore is None else f"{run.hardcore['mean']:.1f}"
        lines.append(
            f"| {name} | {run.heldout['mean']:.1f} ± {run.heldout['std']:.1f} | {hard} | {run.episodes:,} | {run.steps:,}"
            f" | `{run.command}` |"
        )
    return "\n".join(lines)


_DIFFERENCES = """\
- Every genome of a generation runs on the same five new seeds. Copies of a controller run once and share the result;
  only episodes that ran are counted.
- The paper gives neither rates nor powers of weight and bias mutation. These are those of neat-python's own examples
  (`bitneat/evolve/presets/paper-*.ini` has every setting).
- `bit` is the published code's BitGenome: it never mutates the weight of a link that is there. `bit-flips` draws each
  weight again with a probability of 0.02.
- `softmax` copies its parents, which the published code did not; 5 % of the copies mutate. The row of Table 1 has the
  cell of the grid with the best score on the selection seeds.
- Integer and ternary genomes are evaluated in the integer arithmetic of the generated C, float genomes in float64.
- A hidden node that no input reaches is left out of integer and ternary networks; neat-python makes a constant of it.
- `bit-gains` is bitneat's own search, as many simulated steps as the `bit` run of the same seed took: an evolution
  strategy on a linear policy, whose ternary roundings are NEAT's first population.
- `ptq-int` and `ptq-ternary` round the champions of `default`, weight by weight, as the paper does."""
