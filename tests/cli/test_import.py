# SPDX-License-Identifier: MIT
"""``bitneat import`` of policies, as a user meets it; genomes are in tests/evolve/test_importing.py."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from bitneat.champion import FloatChampion, load, load_any
from bitneat.cli.main import main

SAVED = Path(__file__).parents[1] / "policy" / "saved"
CHAMPIONS = Path(__file__).parents[2] / "examples" / "champions"


def arrays(path: Path, **values: object) -> str:
    np.savez(path, **values)  # type: ignore[arg-type]
    return str(path)


def test_layers_become_a_float_champion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = arrays(tmp_path / "layers.npz", W1=np.eye(3), b1=np.ones(3), W2=np.ones((1, 3)))
    output = tmp_path / "float.json"
    common = ["import", file, "--env", "Pendulum-v1", "-o", str(output)]
    assert main([*common, "--activation", "relu", "--output-activation", "clamped", "--json", str(tmp_path / "j")]) == 0
    assert "float, 4 nodes, 6 links" in capsys.readouterr().out
    champion = load_any(output)
    assert isinstance(champion, FloatChampion)
    assert [node.activation for node in champion.network.nodes] == ["relu"] * 3 + ["clamped"]
    assert champion.environment is not None
    assert json.loads((tmp_path / "j").read_text())["kind"] == "float"
    norm = arrays(tmp_path / "norm.npz", mean=np.full(3, 2.0), var=np.full(3, 4.0))
    assert main([*common, "--normalization", norm]) == 0
    normalized = load_any(output)
    assert isinstance(normalized, FloatChampion)
    assert normalized.network.nodes[0].links[0][1] == pytest.approx(0.5 / 2.5)
    assert normalized.network.nodes[0].bias == pytest.approx((1.0 - 0.5 * 2.0) / 2.5, abs=1e-8)


def test_without_an_environment_outputs_are_actions_from_minus_one_to_one(tmp_path: Path) -> None:
    file = arrays(tmp_path / "layers.npz", W1=np.array([[0.5, -0.25]]))
    output = tmp_path / "champion.pkl"
    assert main(["import", file, "-o", str(output), "--to", "ternary"]) == 0
    champion = load(output)
    assert champion.controller.is_ternary
    assert champion.environment is None
    assert champion.provenance["held_out"] is None


def test_a_saved_model_becomes_a_champion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "float.pkl"
    assert main(["import", str(SAVED / "ars_pendulum.zip"), "--env", "Pendulum-v1", "-o", str(output)]) == 0
    assert "float, 1 nodes, 3 links" in capsys.readouterr().out
    champion = load_any(output)
    assert isinstance(champion, FloatChampion)
    assert champion.provenance["imported"] == "stable-baselines3"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ars_pendulum.zip"], "to import a model, name its environment with --env"),
        (["ars_pendulum.zip", "--env", "CartPole-v1"], "has 3 inputs and 1 outputs, CartPole-v1 needs 4 and 2"),
        (["ars_pendulum.zip", "--env", "Pendulum-v1", "--config", "x"], "is no genome, which --config"),
        (["ars_pendulum.zip", "--env", "Pendulum-v1", "--output-activation", "tanh"], "--output-activation: not for"),
        (["ars_pendulum.zip", "--env", "Pendulum-v1", "--seed", "1"], "--seed: only with --to and --method search"),
        (["ars_pendulum.zip", "--env", "Pendulum-v1", "--method", "twn"], "--method: only with --to"),
        (
            ["ars_pendulum.json"],
            "ars_pendulum.json: is text, expected a genome's pickle, a model's .zip, or layers in a .npz",
        ),
        (["nowhere.npz"], "nowhere.npz: cannot read"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "champion.pkl"
    assert main(["import", str(SAVED / arguments[0]), *arguments[1:], "-o", str(output)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not output.exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty, expected a genome's pickle"),
        (b"\x93NUMPY\x01\x00", "is a single array of NumPy's, expected a genome's pickle"),
        (b"some notes\n", "is text, expected a genome's pickle"),
        ((CHAMPIONS / "tiny.pkl").read_bytes(), "is a champion of bitneat's already"),
        ((CHAMPIONS / "tiny.json").read_bytes(), "is a champion of bitneat's already"),
        (b"\x80\x04N.", "to import a genome, name its neat-python configuration with --config"),
        (b"N.", "to import a genome, name its neat-python configuration with --config"),
    ],
)
def test_a_file_that_is_no_genome_is_said_to_be_what_it_is(
    content: bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "f").write_bytes(content)
    assert main(["import", str(tmp_path / "f"), "-o", str(tmp_path / "out.pkl")]) == 2
    assert f"{tmp_path / 'f'}: {message}" in capsys.readouterr().err


def test_a_pipe_is_refused_since_it_could_not_be_read_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "f")
    assert main(["import", str(tmp_path / "f"), "-o", str(tmp_path / "out.pkl")]) == 2
    assert f"{tmp_path / 'f'}: cannot read: not a regular file" in capsys.readouterr().err
