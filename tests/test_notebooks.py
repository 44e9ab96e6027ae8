# SPDX-License-Identifier: MIT
"""The example notebooks: they run from top to bottom, what they find holds, and they are committed without outputs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from bitneat.champion import Champion, FloatChampion, any_from_data
from bitneat.controller.packing import pack
from bitneat.evolve.randomness import report_seeds
from bitneat.network import FloatNetwork
from bitneat.policy.arrays import read_layers
from bitneat.policy.layers import layered_network
from bitneat.sim.walker import run_episodes

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "notebooks"
NAMES = ("train", "quantize", "evaluate")
LIMIT = 600
"""Seconds for a cell, on a machine that does much else."""

Notebook = Any


@pytest.fixture
def kernels(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Kernels with their files in a folder of their own, and nothing of the user's settings."""
    home = tmp_path_factory.mktemp("jupyter")
    for variable in ("JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(variable, str(home / variable.lower()))
    monkeypatch.setenv("MPLCONFIGDIR", str(ROOT / "build" / "test-cache" / "matplotlib"))
    yield
    shutil.rmtree(home, ignore_errors=True)


def _read(name: str) -> Notebook:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def _run(notebook: Notebook, wanted: str) -> Any:
    """Execute all cells in the folder of the notebooks, and then ``wanted``, an expression, whose value comes back as JSON.

    Raises:
        CellExecutionError: if a cell fails.
    """
    question = f"import json\nprint(json.dumps({wanted}))"
    notebook.cells.append(nbformat.v4.new_code_cell(question, id="question"))
    client = NotebookClient(
        notebook, timeout=LIMIT, startup_timeout=LIMIT, resources={"metadata": {"path": str(FOLDER)}}
    )
    client.execute()
    (output,) = notebook.cells[-1].outputs
    return json.loads(output.text)


def _with_parameters(notebook: Notebook, **values: object) -> Notebook:
    """The notebook with other values set after those of its cell of parameters."""
    (cell,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", ())]
    cell.source += "".join(f"\n{name} = {value!r}" for name, value in values.items())
    return notebook


def _shown(notebook: Notebook, cell_id: str) -> dict[str, Any]:
    """What a cell displays, by MIME type."""
    (cell,) = [cell for cell in notebook.cells if cell.id == cell_id]
    return {kind: data for output in cell.outputs for kind, data in output.get("data", {}).items()}


@pytest.mark.usefixtures("kernels")
def test_the_notebook_on_training_evolves_a_float_and_a_ternary_champion() -> None:
    notebook = _with_parameters(_read("train"), GENERATIONS=3)
    found = _run(
        notebook,
        "{'histories': histories, 'champions': {name: champion.to_data() for name, champion in champions.items()}}",
    )
    assert [found["histories"][name]["generation"] for name in ("float", "ternary")] == [[0, 1, 2]] * 2
    assert "image/png" in _shown(notebook, "fitness")
    floating, ternary = (any_from_data(found["champions"][name]) for name in ("float", "ternary"))
    assert isinstance(floating, FloatChampion)
    assert isinstance(ternary, Champion)
    assert ternary.controller.is_ternary
    assert all(link.shift == 0 for node in ternary.controller.nodes for link in node.links)
    rewards, _ = run_episodes([floating.network, ternary.controller], report_seeds(10))
    for champion, row in zip((floating, ternary), rewards, strict=True):
        assert champion.provenance["held_out"]["mean"] == pytest.approx(float(np.mean(row)), rel=1e-12)


@pytest.mark.usefixtures("kernels")
def test_the_notebook_on_quantizing_ends_in_c_without_a_mismatch() -> None:
    notebook = _read("quantize")
    found = _run(
        notebook,
        "{'report': report.to_data(), 'champion': champion.to_data(), 'before': before.mean,"
        " 'scores': {' '.join(key): score.mean for key, score in scores.items()},"
        " 'ternary': {' '.join(key): controller.is_ternary for key, controller in controllers.items()}}",
    )
    champion = any_from_data(found["champion"])
    assert isinstance(champion, Champion)
    saved = (ROOT / "docs" / "paper" / "baselines" / "ars-0.npz").read_bytes()
    network = layered_network(read_layers(saved, "tanh", "clamped"))
    rewards, _ = run_episodes([network, champion.controller], report_seeds(10))
    assert found["before"] == pytest.approx(float(np.mean(rewards[0])), rel=1e-12)
    assert found["scores"]["ternary gains"] == pytest.approx(float(np.mean(rewards[1])), rel=1e-12)
    assert found["scores"]["ternary gains"] > 0.95 * found["before"]
    assert found["scores"]["ternary exact, from int gains"] == found["scores"]["int gains"]
    assert all(is_ternary for key, is_ternary in found["ternary"].items() if key.startswith("ternary"))
    assert f" | {len(pack(champion.controller))} |" in _shown(notebook, "table")["text/markdown"]

    report = found["report"]
    assert report["verdict"] == "pass"
    assert report["controller"]["sha256"] == champion.controller.sha256
    assert {target["name"] for target in report["targets"]} == {"host-unrolled", "host-table"}
    for target in report["targets"]:
        assert target["mismatches"] == 0
        assert target["steps_compared"] >= 300


@pytest.mark.usefixtures("kernels")
def test_the_notebook_on_evaluating_runs_a_part_of_the_smoke_budget_where_there_are_no_results() -> None:
    notebook = _with_parameters(_read("evaluate"), PUBLISHED=None)
    notebook.cells.insert(0, nbformat.v4.new_code_cell("import sys; sys.exit()"))
