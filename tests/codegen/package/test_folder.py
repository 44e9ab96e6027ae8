# SPDX-License-Identifier: MIT
"""Where a package may be written, and what becomes of what is there."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from bitneat.champion import Champion, save_pickle
from bitneat.cli.main import main
from bitneat.codegen.package import PackageError, write_package
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal

CONTROLLER = Controller((Input(), Input(0, 500)), (Node((Link(0), Link(1, sign=-1))),), (Signal(2),))
MANIFEST = json.dumps({"format": "bitneat-package", "kind": "plain", "name": "legs", "files": []})

LONG = MANIFEST + " " * (2**20 - len(MANIFEST) + 1)  # more than is read of one


@pytest.fixture(autouse=True)
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    save_pickle(Champion(CONTROLLER, BoxAction((-1.0,), (1.0,), (1,), "float32")), tmp_path / "champion.pkl")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(*options: str) -> int:
    return main(["codegen", "champion.pkl", *options])


def refused(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    assert command(*options) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    return text


def snapshot(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def test_an_empty_folder_is_filled_and_nothing_is_left_beside_it(working_folder: Path) -> None:
    (working_folder / "legs").mkdir()
    assert command("-o", "legs", "--package", "plain", "--json", "result.json") == 0
    assert sorted(path.name for path in working_folder.iterdir()) == ["champion.pkl", "legs", "result.json"]
    result = json.loads((working_folder / "result.json").read_text())
    assert result["package"] == "plain"
    assert all((working_folder / name).is_file() for name in result["files"])


@pytest.mark.parametrize(
    "content",
    [
        None,
        "{}",
        "[]",
        "no JSON",
        '{"format": "bitneat-package"}',
        "[" * 100_000,
        MANIFEST.replace("legs", "../legs"),
        LONG,
    ],
    ids=lambda content: None if content is None else content[:40],
)
def test_a_folder_that_is_no_package_is_left_alone(
    working_folder: Path, capsys: pytest.CaptureFixture[str], content: str | None
) -> None:
    folder = working_folder / "legs"
    folder.mkdir()
    (folder / "thesis.txt").write_text("mine")
    if content is not None:
        (folder / "bitneat-package.json").write_text(content)
    before = snapshot(folder)
    assert "legs: holds files but no package of bitneat" in refused(capsys, "-o", "legs", "--package", "plain")
    assert snapshot(folder) == before


def test_a_link_to_nowhere_is_no_free_place(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (working_folder / "legs").symlink_to(working_folder / "gone")
    assert "legs: a link to nowhere; expected" in refused(capsys, "-o", "legs", "--package", "plain")
    assert not (working_folder / "gone").exists()


def test_another_kind_or_name_is_left_alone(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("-o", "legs", "--package", "plain") == 0
    before = snapshot(working_folder / "legs")
    said = refused(capsys, "-o", "legs", "--package", "cmake")
    assert "holds the plain package of legs, not a cmake package of legs" in said
    assert "not a plain package of arms" in refused(capsys, "-o", "legs", "--package", "plain", "--name", "arms")
    assert snapshot(working_folder / "legs") == before


def test_renewing_removes_what_is_no_longer_made_and_keeps_the_users_own(working_folder: Path) -> None:
    (working_folder / "map.toml").write_text(
        "[[inputs]]\ninput = 0\ncounts = [0, 255]\nscale = 0.1\noffset = 0\n[[inputs]]\ninput = 1\nconstant = 0\n"
        "[[outputs]]\noutput = 0\nvalues = [-1, 1]\ncounts = [0, 255]\n"
    )
    assert command("-o", "legs", "--package", "plain", "--sensor", "map.toml") == 0
    (working_folder / "legs" / "src" / "mine.c").write_text("int mine;\n")
    (working_folder / "legs" / "README.md").write_text("an old one\n")
    assert (working_folder / "legs" / "src" / "legs_sensors.c").is_file()
    (working_folder / "legs" / "src" / "legs_sensors.h").unlink()  # what is not there need not be removed
    assert command("-o", "legs", "--package", "plain") == 0
    names = {path.name for path in (working_folder / "legs" / "src").iterdir()}
    assert names == {"legs.c", "legs.h", "legs_selftest.c", "legs_selftest.h", "mine.c"}
    assert "SHA-256" in (working_folder / "legs" / "README.md").read_text()


def test_a_manifest_cannot_make_it_delete_anything_elsewhere(working_folder: Path) -> None:
    victim = working_folder / "victim.txt"
    victim.write_text("mine")
    folder = working_folder / "legs"
    folder.mkdir()
    files = ["../victim.txt", str(victim), "", ".", "src/../../victim.txt", "gone.txt"]
    (folder / "gone.txt").touch()
    (folder / "bitneat-package.json").write_text(MANIFEST.replace("[]", json.dumps(files)))
    assert command("-o", "legs", "--package", "plain") == 0
    assert victim.read_text() == "mine"
    assert not (folder / "gone.txt").exists()


def test_a_pipe_in_the_place_of_a_manifest_is_not_waited_for(
    working_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (working_folder / "legs").mkdir()
    os.mkfifo(working_folder / "legs" / "bitneat-package.json")
    assert command("-o", "legs", "--package", "plain") == 2
    assert "holds files but no package of bitneat" in capsys.readouterr().err


@pytest.mark.parametrize("link", ["src", "src/legs.c", "README.md"])
def test_a_link_in_a_package_leads_nowhere(working_folder: Path, capsys: pytest.CaptureFixture[str], link: str) -> None:
    assert command("-o", "legs", "--package", "plain") == 0
    folder, victim = working_folder / "legs", working_folder / "victim"
    place = folder / link
    if place.is_dir():
        place.rename(victim)
        manifest = json.loads((folder / "bitneat-package.json").read_text())
        (victim / "mine.txt").write_text("mine")
        manifest["files"].append("src/mine.txt")  # which renewing would delete
        (folder / "bitneat-package.json").write_text(json.dumps(manifest))
    else:
        place.unlink()
        victim.write_text("mine")
    place.symlink_to(victim)
    before = snapshot(working_folder)
    assert f"{Path('legs') / link}: a link" in refused(capsys, "-o", "legs", "--package", "plain")
    assert snapshot(working_folder) == before


def test_a_new_folder_is_on_the_disk_before_the_command_ends(
    working_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = []
    monkeypatch.setattr(
        "bitneat.codegen.package.folder.sync_folder", lambda path: there.append((path, (path / "legs").is_dir()))
    )
    assert command("-o", "legs", "--package", "plain") == 0
    assert there == [(working_folder, True)]


def test_missing_folders_above_a_package_are_made(working_folder: Path) -> None:
    assert command("-o", "libraries/own/legs", "--package", "arduino") == 0
    assert [path.name for path in (working_folder / "libraries" / "own").iterdir()] == ["legs"]
    assert (working_folder / "libraries" / "own" / "legs" / "src" / "legs.c").is_file()


def test_a_new_folder_that_cannot_be_finished_does_not_appear(
    working_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def disk_full(path: Path, content: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bitneat.codegen.package.folder.write_atomic", disk_full)
    with pytest.raises(PackageError, match="legs: cannot write: No space left on device"):
        write_package(working_folder / "legs", "plain", "legs", {"a.c": "int a;\n"})
    assert [path.name for path in working_folder.iterdir()] == ["champion.pkl"]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["-o", "champion.pkl", "--package", "plain", "--name", "legs"], "would overwrite CHAMPION champion.pkl"),
        (["-o", "some.txt", "--package", "plain", "--name", "legs"], "some.txt: cannot be a package's folder"),
        (["-o", "champion.pkl/lib/legs", "--package", "plain"], "champion.pkl/lib"),
        (["-o", "9legs", "--package", "plain"], "9legs (choose another with --name)"),
        (["-o", "my-legs", "--package", "plain"], "no C identifier"),
        (["-o", "Arduino", "--package", "arduino"], "Arduino.h is a header of Arduino, which it would hide in arduino"),
        (["-o", "legs", "--name", "wire", "--package", "platformio"], "wire.h is a header of Arduino, which it would"),
        (["-o", "test", "--package", "cmake"], "'test' is a target of its own in cmake"),
        (["-o", "legs", "--package", "cmake", "--name", "Install"], "'Install' is a target of its own in cmake"),
        (["-o", "legs", "--package", "plain", "--selftest"], "--selftest: every package has its self-test"),
        (["-o", "legs", "--package", "deb"], "--package"),
        (["-o", "legs", "--package", "plain", "--json", "champion.pkl"], "would overwrite CHAMPION champion.pkl"),
    ],
)
def test_bad_input_is_one_line(
    working_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], why: str
) -> None:
    (working_folder / "some.txt").touch()
    assert why in refused(capsys, *options)
    assert sorted(path.name for path in working_folder.iterdir()) == ["champion.pkl", "some.txt"]
