# SPDX-License-Identifier: MIT
"""The committed policies of docs/paper/baselines are what their JSON says."""

import json
from pathlib import Path
from typing import Any

import pytest

from bitneat.baselines.actions import action_table
from bitneat.baselines.dense import DenseNetwork, dense_from_npz
from bitneat.baselines.evaluation import network_policy, score
from bitneat.evolve.randomness import report_seeds
from tests.baselines.test_evaluation import in_gymnasium

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "paper" / "baselines"
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))


def committed(name: str) -> tuple[dict[str, Any], DenseNetwork]:
    data = json.loads((FOLDER / f"{name}.json").read_text())
    content = (FOLDER / f"{name}.npz").read_bytes()
    assert len(content) <= 200_000
    return data, dense_from_npz(content, data["hidden"], clipped=data["system"] != "dqn")


def test_there_are_committed_policies() -> None:
    assert NAMES


@pytest.mark.parametrize("name", NAMES)
def test_its_sizes_are_those_told(name: str) -> None:
    data, dense = committed(name)
    network = dense.to_network()
    assert name == f"{data['system']}-{data['seed']}"
    assert (data["parameters"], data["float_bytes"]) == (dense.parameters, 4 * dense.parameters)
    assert (data["links"], data["nodes"]) == (network.num_links, len(network.nodes))


# A layered network takes minutes.
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name.startswith("ars") else pytest.mark.long) for name in NAMES]
)
def test_its_score_is_the_one_told(name: str) -> None:
    data, dense = committed(name)
    table = action_table() if data["system"] == "dqn" else None
    held_out, _ = score(network_policy(dense.to_network(), table), report_seeds(data["held_out"]["episodes"]))
    # Another C library's sine may lead to another walk, not to another walker.
    assert held_out.mean == pytest.approx(data["held_out"]["mean"], abs=max(1.0, data["held_out"]["std"] / 4))


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("ars")])
def test_gymnasium_itself_gives_the_first_held_out_episode_the_same_reward(name: str) -> None:
    network = committed(name)[1].to_network()
    seed = report_seeds(1)[0]
    reward, steps = in_gymnasium(network, seed, None)
    held_out, taken = score(network_policy(network), [seed])
    assert (held_out.mean, taken) == (reward, steps)
