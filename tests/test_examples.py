# SPDX-License-Identifier: MIT
"""The committed champion: its files belong together, and what they claim holds."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.cli.main import main
from bitneat.codegen import generate, selftest
from bitneat.controller.packing import pack

WALKER = Path(__file__).parents[1] / "examples" / "walker"


def test_both_champion_files_hold_the_same() -> None:
    assert champions.load(WALKER / "champion.pkl") == champions.load(WALKER / "champion.json")


def test_the_generated_files_are_what_codegen_writes_today() -> None:
    champion = champions.load(WALKER / "champion.pkl")
    assert champion.environment is not None
    code = generate(
        champion.controller,
        "walker",
        action=champion.action,
        environment_id=champion.environment.id,
        header_name="walker.h",
    )
    assert (WALKER / "walker.c").read_text() == code.source
    assert (WALKER / "walker.h").read_text() == code.header
    assert (WALKER / "walker_selftest.c").read_text() == selftest(code, champion.controller)


def test_the_committed_c_passes_verify(tmp_path: Path) -> None:
    result = tmp_path / "verify.json"
    champion = str(WALKER / "champion.pkl")
    arguments = ["verify", champion, "--c", str(WALKER / "walker.c"), "--episodes", "2", "--json", str(result)]
    assert main(arguments) == 0
    report = json.loads(result.read_text())
    assert report["verdict"] == "pass"
    assert report["controller"]["ternary"]
    assert all(target["mismatches"] in (0, None) for target in report["targets"])


def test_an_edited_copy_fails(tmp_path: Path) -> None:
    for name in ("champion.pkl", "walker.h"):
        shutil.copy(WALKER / name, tmp_path)
    text = (WALKER / "walker.c").read_text()
    end = text.index("};")
    last = text.rindex("0x", 0, end) + 3
    (tmp_path / "walker.c").write_text(f"{text[:last]}{int(text[last], 16) ^ 1:x}{text[last + 1 :]}")
    assert main(["verify", str(tmp_path / "champion.pkl"), "--c", str(tmp_path / "walker.c"), "--episodes", "1"]) == 1


def test_the_page_tells_the_champions_own_numbers() -> None:
    champion = champions.load(WALKER / "champion.pkl")
    canonical = champion.controller.canonical
    held_out = champion.provenance["held_out"]
    page = (WALKER / "README.md").read_text()
    for claim in (
        f"{len(canonical.nodes)} nodes",
        f"{canonical.num_links} links",
        f"{len(pack(canonical))} bytes packed",
        f"{held_out['mean']:.1f} ± {held_out['std']:.1f}",
        f"{held_out['episodes']} episodes",
        champion.controller.sha256[:12],
    ):
        assert claim in page, claim


def test_the_history_has_a_row_for_each_generation() -> None:
    rows = list(csv.DictReader((WALKER / "history.csv").open()))
    generations = champions.load(WALKER / "champion.pkl").provenance["generations"]
    assert [int(row["generation"]) for row in rows] == list(range(generations))


@pytest.mark.parametrize("page", ["README.md"])
def test_the_page_shows_commands_that_exist(page: str) -> None:
    from bitneat.cli.main import COMMANDS

    shown = re.findall(r"^ {4}bitneat (\w+)", (WALKER / page).read_text(), re.MULTILINE)
    assert shown
    assert set(shown) <= set(COMMANDS)
