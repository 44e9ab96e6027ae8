# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bitneat.cli.main import main


@pytest.mark.parametrize(("name", "magic"), [("a.svg", b"<?xml"), ("A.PNG", b"\x89PNG")])
def test_activations_are_drawn_in_the_format_that_the_name_says(
    name: str, magic: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    assert main(["plot", "activations", "-o", str(path), "--frac-bits", "4"]) == 0
    assert path.read_bytes().startswith(magic)
    assert capsys.readouterr().out == f"wrote {path}\n"


@pytest.mark.parametrize("name", ["activations", "a.pdf", "svg"])
def test_another_format_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    assert main(["plot", "activations", "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"bitneat: {path}: expected a name that ends in .svg or .png\n"
    assert not path.exists()


@pytest.mark.parametrize("value", ["3", "13", "x"])
def test_frac_bits_are_checked(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", "activations", "-o", "a.svg", "--frac-bits", value]) == 2
    assert "4..12" in capsys.readouterr().err


def test_without_matplotlib_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["plot", "activations", "-o", str(tmp_path / "a.svg")]) == 2
    assert capsys.readouterr().err == "bitneat: plot: Matplotlib is not installed; pip install bitneat[plot]\n"


def test_a_folder_that_is_not_there_is_an_error_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "missing" / "a.svg"
    assert main(["plot", "activations", "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"bitneat: {path}: cannot write: No such file or directory\n"


def test_the_settings_of_the_user_make_no_difference(tmp_path: Path) -> None:
    rc = tmp_path / "matplotlibrc"
    rc.write_text("font.size: 30\nlines.linewidth: 9\nsvg.fonttype: none\nbackend: nowhere\n", encoding="ascii")
    contents = set()
    for number, extra in enumerate(({}, {"MATPLOTLIBRC": str(rc), "TZ": "Asia/Tokyo", "LANG": "C"})):
        path = tmp_path / f"{number}.svg"
        command = [sys.executable, "-m", "bitneat", "plot", "activations", "-o", str(path)]
        subprocess.run(command, check=True, env=os.environ | extra, capture_output=True)
        contents.add(path.read_bytes())
    assert len(contents) == 1
