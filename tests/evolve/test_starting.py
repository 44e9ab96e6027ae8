# SPDX-License-Identifier: MIT
"""Searches that start from a champion or a float teacher."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bitneat
from bitneat.champion import Champion, EnvironmentSpec, FloatChampion, save_pickle
from bitneat.cli.main import main
from bitneat.controller import Constant, Controller, Reference
from bitneat.errors import BitneatError
from bitneat.evolve.config import load, parse
from bitneat.evolve.randomness import report_seeds
from bitneat.evolve.run_folder import RunFolder
from bitneat.evolve.search import Search
from bitneat.evolve.starting import starting_point
from bitneat.network import FloatNetwork
from bitneat.policy.arrays import read_layers
from bitneat.policy.layers import layered_network
from bitneat.sim.environment import inspect
from bitneat.sim.walker import run_episodes
from tests.evolve.test_run import stop_after
from tests.strategies import input_vectors

ROOT = Path(__file__).resolve().parents[2]
WALKER = EnvironmentSpec("BipedalWalker-v3")
INFO = inspect(WALKER)
TINY = ROOT / "examples" / "champions" / "tiny.pkl"


@pytest.fixture(scope="module")
def teacher() -> FloatChampion:
    """The linear policy that ARS found, 305 points."""
    saved = (ROOT / "docs" / "paper" / "baselines" / "ars-0.npz").read_bytes()
    return FloatChampion(layered_network(read_layers(saved, "tanh", "clamped")), INFO.action, WALKER)


def first_population(champion: Champion | FloatChampion) -> list[Controller]:
    """What the first population lowers to."""
    config, start = starting_point(champion, load("bipedalwalker"), INFO, "start")
    assert not config["evolve"]["linear_generations"]
    search = Search(config.with_values("NEAT", pop_size=12), WALKER, INFO, 3, start)
    return [search.kind.lower(genome)[0] for genome in search.population.population.values()]


def test_a_ternary_champion_is_the_first_genome_and_the_others_its_mutants() -> None:
    tiny = bitneat.load(TINY)
    population = first_population(tiny)
    assert population[0].sha256 == tiny.controller.sha256
    assert len({controller.sha256 for controller in population}) > 6


def test_an_integer_champion_becomes_ternary_without_a_change() -> None:
    tiny = bitneat.load(TINY)
    data = tiny.controller.to_data()
    for link in data["nodes"][-1]["links"]:
        link["shift"] = 1
    shifted = Controller.from_data(data)
    assert not shifted.is_ternary
    _, (ternary,) = starting_point(Champion(shifted, tiny.action, WALKER), load("bipedalwalker"), INFO, "start")
    assert ternary.is_ternary
    rewards, steps = run_episodes([shifted, ternary], range(2))
    assert rewards[0].tolist() == rewards[1].tolist()
    assert steps[0].tolist() == steps[1].tolist()


def test_a_teachers_ternary_versions_walk_as_it_does(teacher: FloatChampion) -> None:
    config, start = starting_point(teacher, load("bipedalwalker"), INFO, "start")
    assert len(start) >= 3
    assert all(controller.is_ternary for controller in start)
    assert config["evolve"]["input_limits"] == tuple(entry.limit for entry in start[0].inputs)
    rewards, _ = run_episodes([teacher.network, *start], report_seeds(10))
    means = rewards.mean(axis=1)
    assert max(means[1:]) > 0.95 * means[0] > 250
    # Nodes stand in another order, so the fingerprints may differ.
    again, _ = run_episodes(first_population(teacher)[: len(start)], report_seeds(10))
    assert again.tolist() == rewards[1:].tolist()


BRIEF = """
[evolve]
generations = 3
race_episodes = 1
race_fractions = 1
selection_episodes = 2
final_episodes = 2
report_episodes = 2
[NEAT]
pop_size = 8
"""


def test_a_run_from_a_teacher_resumes_to_the_same_bytes_without_it(
    teacher: FloatChampion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_pickle(teacher, tmp_path / "teacher.pkl")
    (tmp_path / "brief.ini").write_text(BRIEF)
    arguments = ["evolve", "--config", str(tmp_path / "brief.ini"), "--start", str(tmp_path / "teacher.pkl")]
    assert main([*arguments, "-o", str(tmp_path / "whole")]) == 0
    with monkeypatch.context() as patch:
        stop_after(1, patch)
        assert main([*arguments, "-o", str(tmp_path / "stopped")]) == 130
    (tmp_path / "teacher.pkl").unlink()
    assert main(["evolve", "--resume", str(tmp_path / "stopped")]) == 0
    for name in ("champion.pkl", "history.csv", "run.json", "config.ini"):
        assert (tmp_path / "stopped" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
    champion = bitneat.load(tmp_path / "whole" / "champion.pkl")
    settings = RunFolder(tmp_path / "whole").settings()
    assert champion.provenance["start"] == [controller.sha256 for controller in settings.start]
    rewards, _ = run_episodes([champion.controller], range(4))
    assert np.median(rewards) > 250
    same = bitneat.evolve(config=tmp_path / "brief.ini", start=teacher, output=tmp_path / "api")
    assert same.champion == champion


def test_a_run_that_goes_on_under_another_configuration_keeps_the_inputs_of_what_it_started_from(
    tmp_path: Path,
) -> None:
    (tmp_path / "brief.ini").write_text(BRIEF)
    (tmp_path / "next.ini").write_text(BRIEF.replace("generations = 3", "generations = 4\nfrac_bits = 6"))
    run = tmp_path / "run"
    assert main(["evolve", "--config", str(tmp_path / "brief.ini"), "--start", str(TINY), "-o", str(run)]) == 0
    assert main(["evolve", "--resume", str(run), "--config", str(tmp_path / "next.ini")]) == 0
    tiny = bitneat.load(TINY).controller
    champion = bitneat.load(run / "champion.pkl")
    assert champion.provenance["generations"] == 4
    assert (champion.controller.frac_bits, champion.controller.inputs) == (tiny.frac_bits, tiny.canonical.inputs)


def test_what_no_search_can_start_from_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tiny = bitneat.load(TINY)
    for arguments, message in (
        (["--env", "CartPole-v1"], "is for another task: its inputs or its action space are not the environment's"),
        (["--config", "paper-bit"], "[NEAT] genome = BitGenome only"),
        (["--resume", str(tmp_path)], "--start: not with --resume, which takes it from the run"),
    ):
        output = [] if "--resume" in arguments else ["-o", str(tmp_path / "run")]
        assert main(["evolve", *arguments, *output, "--start", str(TINY)]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    constant = Controller(tiny.controller.inputs, (), (Constant(3),) * 4)
    save_pickle(Champion(constant, tiny.action, WALKER), tmp_path / "constant.pkl")
    assert main(["evolve", "-o", str(tmp_path / "run"), "--start", str(tmp_path / "constant.pkl")]) == 2
    named = f"--start {tmp_path / 'constant.pkl'}: no genome is like it: outputs[0]: is the constant 3"
    assert capsys.readouterr().err.startswith(f"bitneat: {named}")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["cartpole", "acrobot", "mountaincar"])
def test_a_champion_with_constant_or_shared_outputs_is_started_from(tmp_path: Path, name: str) -> None:
    path = ROOT / "examples" / "champions" / f"{name}.pkl"
    champion = bitneat.load(path)
    assert champion.environment is not None
    info = inspect(champion.environment)
    config, start = starting_point(champion, parse(BRIEF, "test"), info, "start")
    search = Search(config, champion.environment, info, 3, start)
    first = search.kind.lower(next(iter(search.population.population.values())))[0]
    inputs = input_vectors(champion.controller, random.Random(3), 200)
    assert Reference(first).run(inputs) == Reference(champion.controller).run(inputs)


def test_a_teacher_of_no_use_is_said_so(teacher: FloatChampion) -> None:
    nodes = tuple(
        replace(node, links=tuple((source, weight * 1e9) for source, weight in node.links))
        for node in teacher.network.nodes
    )
    huge = FloatChampion(FloatNetwork(teacher.network.num_inputs, nodes, teacher.network.outputs), INFO.action, WALKER)
    with pytest.raises(BitneatError, match=r"start: no ternary controller comes near it"):
        starting_point(huge, load("bipedalwalker"), INFO, "start")
