# SPDX-License-Identifier: MIT
"""A result never takes the place of what a command reads, nor of another result."""

import os
from pathlib import Path

import pytest

from bitneat.cli.main import main


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Files that are all there, and hold nothing that any command could use: none may be read that far."""
    monkeypatch.chdir(tmp_path)
    for name in (
        "t.json",
        "w.c",
        "w.h",
        "f.pkl",
        "w.npz",
        "m.toml",
        "m.c",
        "r.html",
        "r.gif",
        "r.svg",
        "h.csv",
        "e.ini",
    ):
        Path(name).write_text(f"the {name}")
    Path("link.json").symlink_to("t.json")
    os.link("t.json", "hard.json")
    return tmp_path


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("size t.json --json t.json", "--json t.json: would overwrite CHAMPION t.json"),
        ("size t.json --json ./t.json", "--json t.json: would overwrite CHAMPION t.json"),
        ("size t.json --json link.json", "--json link.json: would overwrite CHAMPION t.json"),
        ("size t.json --json hard.json", "--json hard.json: would overwrite CHAMPION t.json"),
        ("verify t.json --json t.json", "--json t.json: would overwrite CHAMPION t.json"),
        ("prove t.json --json t.json", "--json t.json: would overwrite CHAMPION t.json"),
        ("prove t.json --c w.c --json w.h", "--json w.h: would overwrite the header of --c w.h"),
        ("verify t.json --c w.c --json w.c", "--json w.c: would overwrite --c w.c"),
        ("verify t.json --c w.c --json w.h", "--json w.h: would overwrite the header of --c w.h"),
        ("render t.json -o q.gif --json t.json", "--json t.json: would overwrite CHAMPION t.json"),
        ("report t.json -o q.html --json t.json", "--json t.json: would overwrite RUN|CHAMPION t.json"),
        ("report f.pkl -o q.html --compare t.json --json t.json", "--json t.json: would overwrite --compare t.json"),
        ("report f.pkl -o r.html --compare r.html", "-o r.html: would overwrite --compare r.html"),
        ("quantize f.pkl -o g.pkl --to int --json f.pkl", "--json f.pkl: would overwrite CHAMPION f.pkl"),
        ("import w.npz -o g.pkl --json w.npz", "--json w.npz: would overwrite FILE w.npz"),
        ("import w.npz -o w.npz", "-o w.npz: would overwrite FILE w.npz"),
        ("codegen t.json -o g.c --sensor m.toml --json m.toml", "--json m.toml: would overwrite --sensor m.toml"),
        ("codegen w.c -o w.c", "-o w.c: would overwrite CHAMPION w.c"),
        ("codegen w.h -o w.c", "-o w.h: would overwrite CHAMPION w.h"),
        ("codegen t.json -o m.c --sensor m.c", "-o m.c: would overwrite --sensor m.c"),
        ("report r.html -o r.html", "-o r.html: would overwrite RUN|CHAMPION r.html"),
        ("render r.gif -o r.gif", "-o r.gif: would overwrite CHAMPION r.gif"),
        ("plot network r.svg -o r.svg", "-o r.svg: would overwrite CHAMPION r.svg"),
        ("plot fitness h.csv r.svg -o r.svg", "-o r.svg: would overwrite RUN r.svg"),
        ("evolve --config e.ini --json e.ini", "--json e.ini: would overwrite --config e.ini"),
    ],
)
def test_what_is_read_is_not_written(line: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_text() for path in folder.iterdir()}
    assert main(line.split()) == 2
    assert capsys.readouterr() == ("", f"bitneat: {says}, which is read; expected another name\n")
    assert {path.name: path.read_text() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("render t.json -o q.gif --json q.gif", "--json q.gif -o"),
        ("render t.json -o r.gif --json ./r.gif", "--json r.gif -o"),
        ("report t.json -o q.html --json q.html", "--json q.html -o"),
        ("quantize f.pkl -o g.pkl --to int --json g.pkl", "--json g.pkl -o"),
        ("import w.npz -o g.pkl --json g.pkl", "--json g.pkl -o"),
        ("codegen t.json -o g.c --json g.c", "--json g.c -o"),
        ("codegen t.json -o g.c --json g.h", "--json g.h -o"),
        ("codegen t.json -o g.c --selftest --json g_selftest.c", "--json g_selftest.c -o"),
        ("codegen t.json -o g.c --sensor m.toml --json g_sensors.h", "--json g_sensors.h -o"),
    ],
)
def test_two_results_are_two_files(line: str, names: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    del folder
    assert main(line.split()) == 2
    second, name, first = names.split()
    expected = f"bitneat: {second} {name}: would overwrite what {first} writes; expected another name\n"
    assert capsys.readouterr() == ("", expected)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "report run -o q.html --json run/champion.pkl",
            "--json run/champion.pkl: would overwrite a file of the run RUN|CHAMPION run",
        ),
        ("report run -o run/history.csv", "-o run/history.csv: would overwrite a file of the run RUN|CHAMPION run"),
        (
            "report run -o q.html --json way/run.json",
            "--json way/run.json: would overwrite a file of the run RUN|CHAMPION run",
        ),
        (
            "evolve --resume run --json run/checkpoints/generation-00000001.json",
            "--json run/checkpoints/generation-00000001.json: would overwrite a file of the run --resume run",
        ),
        ("evolve -o new --json new/champion.json", "--json new/champion.json: would overwrite what -o writes"),
        ("polish t.json -o new --json new/front/1.pkl", "--json new/front/1.pkl: would overwrite what -o writes"),
    ],
)
def test_a_run_s_own_files_are_kept(line: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "run").mkdir()
    (folder / "run" / "run.json").write_text("the run")
    (folder / "way").symlink_to("run")
    assert main(line.split()) == 2
    assert capsys.readouterr() == ("", f"bitneat: {says}; expected another name\n")
    assert [path.read_text() for path in (folder / "run").iterdir()] == ["the run"]
    assert not (folder / "new").exists()


@pytest.mark.parametrize(
    "line", ["report run -o run/page.html --json run/page.json", "size t.json --json run/size.json"]
)
def test_other_names_in_a_run_s_folder_are_free(line: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "run").mkdir()
    assert main(line.split()) == 2
    assert "would overwrite" not in capsys.readouterr().err  # but there is no champion


def test_a_device_may_be_named_twice(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    del folder
    assert main(["size", "/dev/null", "--json", "/dev/null"]) == 2
    assert "would overwrite" not in capsys.readouterr().err
