# SPDX-License-Identifier: MIT
"""What a polishing run's folder refuses."""

import json
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.evolve.polish import Polish
from bitneat.evolve.polish_run import PolishFolder
from tests.evolve.test_polish import Landscape, settings
from tests.sealed import sealed


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("settings", "seconds", "soon"),
        ("settings", "seconds", -1),
        ("settings", "trigonometry", 5),
        ("search", "generation", -5),
        ("search", "generation", "1"),
    ],
)
def test_a_number_that_cannot_be_is_one_line(tmp_path: Path, part: str, key: str, value: object) -> None:
    folder = PolishFolder(tmp_path)
    asked = settings("reward", 1)
    polish = Polish(asked.start, asked.goal, asked.seed)
    polish.advance(Landscape())
    folder.save(asked, polish, [])
    folder.load()
    file = tmp_path / "polish.json"
    data = json.loads(file.read_text())
    data[part][key] = value
    file.write_text(sealed(data))
    with pytest.raises(BitneatError, match=r"polish\.json: damaged: [^\n]*$"):
        folder.load()


def test_the_champion_it_starts_from_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "champion.pkl").write_bytes(b"")
    with pytest.raises(BitneatError, match=r"champion\.pkl: exists and would be overwritten"):
        PolishFolder(tmp_path).create()
