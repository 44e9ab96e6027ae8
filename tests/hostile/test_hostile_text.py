# SPDX-License-Identifier: MIT
"""Texts of a champion that would leave their place in what is generated: comments, strings, templates, manifests, pages."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from bitneat.champion import Champion, EnvironmentSpec, load, save_pickle
from bitneat.cli.main import main
from bitneat.codegen.package.files import KINDS
from bitneat.native.compiler import host_compiler
from tests.faults.scenarios import TINY

PLANT = (
    'PLANT"; */ int PLANT; /* \n#error "PLANT"\n{{ PLANT }}{{7*7}}{% PLANT %} ${PLANT} $(PLANT) `PLANT` \\\n??/\n'
    "<PLANT> 'PLANT' %PLANT% @PLANT@ \x1b]0;PLANT\x07 \u2028PLANT \u202ePLANT\x00"
)
FILE_NAME = 'PLANT"*{{7*7}}.pkl'
SAFE = re.compile(r"[`\"]?[A-Za-z0-9 ._:/-]*")
"""A template's own mark may open the text."""


@pytest.fixture
def champion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With planted text wherever a champion has text."""
    monkeypatch.chdir(tmp_path)
    tiny = load(TINY)
    provenance = {"tool": PLANT, PLANT.replace("\x00", ""): PLANT, "config": PLANT, "selection": {"mean": PLANT}}
    spec = EnvironmentSpec(PLANT, {PLANT: PLANT}, (PLANT,))
    save_pickle(Champion(tiny.controller, tiny.action, spec, provenance), tmp_path / FILE_NAME)
    return tmp_path / FILE_NAME


def check(files: dict[str, str]) -> None:
    """Planted text may stand there only where it is of harmless characters up to the end of its line or string."""
    planted = 0
    for name, text in files.items():
        assert text.isascii(), name
        assert "49" not in re.findall(r"PLANT[^\n]{0,60}", text), name
        for found in re.finditer("PLANT", text):
            around = text[max(found.start() - 1, 0) : found.end() + 1]
            assert SAFE.fullmatch(around), f"{name}: {text[max(found.start() - 40, 0) : found.end() + 40]!r}"
            planted += 1
        for opened in ("#error", "`PLANT`", "{{", "{%", "${PLANT", "$(PLANT", "\x1b", "??/"):
            assert opened not in text, f"{name}: {opened}"
    assert planted, "no text of the champion is in any file: what is tested here?"


@pytest.mark.parametrize("style", ["unrolled", "table"])
def test_text_of_a_champion_stays_in_its_comment(champion: Path, style: str) -> None:
    assert main(["codegen", str(champion), "-o", "walker.c", "--style", style, "--selftest"]) == 0
    sources = sorted(Path().glob("walker*.c"))
    check({path.name: path.read_text() for path in (*sources, Path("walker.h"))})
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wcomment", "-Wtrigraphs", "-Werror", "-c"]
    for source in sources:
        subprocess.run([*host_compiler().command, *strict, str(source), "-o", "out.o"], check=True)


@pytest.mark.parametrize("kind", KINDS)
def test_text_of_a_champion_stays_in_its_place_in_a_package(champion: Path, kind: str) -> None:
    assert (
        main(["codegen", str(champion), "-o", "lib", "--name", "legs", "--style", "unrolled", "--package", kind]) == 0
    )
    texts = {str(path): path.read_text() for path in Path("lib").rglob("*") if path.is_file()}
    # Templates of other tools have signs of their own, but none with planted text.
    check({name: text for name, text in texts.items() if name.endswith((".c", ".h", ".ino", ".md"))})
    for name, text in texts.items():
        for line in text.splitlines():
            for found in re.finditer("PLANT", line):
                assert SAFE.fullmatch(line[max(found.start() - 1, 0) : found.end() + 1]), f"{name}: {line}"
        if name.endswith(".json"):
            json.loads(text)


@pytest.mark.parametrize("command", ["verify", "render", "report", "polish", "quantize"])
def test_text_of_a_champion_controls_no_terminal(
    champion: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = {"render": "x.gif", "report": "x.html", "polish": "x", "quantize": "x.pkl"}
    arguments = ["-o", outputs[command]] if command in outputs else []
    assert main([command, str(champion), *arguments]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert all(line.isprintable() for line in (said.err + said.out).splitlines())


@pytest.mark.parametrize(
    "name",
    ["PLANT*/", "a b", "../up", "/etc/x", "x;y", "", "é", "int", "a\nb", "${x}", "{{7*7}}", "a" * 41, "-x", "__x"],
)
def test_no_name_reaches_c_that_is_no_identifier(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["codegen", str(TINY), "-o", "x.c", "--style", "unrolled", f"--name={name}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())
