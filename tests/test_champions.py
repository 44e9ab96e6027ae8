# SPDX-License-Identifier: MIT
"""The committed champions: what their page claims is what their files say, and what the simulators say of them again."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bitneat import champion as champions
from bitneat.champion import Champion
from bitneat.cli.main import main
from bitneat.controller.packing import pack
from bitneat.evolve.randomness import report_seeds
from bitneat.sim.walker import run_episodes

FOLDER = Path(__file__).parents[1] / "examples" / "champions"
NAMES = sorted(path.stem for path in FOLDER.glob("*.pkl"))


def _load(name: str) -> Champion:
    return champions.load(FOLDER / f"{name}.pkl")


def test_there_are_champions() -> None:
    assert {"tiny", "walker"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_both_files_hold_the_same_ternary_controller(name: str) -> None:
    champion = _load(name)
    assert champion == champions.load(FOLDER / f"{name}.json")
    assert champion.controller.is_ternary


@pytest.mark.parametrize("name", NAMES)
def test_the_page_tells_their_own_numbers(name: str) -> None:
    champion = _load(name)
    score = champion.provenance["held_out"]
    controller = champion.controller
    cells = (
        f"| {name} |",
        f"| {score['mean']:.1f} ± {score['std']:.1f} |",
        f"| {score['min']:.1f} |",
        f"| {len(controller.nodes)} | {controller.num_links} | {len(pack(controller))} |",
        controller.sha256[:12],
    )
    lines = (FOLDER / "README.md").read_text().splitlines()
    assert any(all(cell in line for cell in cells) for line in lines), cells


@pytest.mark.parametrize("name", NAMES)
def test_the_score_is_reproduced_and_others_agree_with_it(name: str) -> None:
    champion = _load(name)
    score = champion.provenance["held_out"]
    rewards, _ = run_episodes([champion.controller], report_seeds(100), champion.provenance["max_steps"])
    assert float(rewards.min()) == score["min"]
    assert math.isclose(float(np.mean(rewards)), score["mean"], rel_tol=1e-12)
    # Rare falls do not show in a hundred episodes: the page says so, and gives the figures of more.
    others, _ = run_episodes([champion.controller], range(2**31 - 5000, 2**31 - 4000), champion.provenance["max_steps"])
    assert float(np.mean(others)) > 300
    assert float(np.mean(others >= 300)) > 0.97


@pytest.mark.parametrize("name", NAMES)
def test_the_generated_c_agrees_in_gymnasium(name: str, tmp_path: Path) -> None:
    result = tmp_path / "verify.json"
    assert main(["codegen", str(FOLDER / f"{name}.pkl"), "-o", str(tmp_path / f"{name}.c")]) == 0
    arguments = ["verify", str(FOLDER / f"{name}.pkl"), "--c", str(tmp_path / f"{name}.c"), "--episodes", "1"]
    assert main([*arguments, "--json", str(result)]) == 0
    report = json.loads(result.read_text())
    assert report["verdict"] == "pass"
    assert report["reward"]["mean"] > 280
