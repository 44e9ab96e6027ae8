# SPDX-License-Identifier: MIT
"""The committed champions: what their page claims is what their files say, and what the simulators say of them again."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest

from bitneat.champion import load
from bitneat.cli.main import main
from bitneat.controller.packing import pack, unpack
from bitneat.report.pareto import collect
from bitneat.sim.bipedal import is_walker
from tools.champions import ENVIRONMENTS, FOLDER, PAGE, champions, evaluator, front_csv, report_table, row, table

ASKED = {
    "BipedalWalker-v3": 300.0,
    "BipedalWalkerHardcore-v3": 100.0,
    "LunarLander-v3": 200.0,
    "CartPole-v1": 475.0,
    "Acrobot-v1": -100.0,
    "Pendulum-v1": -160.0,
    "MountainCarContinuous-v0": 90.0,
}
"""Mean over a hundred episodes that each must have."""
CHAMPIONS = champions()
WALKERS = [name for name, one in CHAMPIONS.items() if one.environment and one.environment.id == ENVIRONMENTS[0]]
NATIVE = [name for name, one in CHAMPIONS.items() if one.environment and is_walker(one.environment)]
CLAIMS = {
    cells[0]: cells
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.count(" | ") == 8 and (cells := line.strip("| ").split(" | "))
}
"""The page's table of scores, by champion."""


@pytest.mark.parametrize("name", CHAMPIONS)
def test_a_champion_has_the_score_in_its_file_and_on_the_page(name: str) -> None:
    champion = CHAMPIONS[name]
    assert load(FOLDER / f"{name}.json") == champion
    found = row(name, champion, 0)  # refuses another score than that of the file
    assert found.report.mean >= ASKED[found.environment]
    controller = champion.controller
    assert controller == controller.canonical == unpack(pack(controller))
    assert controller.is_ternary
    assert report_table([found]).splitlines()[-1] in PAGE.read_text(encoding="utf-8").splitlines()
    fixed = table([found]).split(" | ")[-4:]  # what no episode decides
    assert CLAIMS[name][-4:] == [cell.strip(" |\n") for cell in fixed]


@pytest.mark.parametrize("name", NATIVE)
def test_what_is_claimed_is_found_on_other_seeds(name: str) -> None:
    champion = CHAMPIONS[name]
    mean, std = map(float, CLAIMS[name][2].split(" ± "))
    found = evaluator(champion).evaluate([champion.controller], range(2**31 - 5000, 2**31 - 4000))[0]
    # Of the difference of a mean over a thousand and one over four thousand, four standard errors.
    assert abs(sum(e.reward for e in found) / 1000 - mean) < 4 * std * math.sqrt(1 / 1000 + 1 / 4000)


@pytest.mark.parametrize("name", WALKERS)
def test_walkers_seldom_fall_on_seeds_that_nothing_was_chosen_on(name: str) -> None:
    champion = CHAMPIONS[name]
    # Rare falls do not show in a hundred episodes: the page says so, and gives the figures of more.
    episodes = evaluator(champion).evaluate([champion.controller], range(2**31 - 5000, 2**31 - 4000))[0]
    assert sum(e.reward for e in episodes) / len(episodes) > 300
    assert sum(e.reward >= 300 for e in episodes) / len(episodes) > 0.97


@pytest.mark.parametrize("name", CHAMPIONS)
def test_the_generated_c_agrees_in_gymnasium(name: str, tmp_path: Path) -> None:
    result = tmp_path / "verify.json"
    assert main(["codegen", str(FOLDER / f"{name}.pkl"), "-o", str(tmp_path / f"{name}.c")]) == 0
    arguments = ["verify", str(FOLDER / f"{name}.pkl"), "--c", str(tmp_path / f"{name}.c"), "--episodes", "1"]
    if name == "hardcore":  # 2,000 steps of a thousand links on every chip take minutes
        champion = CHAMPIONS[name]
        rows = evaluator(champion).evaluate([champion.controller], range(100))[0]
        shortest = min(range(100), key=lambda seed: rows[seed].steps)
        arguments += ["--seed", str(shortest), "--vectors", "100"]
    assert main([*arguments, "--json", str(result)]) == 0
    report = json.loads(result.read_text())
    assert report["verdict"] == "pass"
    assert report["targets"]
    assert all(entry["mismatches"] == 0 for entry in report["targets"])


@pytest.mark.long
def test_the_generated_c_of_the_largest_agrees_for_a_whole_episode_on_every_chip(tmp_path: Path) -> None:
    source = str(tmp_path / "hardcore.c")
    assert main(["codegen", str(FOLDER / "hardcore.pkl"), "-o", source]) == 0
    assert main(["verify", str(FOLDER / "hardcore.pkl"), "--c", source, "--episodes", "1"]) == 0


def test_the_project_s_first_page_says_what_the_page_of_champions_says() -> None:
    readme = (FOLDER.parents[1] / "README.md").read_text(encoding="utf-8")
    reward = f"| {CLAIMS['tiny'][2]} (solved is 300); {CLAIMS['tiny'][4]} of the episodes at 300 or more |"
    assert reward in readme
    assert (
        f"| packed: topology, weights, activations, all | {CLAIMS['tiny'][7]} bytes, {CLAIMS['tiny'][6]} links;"
        in readme
    )
    assert f", {CLAIMS['walker'][2]}, takes {CLAIMS['walker'][7]} |" in readme
    assert f"4,000 unseen episodes | {CLAIMS['hardcore'][2]} in {CLAIMS['hardcore'][7]} bytes;" in readme


def test_every_environment_that_the_page_promises_has_a_champion() -> None:
    assert {one.environment.id for one in CHAMPIONS.values() if one.environment} == set(ENVIRONMENTS)


def test_the_front_is_of_these_champions() -> None:
    assert front_csv() == (FOLDER / "front.csv").read_bytes()
    known = {point.sha256: point.mean for point in collect([FOLDER]).points}
    for found in csv.DictReader((FOLDER / "front.csv").read_text().splitlines()):
        assert known[found["sha256"]] == float(found["mean"])
