# SPDX-License-Identifier: MIT
"""``bitneat quantize`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bitneat.champion import EnvironmentSpec, FloatChampion, load, save_json, save_pickle
from bitneat.cli.main import main
from bitneat.evolve import quantizing
from bitneat.network import FloatNetwork, FloatNode
from bitneat.sim.environment import inspect

EXAMPLE = Path(__file__).parents[2] / "examples" / "walker" / "champion.json"


@pytest.fixture
def float_champion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(quantizing, "SELECTION_EPISODES", 4)
    monkeypatch.setattr(quantizing, "_FIRST_EPISODES", 2)
    monkeypatch.setattr(quantizing, "REPORT_EPISODES", 4)
    weights = (0.23, 0.61, 2.9, 2.1)
    nodes = tuple(
        FloatNode(tuple((i, sign * w) for i, w in enumerate(weights)), 0.0, 1.0, "identity") for sign in (-1, 1)
    )
    spec = EnvironmentSpec("CartPole-v1")
    champion = FloatChampion(FloatNetwork(4, nodes, (4, 5)), inspect(spec).action, spec, {"max_steps": 80})
    path = tmp_path / "float.pkl"
    save_pickle(champion, path)
    return path


def test_a_float_champion_becomes_ternary_and_the_loss_is_shown(
    float_champion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    contents = []
    for workers in ("1", "2"):
        output, result = tmp_path / f"{workers}.json", tmp_path / f"result-{workers}.json"
        arguments = ["quantize", str(float_champion), "-o", str(output), "--workers", workers, "--json", str(result)]
        assert main(arguments) == 0
        contents.append(output.read_bytes())
    assert contents[0] == contents[1]
    printed = capsys.readouterr()
    assert "before, float   80.0 ± 0.0" in printed.out
    assert "after, ternary  80.0 ± 0.0" in printed.out
    assert "gains frac_bits 8" in printed.err
    champion = load(tmp_path / "1.json")
    summary = json.loads((tmp_path / "result-1.json").read_text())
    assert champion.controller.is_ternary
    assert summary["controller"]["sha256"] == champion.controller.sha256
    assert summary["source"]["float32_bytes"] == 32
    assert summary["source"]["held_out"]["episodes"] == 4
    assert summary["chosen"].items() <= summary["tried"][0].items()
    assert champion.provenance["max_steps"] == 80


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--to", "int", "--method", "twn"], "--method twn: makes ternary weights"),
        (["--seed", "1"], "--seed: only with --method search"),
        (["--seed", str(1 << 1024), "--method", "search"], "of at most 1024 bits"),
        (["--frac-bits", "13"], "'13' is not a whole number in 4..12"),
        (["-o", "FLOAT"], "would overwrite CHAMPION"),
        (["-o", "nowhere/x.pkl", "--method", "round"], "cannot write"),
    ],
)
def test_bad_input_is_one_line(
    float_champion: Path, arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replaced = [str(float_champion) if a == "FLOAT" else a for a in arguments]
    output = [] if "-o" in replaced else ["-o", str(tmp_path / "out.pkl")]
    assert main(["quantize", str(float_champion), *output, *replaced]) == 2
    error = capsys.readouterr().err
    assert message in error.splitlines()[-1]
    assert not (tmp_path / "out.pkl").exists()


def test_champions_that_need_no_quantizing_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["-o", str(tmp_path / "out.pkl")]
    assert main(["quantize", str(EXAMPLE), *out]) == 2
    assert "is ternary already; to make it better or smaller there is `bitneat polish`" in capsys.readouterr().err
    assert main(["quantize", str(EXAMPLE), *out, "--frac-bits", "8"]) == 2
    assert "--frac-bits: an integer champion keeps its own" in capsys.readouterr().err
    assert main(["quantize", str(tmp_path / "none.pkl"), *out]) == 2
    assert "none.pkl: cannot read" in capsys.readouterr().err


def test_a_float_champion_without_an_environment_is_quantized_unscored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network = FloatNetwork(2, (FloatNode(((0, 0.7), (1, -0.3)), 0.1),), (2,))
    action = inspect(EnvironmentSpec("Pendulum-v1")).action
    save_json(FloatChampion(network, action), tmp_path / "float.json")
    assert main(["quantize", str(tmp_path / "float.json"), "-o", str(tmp_path / "out.pkl"), "--to", "int"]) == 0
    assert "before, float   -" in capsys.readouterr().out
    assert main(["quantize", str(tmp_path / "float.json"), "-o", str(tmp_path / "out.pkl"), "--method", "search"]) == 2
    assert "--method search: needs an environment" in capsys.readouterr().err
