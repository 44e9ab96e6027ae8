# SPDX-License-Identifier: MIT
"""Commands that are killed, lose power, or find the disk full: what was there stays whole, and going on comes to the same bytes.

Every kill is a SIGKILL between two calls that change files, or in the middle of a write; see `tests.faults.warm`.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bitneat.native import compiler
from tests.faults.scenarios import ROOT, SCENARIOS

SHIM = Path(__file__).with_name("shim.c")
SEED = 20260727


@pytest.fixture(scope="session")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("shim") / "shim.so"
    command = [*compiler.host_compiler().command, "-shared", "-fPIC", "-O1", "-o", str(out), str(SHIM), "-ldl"]
    subprocess.run(command, check=True)
    return out


def trial(shim: Path, folder: Path, scenario: str, fault: str, sample: int, defect: str = "") -> dict[str, Any]:
    """Try a fault at so many points, 0 for all."""
    arguments = [scenario, str(folder), fault, str(sample), str(SEED), defect]
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.warm", *arguments],
        cwd=ROOT,
        env={**os.environ, "LD_PRELOAD": str(shim), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    print(f"{scenario}, {fault}: {result['tried']} of {result['points']} points, {result['calls']} calls")
    return result


# What a few seconds allow; the long test tries every point of every scenario.
@pytest.mark.parametrize(
    ("scenario", "fault", "sample"),
    [
        ("evolve", "kill", 8),
        ("evolve --config", "kill", 3),
        ("linear", "kill", 4),
        ("codegen --package again", "kill", 3),
        ("evolve", "power", 5),
        ("evolve", "errors", 4),
    ],
)
def test_a_fault_loses_nothing(shim: Path, tmp_path: Path, budget: int, scenario: str, fault: str, sample: int) -> None:
    result = trial(shim, tmp_path, scenario, fault, sample * budget)
    assert result["tried"] >= min(sample, result["points"]) > 0
    assert not result["failures"], "\n".join(result["failures"])


@pytest.mark.long
@pytest.mark.parametrize("fault", ["kill", "power", "error", "errors", "interrupt", "short"])
def test_a_fault_at_any_point_loses_nothing(shim: Path, tmp_path: Path, fault: str) -> None:
    total, failures = 0, []
    for number, (name, scenario) in enumerate(SCENARIOS.items()):
        if fault != "kill" and not scenario.alone:
            continue
        folder = tmp_path / str(number)
        folder.mkdir()
        result = trial(shim, folder, name, fault, 0)
        assert result["tried"] == result["points"] > 0
        total += result["tried"]
        failures += [f"{name}: {failure}" for failure in result["failures"]]
    print(f"{fault}: {total} points")
    assert not failures, "\n".join(failures)
    assert fault != "kill" or total >= 1000


@pytest.mark.parametrize(
    ("defect", "fault", "sign"),
    [("in place", "kill", "neither the old nor a new one"), ("unsynced", "power", "neither the old nor a new one")],
)
def test_what_is_written_in_place_or_unsynced_is_found(
    shim: Path, tmp_path: Path, defect: str, fault: str, sign: str
) -> None:
    failures = trial(shim, tmp_path, "linear", fault, 12, defect)["failures"]
    assert any(sign in failure for failure in failures), failures


TEMPORARY_ONLY = {
    "bitneat/codegen/generate.py",
    "bitneat/verify/cfile.py",
    "bitneat/verify/faults.py",
    "bitneat/verify/targets/image.py",
}
"""Modules that write into folders of their own, which are gone when they are done."""
WRITERS = {"bitneat/files.py", "bitneat/native/build.py"}
"""The modules that know how to write."""


def test_nothing_is_written_but_by_the_module_that_writes_whole_files() -> None:
    found = set()
    for path in sorted((ROOT / "bitneat").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and _writes(node):
                found.add(str(path.relative_to(ROOT)))
    assert WRITERS <= found <= TEMPORARY_ONLY | WRITERS


def _writes(call: ast.Call) -> bool:
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name in ("write_text", "write_bytes", "copyfile", "copytree"):
        return True
    modes = [argument.value for argument in call.args if isinstance(argument, ast.Constant)]
    return name in ("open", "fdopen") and any(
        isinstance(mode, str) and set(mode) & set("wax+") and len(mode) < 4 for mode in modes
    )
