# SPDX-License-Identifier: MIT
"""``python -m tools.champions``: writes the tables, the data and the plot of examples/champions from the champion files themselves.

Scores are evaluated anew: on the ``REPORT`` seeds of the files, which must give the file's score to the bit, and on ``MORE`` seeds
behind them, as a hundred episodes are too few to see what is rare. What is claimed of a champion are the latter.
"""

from __future__ import annotations

import csv
import io
import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks.pages import replaced
from bitneat.champion import Champion, load
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator, GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.search import Score
from bitneat.files import write_atomic
from bitneat.report.pareto import collect, of_one_environment, pareto_figure
from bitneat.sim.bipedal import is_walker
from bitneat.sim.environment import reward_threshold

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "champions"
PAGE = FOLDER / "README.md"
ENVIRONMENTS = (
    "BipedalWalker-v3",
    "BipedalWalkerHardcore-v3",
    "LunarLander-v3",
    "CartPole-v1",
    "Acrobot-v1",
    "Pendulum-v1",
    "MountainCarContinuous-v0",
)
"""In the order of the tables."""
REPORT = 100
MORE = 4000
WORKERS = 2


@dataclass(frozen=True)
class Row:
    """A champion and its scores."""

    name: str
    champion: Champion
    report: Score
    more: Score
    above: float | None
    """Part of the further episodes at or above what the environment asks for; None if it asks for nothing."""

    @property
    def environment(self) -> str:
        """Its id."""
        assert self.champion.environment is not None
        return self.champion.environment.id


def champions() -> dict[str, Champion]:
    """The champions by name, in the order of the tables."""
    found = {path.stem: load(path) for path in sorted(FOLDER.glob("*.pkl"))}
    return dict(sorted(found.items(), key=lambda item: (ENVIRONMENTS.index(_environment(item[1])), -_bytes(item[1]))))


def evaluator(champion: Champion, workers: int = 1) -> Evaluator:
    """What runs its episodes."""
    spec = champion.environment
    assert spec is not None
    max_steps = champion.provenance["max_steps"]
    if is_walker(spec):
        return NativeWalkerEvaluator(spec, max_steps, workers)
    return GymnasiumEvaluator(spec, champion.action, max_steps, workers)


def row(name: str, champion: Champion, more: int) -> Row:
    """Evaluate a champion.

    Raises:
        BitneatError: if the report seeds do not give the score that the file has.
    """
    assert champion.environment is not None
    runs = evaluator(champion, WORKERS if more else 1)
    try:
        seeds = report_seeds(REPORT + more)
        episodes = runs.evaluate([champion.controller], seeds)[0]
    finally:
        runs.close()
    report, rest = Score.of(episodes[:REPORT]), episodes[REPORT:] or episodes
    claimed = {key: value for key, value in champion.provenance["held_out"].items() if key != "first_seed"}
    if report.to_data() != claimed:
        raise BitneatError(f"{name}: the report seeds give {report.to_data()}, the file says {claimed}")
    threshold = reward_threshold(champion.environment)
    above = None if threshold is None else sum(e.reward >= threshold for e in rest) / len(rest)
    return Row(name, champion, report, Score.of(rest), above)


def table(rows: list[Row]) -> str:
    """What is claimed of each champion."""
    lines = [
        "| name | environment | mean ± std | worst | solved | nodes | links | bytes | controller |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in rows:
        controller = one.champion.controller
        solved = "" if one.above is None else f"{100 * one.above:.2f} %"
        lines.append(
            f"| {one.name} | {one.environment} | {_score(one.more)} | {solved} |"
            f" {len(controller.nodes)} | {controller.num_links} | {_bytes(one.champion)} | {controller.sha256[:12]} |"
        )
    return "\n".join(lines) + "\n"


def report_table(rows: list[Row]) -> str:
    """The scores that the files have."""
    lines = ["| name | mean ± std | worst |", "|---|---|---|"]
    lines += [f"| {one.name} | {_score(one.report)} |" for one in rows]
    return "\n".join(lines) + "\n"


def _score(score: Score) -> str:
    return f"{score.mean:.1f} ± {score.std:.1f} | {score.min:.1f}"


def front_csv() -> bytes:
    """All champions of BipedalWalker-v3, those of the front included, by bytes."""
    points = of_one_environment(collect([FOLDER]), ENVIRONMENTS[0]).points
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["packed_bytes", "mean", "std", "sha256"])
    for point in sorted(points, key=lambda p: (p.packed_bytes, -p.mean)):
        writer.writerow([point.packed_bytes, point.mean, point.std, point.sha256])
    return out.getvalue().encode()


def _environment(champion: Champion) -> str:
    assert champion.environment is not None
    return champion.environment.id


def _bytes(champion: Champion) -> int:
    return len(pack(champion.controller))


def main() -> int:
    """Evaluate and write."""
    rows = []
    for name, champion in champions().items():
        rows.append(row(name, champion, MORE))
        print(f"{name}: {rows[-1].report.mean:.1f}, {rows[-1].more.mean:.1f} over {MORE} more", flush=True)
    page = replaced(PAGE.read_text(encoding="utf-8"), "scores", table(rows))
    write_atomic(PAGE, replaced(page, "report", report_table(rows)).encode())
    write_atomic(FOLDER / "front.csv", front_csv())
    points = of_one_environment(collect([FOLDER]), ENVIRONMENTS[0]).points
    write_atomic(FOLDER.parents[1] / "docs" / "pareto.svg", pareto_figure(points, [300.0], "svg"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
