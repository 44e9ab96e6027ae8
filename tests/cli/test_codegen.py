# SPDX-License-Identifier: MIT
"""``bitneat codegen``: what it writes, and what it says to bad input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.bench.network import champion_of
from bitneat.champion import Champion, save_json, save_pickle
from bitneat.cli.main import main
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal

CONTROLLER = Controller((Input(), Input(0, 500)), (Node((Link(0), Link(1, sign=-1))),), (Signal(2),))
CHAMPION = Champion(CONTROLLER, BoxAction((-1.0,), (1.0,), (1,), "float32"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    save_pickle(CHAMPION, tmp_path / "champion.pkl")
    save_json(CHAMPION, tmp_path / "champion.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["codegen", *arguments]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    return text


def test_source_and_header_are_written_and_the_same_each_time(folder: Path) -> None:
    assert main(["codegen", "champion.pkl", "-o", "walker.c", "--json", "result.json"]) == 0
    first = (folder / "walker.c").read_bytes(), (folder / "walker.h").read_bytes()
    assert main(["codegen", "champion.json", "-o", "walker.c"]) == 0
    assert ((folder / "walker.c").read_bytes(), (folder / "walker.h").read_bytes()) == first
    result = json.loads((folder / "result.json").read_text())
    assert result["sha256"] == CONTROLLER.sha256
    assert result["files"] == ["walker.h", "walker.c"]


def test_the_file_name_is_the_name_unless_one_is_given(folder: Path) -> None:
    assert main(["codegen", "champion.pkl", "-o", "my-legs.c", "--name", "legs", "--selftest", "--style", "table"]) == 0
    assert '#include "my-legs.h"' in (folder / "my-legs.c").read_text()
    assert "void legs_step(" in (folder / "my-legs.h").read_text()
    assert '#include "my-legs.h"' in (folder / "my-legs_selftest.c").read_text()


def test_missing_folders_are_made_when_all_else_is_well(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = ["-o", "build/c/legs.c", "--name", "legs", "--style", "table", "--guard", "--selftest"]
    assert "missing.pkl" in refused(capsys, "missing.pkl", *example)
    assert not (folder / "build").exists()
    assert main(["codegen", "champion.pkl", *example]) == 0
    assert sorted(path.name for path in (folder / "build" / "c").iterdir()) == ["legs.c", "legs.h", "legs_selftest.c"]


def test_a_folder_with_the_name_of_a_source_is_said_to_be_one(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "k.c").mkdir()
    assert "k.c: is a folder, expected a file name" in refused(capsys, "champion.pkl", "-o", "k.c")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["champion.pkl", "-o", "walker.txt"], "ends in .c"),
        (["champion.pkl", "-o", "int.c"], "reserved word"),
        (["champion.pkl", "-o", "stdint.c"], "-o: stdint.h is a header of the C library, which it would hide"),
        (["champion.pkl", "-o", "Limits.c", "--name", "legs"], "-o: Limits.h is a header of the C library"),
        (["champion.pkl", "-o", "math", "--package", "plain"], "math.h is a header of the C library"),
        (["champion.pkl", "-o", "linux.c"], "'linux' is a macro that some compilers define"),
        (["champion.pkl", "-o", "walker.c", "--name", "typeof"], "--name: 'typeof' is a reserved word"),
        (["champion.pkl", "-o", "walker.c", "--name", ""], "argument --name: expected a value, got an empty one"),
        (["champion.pkl", "-o", "walker.c", "--name", "9"], "no C identifier"),
        (["champion.pkl", "-o", 'a"b.c', "--name", "w"], "cannot name C files"),
        (["champion.pkl", "-o", "champion.pkl/build/walker.c"], "champion.pkl/build: cannot write: Not a directory"),
        (["nothing.pkl", "-o", "walker.c"], "nothing.pkl"),
        (["champion.pkl", "-o", "walker.c", "--json", "walker.h"], "would overwrite what -o writes"),
        (["champion.pkl", "-o", "walker.c", "--style", "fast"], "--style"),
        (["champion.pkl"], "-o"),
    ],
)
def test_bad_input_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], why: str
) -> None:
    assert why in refused(capsys, *arguments)
    assert not (folder / "walker.c").exists()


def test_a_controller_without_a_path_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    constant = Controller((Input(),), (Node((), 9),), (Signal(1),))
    save_pickle(Champion(constant, CHAMPION.action), folder / "dead.pkl")
    assert "no path from any input to an output" in refused(capsys, "dead.pkl", "-o", "walker.c")


def test_a_file_in_the_way_of_a_folder_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "busy.c").mkdir()
    assert "busy.c" in refused(capsys, "champion.pkl", "-o", "busy.c")


def test_the_walkers_hundred_links_become_a_table(folder: Path) -> None:
    from bitneat.bench.network import hundred_links

    save_pickle(champion_of(hundred_links()), folder / "hundred.pkl")
    assert main(["codegen", "hundred.pkl", "-o", "walker.c"]) == 0
    assert "walker_body" in (folder / "walker.c").read_text()
    assert champions.load("hundred.pkl").controller.num_links == 100
