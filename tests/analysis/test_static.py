# SPDX-License-Identifier: MIT
"""gcc's and clang's analysers and Cppcheck have nothing to say of the C; docs/misra.md argues each deviation from MISRA C."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.champion import load
from bitneat.codegen import generate
from bitneat.controller import DiscreteAction
from bitneat.native.data import runtime_dir
from tests.analysis.controllers import CHAMPIONS, STYLES, one_of_each, rich_controller

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "misra.md"
CHECKS = "-analyzer-checker=core,deadcode,security,unix,nullability,alpha.core,alpha.security.ArrayBoundV2"


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the runtime and generated C of every kind: both styles, with and without memory, guard and choice."""
    folder = tmp_path_factory.mktemp("sources")
    for path in [*(runtime_dir() / "src").iterdir(), runtime_dir() / "include" / "bitneat" / "runtime.h"]:
        shutil.copy(path, folder)
    (folder / "bitneat").mkdir()
    shutil.move(folder / "runtime.h", folder / "bitneat" / "runtime.h")
    for style in STYLES:
        generate(load(CHAMPIONS["champions-tiny"]).controller, f"tiny_{style}", style).write(folder)
        generate(rich_controller(1), f"memory_{style}", style).write(folder)
        for name, controller in (("each", one_of_each(8)), ("guarded", rich_controller(2))):
            choice = DiscreteAction(len(controller.outputs), 1)
            generate(controller, f"{name}_{style}", style, guard=True, action=choice).write(folder)
    return folder


def said(command: list[str], folder: Path) -> str:
    """What an analyser says of each C file of a folder."""
    assert shutil.which(command[0]), f"{command[0]} is missing: run tools/install-debian-tools.sh"
    texts = []
    for path in sorted(folder.glob("*.c")):
        done = subprocess.run(
            [*command, "-std=c99", "-I.", path.name, "-o", "/dev/null"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        texts.append(done.stderr if done.stderr or not done.returncode else f"{path.name}: exit {done.returncode}\n")
    return "".join(texts)


def cppcheck(folder: Path, *options: str) -> str:
    """What Cppcheck says of a folder."""
    assert shutil.which("cppcheck"), "cppcheck is missing: run tools/install-debian-tools.sh"
    command = ["cppcheck", "--quiet", "--std=c99", "--template={file}:{line}: {id}: {message}", *options, "-I.", "."]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


GCC = ["gcc", "-c", "-O1", "-Wall", "-Wextra", "-fanalyzer"]
CLANG = ["clang", "--analyze", "-Xclang", CHECKS]


def test_gccs_analyser_has_nothing_to_say(sources: Path) -> None:
    assert said(GCC, sources) == ""


def test_clangs_analyser_has_nothing_to_say(sources: Path) -> None:
    assert said(CLANG, sources) == ""


def test_cppcheck_has_nothing_to_say(sources: Path) -> None:
    assert cppcheck(sources, "--enable=warning,style,performance,portability") == ""


PLANTED = """
#include <stdint.h>
#include <stdlib.h>
int16_t planted(int n);
int16_t planted(int n)
{
    int16_t *memory = malloc(4);
    int16_t local[2];
    if (memory == NULL) {
        return 0;
    }
    memory[0] = 1;
    free(memory);
    return (int16_t)(n > 0 ? memory[0] : local[1]);
}
"""


def test_what_is_planted_is_found_by_each(tmp_path: Path) -> None:
    (tmp_path / "planted.c").write_text(PLANTED)
    assert "use after" in said(GCC, tmp_path)
    assert "garbage value" in said(CLANG, tmp_path)
    assert "uninitvar" in cppcheck(tmp_path, "--enable=warning")


def deviations(folder: Path) -> set[str]:
    """The rules of MISRA C:2012 that the C of a folder deviates from, by Cppcheck's addon."""
    return set(re.findall(r"misra-c2012-(\d+\.\d+)", cppcheck(folder, "--addon=misra")))


def test_every_deviation_from_misra_is_argued(sources: Path) -> None:
    argued = re.findall(r"^\| D\d+ \| (\d+\.\d+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(set(argued)) == len(argued)
    found = deviations(sources)
    assert len(found) > 5
    assert found - set(argued) == set()


def test_a_planted_deviation_from_misra_is_seen(tmp_path: Path) -> None:
    (tmp_path / "planted.c").write_text(PLANTED)
    assert "21.3" in deviations(tmp_path)
