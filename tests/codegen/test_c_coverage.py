# SPDX-License-Identifier: MIT
"""The corpus of parity executes every line of generated C and of the runtime, and takes every branch both ways.

gcc counts. A line of generated C stands for all that differ from it in numbers alone, as they come from one line of a template:
what one controller's table never needs another's does.
"""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from bitneat.native.data import runtime_dir
from tests.mutation import parity
from tests.mutation.checker import PROGRAM
from tests.mutation.corpus import blobs, subjects

SOURCES = ("interpreter", *parity.RUNTIME_SOURCES)


@dataclass
class Counts:
    """What became of the lines of one text: how often each was executed, and each of its branches taken."""

    lines: int = 0
    branches: list[int] = field(default_factory=list)


@pytest.fixture(scope="module")
def counted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[tuple[str, int], Counts]]:
    """For each file its lines, numbers left out of generated ones, with what gcov says."""
    if shutil.which("gcov") is None:
        pytest.skip("gcov, which comes with gcc, is missing")
    folder = tmp_path_factory.mktemp("coverage")
    found = subjects()
    parity.write_data(found, folder / "data")
    (folder / "main.c").write_text(parity.generated_source(found, parity.instances(found, 1)))
    (folder / "checker.c").write_text(PROGRAM)
    include = [f"-I{runtime_dir() / name}" for name in ("include", "src")]
    for name in ("main", "checker", *SOURCES):
        source = folder / f"{name}.c"
        if name in SOURCES:
            shutil.copy(runtime_dir() / "src" / f"{name}.c", source)
        subprocess.run(
            ["gcc", "-std=c99", "-w", "-O0", "--coverage", *include, "-c", source.name], cwd=folder, check=True
        )
    objects = [f"{name}.o" for name in SOURCES]
    for name, arguments, data in (
        ("main", ["data"], b""),
        ("checker", [], b"".join(struct.pack("<I", len(blob)) + blob for blob in blobs()[0])),
    ):
        subprocess.run(["gcc", "--coverage", f"{name}.o", *objects, "-o", name], cwd=folder, check=True)
        subprocess.run([folder / name, *arguments], cwd=folder, input=data, check=True, stdout=subprocess.DEVNULL)
    return {name: _counts(folder, name) for name in ("main", *SOURCES)}


def _counts(folder: Path, name: str) -> dict[tuple[str, int], Counts]:
    said = subprocess.run(
        ["gcov", "--json-format", "--branch-probabilities", "--stdout", f"{name}.gcda"],
        cwd=folder, capture_output=True, check=True, text=True,
    ).stdout  # fmt: skip
    text = (folder / f"{name}.c").read_text().splitlines()
    counts: dict[tuple[str, int], Counts] = defaultdict(Counts)
    (file,) = [file for file in json.loads(said)["files"] if file["file"].endswith(f"{name}.c")]
    for line in file["lines"]:
        generated = re.match(r"s\d+_", line.get("function_name", ""))
        if name == "main" and not generated:
            continue  # what drives it
        shown = text[line["line_number"] - 1].strip()
        key = re.sub(r"\d+", "#", shown) if generated else shown
        taken = [branch["count"] for branch in line["branches"]]
        entry = counts[key, len(taken) if generated else line["line_number"]]
        entry.lines += line["count"]
        entry.branches = [a + b for a, b in zip(entry.branches or [0] * len(taken), taken, strict=True)]
    return counts


@pytest.mark.parametrize("name", ["main", *SOURCES])
def test_every_line_is_executed_and_every_branch_taken_both_ways(
    counted: dict[str, dict[tuple[str, int], Counts]], name: str
) -> None:
    lines = counted[name]
    assert len(lines) > 20
    assert [key for key, entry in lines.items() if entry.lines == 0] == []
    assert [key for key, entry in lines.items() if 0 in entry.branches] == []
