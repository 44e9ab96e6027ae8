# SPDX-License-Identifier: MIT
"""Proves random controllers, and appends a row for each to a table: ``python -m tests.prove.campaign``.

Each seed gives a controller of 4 to 20 nodes (in canonical form), a style, whether inputs are guarded, a target and an
optimisation; the seeds below `EVERYWHERE` are proved for all twelve pairs. Seeds with a binary that is not proved do not enter
the table; the next run tries them again.
"""

from __future__ import annotations

import argparse
import csv
import random
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bitneat.champion import Champion
from bitneat.codegen import STYLES, CodegenError, Style, generate
from bitneat.controller import BoxAction, Controller
from bitneat.prove.check import OPTIMIZATIONS, TARGETS, PairProof, prove
from bitneat.verify.cfile import CFile
from tests.strategies import random_controller

TABLE = Path(__file__).parents[2] / "docs" / "proofs.csv"
COUNT = 1000
EVERYWHERE = 50
COLUMNS = (
    "seed", "nodes", "links", "ternary", "recurrent", "guard", "style", "target", "level", "verdict", "functions",
    "instructions", "lemmas", "seconds",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What one seed stands for."""

    seed: int
    controller: Controller
    style: Style
    guard: bool
    target: str
    optimization: str

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Where it is proved."""
        if self.seed < EVERYWHERE:
            return [(target, level) for target in TARGETS for level in OPTIMIZATIONS]
        return [(self.target, self.optimization)]


def case(seed: int) -> Case:
    """Draw until there is something to generate."""
    rng = random.Random(seed)
    while True:
        size = rng.choice(("small", "medium"))
        controller = random_controller(rng, size=size, num_nodes=rng.randint(4, 20))
        if 4 <= len(controller.canonical.nodes) <= 20:
            drawn = Case(
                seed, controller, rng.choice(STYLES), rng.random() < 0.2, rng.choice(TARGETS), rng.choice(OPTIMIZATIONS)
            )
            try:
                generate(controller, "drawn", drawn.style, guard=drawn.guard)
            except CodegenError:
                continue
            return drawn


def box_action(outputs: int) -> BoxAction:
    """What as many outputs can be decoded to."""
    return BoxAction((-1.0,) * outputs, (1.0,) * outputs, (outputs,), "float32")


def prove_case(one: Case) -> Iterator[PairProof]:
    """Its proofs, one by one."""
    champion = Champion(one.controller, box_action(len(one.controller.outputs)), None)
    with tempfile.TemporaryDirectory() as folder:
        code = CFile.write(generate(one.controller, "drawn", one.style, guard=one.guard), Path(folder))
        for target, level in one.pairs:
            report = prove(champion, [code], targets=[target], optimizations=[level], use_cache=False)
            yield report.pairs[0]


def main() -> int:
    """Go on with the table; the exit status says whether all of it is proved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("-o", "--output", type=Path, default=TABLE)
    args = parser.parse_args()
    rows = list(csv.DictReader(args.output.open())) if args.output.exists() else []
    done = {int(row["seed"]) for row in rows}
    if not args.output.exists():
        args.output.write_text(",".join(COLUMNS) + "\n")
    refused = 0
    for seed in range(args.count):
        if seed in done:
            continue
        one = case(seed)
        form = one.controller.canonical
        own = (seed, len(form.nodes), form.num_links, int(form.is_ternary), int(form.is_recurrent), int(one.guard))
        new, before = [], refused
        for pair in prove_case(one):
            effort = [proof.effort for proof in pair.functions]
            lemmas = sum(each.exhaustive + each.solver + each.known for each in effort)
            instructions = pair.functions[0].instructions
            seconds = f"{pair.seconds:.1f}"
            where = (one.style, pair.target, pair.optimization)
            new.append([*own, *where, pair.verdict, len(pair.functions), instructions, lemmas, seconds])
            if not pair.proved:
                refused += 1
                reasons = "; ".join(f"{proof.function}: {proof.reason}" for proof in pair.functions if proof.reason)
                print(
                    f"seed {seed}: {pair.target} {pair.optimization} {one.style}: {pair.verdict}: {reasons}", flush=True
                )
        if refused == before:
            with args.output.open("a", newline="") as file:  # all rows of a seed at once: what is there is whole
                csv.writer(file, lineterminator="\n").writerows(new)
        print(f"seed {seed}: {len(new)} binaries", file=sys.stderr, flush=True)
    print(f"{args.count} controllers: {refused} binaries not proved")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
