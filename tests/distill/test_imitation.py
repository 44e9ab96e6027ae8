# SPDX-License-Identifier: MIT
"""Imitation of a linear policy, over a few rounds.

Runs where bitneat[baselines] is installed: ``make test-baselines``.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bitneat.champion import EnvironmentSpec, FloatChampion, load, save_pickle
from bitneat.cli import main
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import NativeWalkerEvaluator
from bitneat.network import FloatNetwork, FloatNode
from bitneat.sim.walker.episodes import ACTION

pytest.importorskip("torch", reason="needs bitneat[baselines]")
pytest.importorskip("stable_baselines3", reason="needs bitneat[baselines]")

import torch

from bitneat.baselines.evaluation import batched
from bitneat.distill.imitation import DistillSettings, Imitation
from bitneat.distill.reinforcement import Reinforcement, ReinforceSettings
from bitneat.distill.run import IMITATION, ReinforceRow, RoundingRow, distill
from bitneat.distill.student import Student

HARDCORE = EnvironmentSpec("BipedalWalkerHardcore-v3")
SMALL = DistillSettings(hidden=(6,), rounds=4, float_rounds=1, walkers=3, updates=40, batch=64)


def teacher(environment: str = "BipedalWalkerHardcore-v3", seed: int = 0) -> FloatChampion:
    """A linear policy that falls soon."""
    rng = np.random.default_rng(seed)
    nodes = tuple(
        FloatNode(tuple((i, float(w)) for i, w in enumerate(rng.normal(0.0, 0.5, 24))), 0.1, 1.0, "clamped")
        for _ in range(4)
    )
    return FloatChampion(FloatNetwork(24, nodes, (24, 25, 26, 27)), ACTION, EnvironmentSpec(environment), {})


def run(folder: Path, rounds: int = 4, seed: int = 1) -> list[Any]:
    rows: list[Any] = []
    distill(teacher(), replace(SMALL, rounds=rounds), seed, folder, tell=rows.append)
    return rows


def test_the_student_comes_nearer_to_its_teacher(tmp_path: Path) -> None:
    rows: list[Any] = []
    settings = DistillSettings(hidden=(12,), rounds=4, float_rounds=2, walkers=8, updates=400, batch=256)
    champion, score = distill(teacher(), settings, 0, tmp_path, tell=rows.append)
    assert [row.mean is None for row in rows] == [True, True, False, False]
    assert rows[1].loss < 0.7 * rows[0].loss
    assert rows[-1].loss < 0.1
    assert champion.controller.is_ternary
    assert load(tmp_path / "champion.pkl") == champion
    assert champion.provenance["held_out"]["mean"] == score.mean
    assert champion.environment == EnvironmentSpec("BipedalWalkerHardcore-v3")
    assert len(pack(champion.controller)) < 400


def test_a_run_that_is_stopped_and_resumed_ends_the_same(tmp_path: Path) -> None:
    class Stop(Exception):  # noqa: N818
        pass

    def stop(row: Any) -> None:
        if row.number == 2:
            raise Stop

    whole = run(tmp_path / "whole")
    with pytest.raises(Stop):
        distill(teacher(), SMALL, 1, tmp_path / "parts", tell=stop)
    rest = run(tmp_path / "parts")
    assert [row.number for row in rest] == [3, 4]
    assert whole[2:] == rest
    for name in ("champion.pkl", "champion.json", "distill.json"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()


def test_what_cannot_be_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(BitneatError, match="expected a teacher for BipedalWalker"):
        distill(teacher("LunarLander-v3"), SMALL, 0, tmp_path / "lander", tell=lambda row: None)
    with pytest.raises(BitneatError, match="seed: expected a whole number"):
        run(tmp_path / "large", seed=2**64)
    run(tmp_path / "run", rounds=2)
    with pytest.raises(BitneatError, match="holds another run of distill"):
        run(tmp_path / "run", rounds=2, seed=5)
    checkpoint = tmp_path / "run" / IMITATION
    content = bytearray(checkpoint.read_bytes())
    for at in range(len(content) // 2, len(content) // 2 + 256):  # more than the padding between two entries
        content[at] ^= 1
    checkpoint.write_bytes(bytes(content))
    with pytest.raises(BitneatError, match=r"imitation\.pt: damaged: [^\n]*remove it to begin anew$"):
        run(tmp_path / "run", rounds=2)
    (tmp_path / "run" / "distill.json").write_text(json.dumps({})[:1])
    with pytest.raises(BitneatError, match=r"distill\.json: damaged"):
        run(tmp_path / "run", rounds=2)


def test_a_student_is_reinforced_before_it_is_rounded_and_after_an_interruption(tmp_path: Path) -> None:
    settings = ReinforceSettings(steps=16 * 64, walkers=8, steps_an_update=8, batch=32, epochs=1, critic_first=2)
    rows: list[Any] = []

    def stop(row: Any) -> None:
        rows.append(row)
        if len(rows) in (1, 2, 5, 10, 12):
            raise InterruptedError

    for number in (1, 2, 5, 10, 12):
        with pytest.raises(InterruptedError):
            distill(teacher(), SMALL, 2, tmp_path, tell=stop, reinforce=settings)
        assert len(rows) == number
    champion, score = distill(teacher(), SMALL, 2, tmp_path, tell=rows.append, reinforce=settings)
    assert rows[0].mean is None
    assert [row.steps for row in rows if isinstance(row, ReinforceRow)] == [15 * 64, 16 * 64, 18 * 64]
    roundings = [(row.layers, row.number) for row in rows if isinstance(row, RoundingRow)]
    first, all_ = [(1, number) for number in range(1, 5)], [(2, number) for number in range(1, 5)]
    assert roundings == [*first[:2], *first, *all_[:2], *all_]  # what takes seconds begins anew
    assert rows[3] == rows[5]
    assert rows[10] == rows[12]
    assert all(row.mean is not None for row in rows[1:])
    assert all((row.packed_bytes is None) == (row.layers == 1) for row in rows if isinstance(row, RoundingRow))
    assert all(row.loss < 0.05 for row in rows if isinstance(row, RoundingRow))
    assert all(row.packed_bytes < 400 for row in rows[-4:])
    assert champion.provenance["distill"]["reinforce"]["steps"] == 1024
    assert champion.provenance["held_out"]["mean"] == score.mean
    assert champion.controller.is_ternary
    with pytest.raises(BitneatError, match="holds another run"):
        distill(teacher(), SMALL, 2, tmp_path, tell=rows.append)


def test_a_student_s_controller_goes_on_without_imitation(tmp_path: Path) -> None:
    begun, _ = distill(teacher(), SMALL, 2, tmp_path / "begun", tell=lambda row: None)
    settings = ReinforceSettings(steps=16 * 64, walkers=8, steps_an_update=8, batch=32, epochs=1, critic_first=1)
    rows: list[Any] = []
    more = replace(SMALL, hidden=(99,))
    champion, score = distill(begun, more, 2, tmp_path / "on", tell=rows.append, reinforce=settings)
    kinds = [ReinforceRow] * 2 + [RoundingRow] * 4 + [ReinforceRow] + [RoundingRow] * 4
    assert [type(row) for row in rows] == kinds
    assert not (tmp_path / "on" / IMITATION).exists()
    assert champion.provenance["distill"]["teacher"] == begun.controller.sha256
    assert champion.provenance["distill"]["settings"]["hidden"] == list(SMALL.hidden)
    assert champion.provenance["held_out"]["mean"] == score.mean
    assert champion.controller.sha256 != begun.controller.sha256
    with pytest.raises(BitneatError, match="which can go on with reinforcement alone"):
        distill(begun, SMALL, 2, tmp_path / "other", tell=rows.append)
    assert not (tmp_path / "other").exists()


def test_the_learning_rate_of_reinforcement_falls_to_the_end() -> None:
    settings = ReinforceSettings(steps=4 * 32, walkers=4, steps_an_update=8, batch=16, epochs=1, learning_rate=1e-2)
    training = Reinforcement(Student([1] * 24, [5], 4, 2), hardcore=False, settings=settings, seed=0)
    rates = []
    while not training.done:
        training.advance()
        rates.append(training._model.policy.optimizer.param_groups[0]["lr"])
    training.close()
    assert rates == pytest.approx([1e-2, 0.75e-2, 0.5e-2, 0.25e-2])


@pytest.mark.parametrize("learned", [False, True])
def test_noise_stays_as_it_is_or_is_learned(learned: bool) -> None:
    settings = ReinforceSettings(
        walkers=4, steps_an_update=8, batch=16, epochs=1, critic_first=0, log_std=-2.0, learn_std=learned
    )
    training = Reinforcement(Student([1] * 24, [5], 4, 2), hardcore=False, settings=settings, seed=0)
    training.advance()
    assert torch.equal(training._model.policy.log_std, torch.full((4,), -2.0)) == (not learned)
    training.close()


def test_a_student_that_goes_on_is_treated_as_one_that_walks(tmp_path: Path) -> None:
    begun, _ = distill(teacher(), SMALL, 2, tmp_path / "begun", tell=lambda row: None)
    save_pickle(begun, tmp_path / "begun.pkl")
    command = ["distill", str(tmp_path / "begun.pkl"), "--reinforce", "1", "--rounds", "3", "-o", str(tmp_path / "on")]
    assert main(command) == 0
    written = json.loads((tmp_path / "on" / "distill.json").read_text())
    assert written["reinforce"] == json.loads(json.dumps(asdict(ReinforceSettings.going_on(1))))
    assert written["reinforce"] != json.loads(json.dumps(asdict(ReinforceSettings(1))))


def test_layers_of_integers_are_not_trained_and_those_above_go_on() -> None:
    student = Student([1] * 24, [6, 5], 4, 3)
    settings = ReinforceSettings(
        steps=64, walkers=4, steps_an_update=16, batch=16, epochs=1, critic_first=0, settle_part=2.0, settle_rate=1e-3
    )
    training = Reinforcement(student, hardcore=False, settings=settings, seed=0)
    training.advance()
    assert training.done
    assert not training.settled
    seen = np.random.default_rng(0).normal(0.0, 0.5, (500, 24)).astype(np.float32)
    rounded = student.rounded(seen, np.random.default_rng(1), 1)
    assert [layer.quantized for layer in rounded.layers] == [True, False, False]
    training.adopt(rounded)
    assert training.student is student
    assert np.array_equal(student.act(seen), rounded.act(seen))
    assert not training.done
    before = {name: value.clone() for name, value in student.state_dict().items()}
    training.advance()
    assert training._model.policy.optimizer.param_groups[0]["lr"] == 1e-3
    training.advance()
    assert training._model.policy.optimizer.param_groups[0]["lr"] == 0.5e-3
    assert training.done
    changed = {name for name, value in student.state_dict().items() if not torch.equal(value, before[name])}
    assert {name.split(".")[1] for name in changed} == {"1", "2"}
    state = training.state()
    other = Reinforcement(Student([1] * 24, [6, 5], 4, 3), hardcore=False, settings=settings, seed=0)
    other.restore(state)
    assert np.array_equal(other.student.act(seen), student.act(seen))
    assert [layer.quantized for layer in other.student.layers] == [True, False, False]
    assert (other.steps, other.done, other.settled) == (training.steps, True, False)
    training.adopt(student.rounded(seen, np.random.default_rng(1), 2))
    assert training.settled
    training.close()
    other.close()


def test_reinforcement_changes_the_student_once_its_critic_has_begun() -> None:
    student = Student([1] * 24, [5], 4, 2)
    before = {name: value.clone() for name, value in student.state_dict().items()}
    settings = ReinforceSettings(walkers=4, steps_an_update=8, batch=16, epochs=1, critic_first=1)
    training = Reinforcement(student, hardcore=False, settings=settings, seed=0)
    training.advance()
    assert all(torch.equal(value, before[name]) for name, value in student.state_dict().items())
    training.advance()
    assert any(not torch.equal(value, before[name]) for name, value in student.state_dict().items())
    assert training.steps == 64
    training.close()


def test_weights_are_integers_once_the_first_rounds_are_over() -> None:
    imitation = Imitation(batched(teacher().network), True, SMALL, 0)
    evaluator = NativeWalkerEvaluator(HARDCORE, 2000, 1)
    for quantized in (False, True, True):
        row = imitation.advance(evaluator)
        assert [layer.quantized for layer in imitation.student.layers] == [quantized] * 2
        assert any(imitation.student.shifts) == quantized  # its inputs are balanced
        assert (row.mean is not None) == quantized
