# SPDX-License-Identifier: MIT
"""Mutation testing of the Python core: ``python -m tests.mutation.run_python --coverage DATA… --junit XML… -o RESULTS``.

First the tests run once under coverage with ``--cov-context=test --junitxml=XML``, which tells the tests that execute each
line, and how long they take. Then each mutant is judged by the tests that execute its line, the fastest first, up to the first
that fails. A mutant on a line that runs at import is judged by all tests that execute its file. Results are added to a file of
one JSON object a line; what is in it is not run again.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

from coverage import CoverageData

from tests.mutation.python_source import Mutant, mutants, mutated
from tests.mutation.warm import ROOT, Runner, copy_of_checkout, in_order

FIRST_SECONDS = 2.0
"""Tests that together take that long are tried first: most mutants die there."""
FIRST_TESTS = 24
CHECKED_SECONDS = 10.0
"""Of tests that must pass before there is a mutant."""


def read_durations(files: Iterable[Path]) -> dict[str, float]:
    """Seconds of every test that passed, by its name."""
    seconds = {}
    for file in files:
        for case in ElementTree.parse(file).getroot().iter("testcase"):
            if len(case) == 0 or all(child.tag.startswith("system") for child in case):
                parts = case.get("classname", "").split(".")
                classes = [part for part in parts if part.startswith("Test")]
                module = "/".join(parts[: len(parts) - len(classes)]) + ".py"
                seconds["::".join([module, *classes, case.get("name", "")])] = float(case.get("time", "1"))
    return seconds


def read_contexts(files: Iterable[Path]) -> dict[str, dict[int, set[str]]]:
    """The tests that execute each line of each file of the project; lines that run at import have the empty name."""
    lines: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
    for file in files:
        data = CoverageData(str(file))
        data.read()
        for path in data.measured_files():
            name = str(Path(path).relative_to(ROOT)) if Path(path).is_absolute() else path
            for line, contexts in data.contexts_by_lineno(path).items():
                lines[name][line] |= {context.split("|")[0] for context in contexts}
    return lines


def tests_of(mutant: Mutant, lines: dict[int, set[str]], known: dict[str, float]) -> tuple[set[str], set[str]]:
    """The tests that execute the mutant's statement; and all others of its file, if it is executed outside of any test.

    That is at import, or in a process that a test starts, which coverage does not know the test of.
    """
    first, last = mutant.span
    found = set[str]().union(*(lines.get(line, set()) for line in range(first, last + 1)))
    others = set[str]().union(*lines.values()) - found if "" in found else set()
    return found & set(known), others & set(known)


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="modules to mutate, as bitneat/controller/ir.py")
    parser.add_argument("--coverage", nargs="+", type=Path, required=True)
    parser.add_argument("--junit", nargs="+", type=Path, required=True)
    parser.add_argument("--sample", type=int, help="so many mutants, drawn with seed 1")
    parser.add_argument("--most-seconds", type=float, default=60.0, help="of tests for one mutant")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()

    durations = read_durations(arguments.junit)
    contexts = read_contexts(arguments.coverage)
    output = arguments.output.resolve()
    done = {}
    if output.is_file():
        done = {(row["path"], row["number"]): row for row in map(json.loads, output.read_text().splitlines())}
    todo: list[Mutant] = []
    sources = {}
    for file in arguments.files:
        name = str(file.resolve().relative_to(ROOT))
        sources[name] = (ROOT / name).read_text(encoding="utf-8")
        todo += mutants(name, sources[name])
    # In an order of chance, so that what has been run when somebody stops it is a sample of all.
    random.Random(1).shuffle(todo)
    todo = todo[: arguments.sample]
    todo = [mutant for mutant in todo if (mutant.path, mutant.number) not in done]
    with tempfile.TemporaryDirectory(prefix="bitneat-mutation-") as folder:
        copy = Path(folder)
        copy_of_checkout(copy)
        runner = Runner(copy, sorted({test.split("::")[0] for test in durations}))
        used = set[str]().union(*(set[str]().union(*tests_of(m, contexts[m.path], durations)) for m in todo))
        check = runner.run(in_order(used, durations, CHECKED_SECONDS), 60 + 5 * CHECKED_SECONDS)
        if check.outcome != "passed":
            print(f"without a mutant: {check.outcome} {check.test}", file=sys.stderr)
            return 2
        for count, mutant in enumerate(todo):
            verdict = judge(
                runner, mutant, sources[mutant.path], contexts[mutant.path], durations, arguments.most_seconds
            )
            row = {**mutant.__dict__, **verdict, "time": round(time.time())}
            with output.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            if verdict["outcome"] in ("passed", "none") or count % 50 == 0:
                print(
                    f"{count}/{len(todo)} {verdict['outcome']:7} {mutant.path}:{mutant.line} {mutant.before} -> {mutant.after}",
                    flush=True,
                )
    return 0


def judge(
    runner: Runner, mutant: Mutant, source: str, lines: dict[int, set[str]], durations: dict[str, float], most: float
) -> dict[str, object]:
    """What the tests say of one mutant."""
    tests, others = tests_of(mutant, lines, durations)
    ordered = in_order(tests, durations, most)
    ordered += in_order(others, durations, most - sum(durations[test] for test in ordered))
    first = in_order(ordered, durations, FIRST_SECONDS)[:FIRST_TESTS]
    file = runner.copy / mutant.path
    try:
        file.write_text(mutated(source, mutant.number), encoding="utf-8")
        for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            compiled.unlink()
        verdict = runner.run(first, 20 + 10 * FIRST_SECONDS)
        rest = [test for test in ordered if test not in first]
        if not verdict.caught and rest:
            verdict = runner.run(rest, 30 + 5 * most)
    finally:
        file.write_text(source, encoding="utf-8")
    return {
        "outcome": verdict.outcome,
        "test": verdict.test,
        "seconds": round(verdict.seconds, 2),
        "tests": len(ordered),
        "left_out": len(tests | others) - len(ordered),
    }


if __name__ == "__main__":
    sys.exit(main())
