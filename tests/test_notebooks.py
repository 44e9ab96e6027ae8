# SPDX-License-Identifier: MIT
"""The example notebooks: they run from top to bottom, what they find holds, and they are committed without outputs."""

from __future__ import annotations

import base64
import json
import re
import tempfile
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from bitneat.champion import Champion, FloatChampion, any_from_data, load
from bitneat.cli.main import COMMANDS
from bitneat.controller.packing import pack
from bitneat.evolve.randomness import report_seeds
from bitneat.policy.arrays import read_layers
from bitneat.policy.layers import layered_network
from bitneat.reproduce.results import policy_from_data
from bitneat.sim.walker import run_episodes
from tests.sealed import sealed

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "notebooks"
NAMES = ("api", "train", "quantize", "evaluate")
LIMIT = 600
"""Seconds for a cell, on a machine that does much else."""

Notebook = Any


@pytest.fixture(autouse=True)
def nothing_of_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels neither see nor change how the user has set up Jupyter and IPython."""
    for variable in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    monkeypatch.setenv("JUPYTER_PREFER_ENV_PATH", "1")


def _read(name: str) -> Notebook:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def _run(notebook: Notebook, wanted: str) -> Any:
    """Execute all cells in the folder of the notebooks, and then ``wanted``, an expression, whose value comes back as JSON.

    Raises:
        CellExecutionError: if a cell fails.
    """
    question = f"import json\nprint(json.dumps({wanted}))"
    notebook.cells.append(nbformat.v4.new_code_cell(question, id="question"))
    # Sockets in the file system: ports that are free now may not be when the kernel opens them. Their names must be short.
    with tempfile.TemporaryDirectory(prefix="kernel-") as folder:
        manager = AsyncKernelManager(
            kernel_name="python3", transport="ipc", connection_file=str(Path(folder) / "kernel.json")
        )
        client = NotebookClient(
            notebook, manager, timeout=LIMIT, startup_timeout=LIMIT, resources={"metadata": {"path": str(FOLDER)}}
        )
        client.execute()
    (output,) = notebook.cells[-1].outputs
    return json.loads(output.text)


def _with_parameters(notebook: Notebook, **values: object) -> Notebook:
    """The notebook with other values, set after those in its cell of parameters."""
    (cell,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", ())]
    for name, value in values.items():
        assert f"{name} = " in cell.source
        cell.source += f"\n{name} = Path({str(value)!r})" if isinstance(value, Path) else f"\n{name} = {value!r}"
    return notebook


def _shown(notebook: Notebook, cell_id: str) -> dict[str, Any]:
    """What a cell displays, by MIME type."""
    (cell,) = [cell for cell in notebook.cells if cell.id == cell_id]
    return {kind: data for output in cell.outputs for kind, data in output.get("data", {}).items()}


def test_the_notebook_on_the_api_walks_verifies_and_evolves() -> None:
    notebook = _with_parameters(_read("api"), EPISODES=3, GENERATIONS=2)
    found = _run(
        notebook,
        "{'total': total, 'rewards': rewards.tolist(), 'report': report.to_data(), 'rows': len(evolved.history()),"
        " 'champion': evolved.champion.to_data()}",
    )
    walker = load(ROOT / "examples" / "champions" / "tiny.pkl").controller
    rewards, _ = run_episodes([walker], range(3))
    assert found["rewards"] == rewards[0].tolist()
    assert found["total"] == rewards[0][0]
    assert found["report"]["verdict"] == "pass"
    assert {target["mismatches"] for target in found["report"]["targets"]} == {0}
    assert found["rows"] == 2
    assert isinstance(any_from_data(found["champion"]), Champion)


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


def test_the_notebook_on_evaluating_runs_a_part_of_the_smoke_budget_or_shows_what_is_published(tmp_path: Path) -> None:
    notebook = _with_parameters(_read("evaluate"), PUBLISHED=tmp_path)
    found = _run(
        notebook,
        "{'origin': origin, 'files': {path.name: path.read_text() for path in Path(scratch.name, 'results').iterdir()}}",
    )
    assert found["origin"] == "smoke budget"
    files = {name: json.loads(text) for name, text in found["files"].items()}
    assert set(files) == {"default-1.json", "bit-1.json", "ptq-int-round-1.json", "ptq-ternary-round-1.json"}
    policy = policy_from_data(files["bit-1.json"]["policy"])
    rewards, _ = run_episodes([policy], report_seeds(10))
    assert files["bit-1.json"]["heldout"]["mean"] == pytest.approx(float(np.mean(rewards)), rel=1e-12)
    row = f"| bit | {np.mean(rewards):.1f} | "
    assert row in _shown(notebook, "table")["text/markdown"]

    # The same results, but for one that is not theirs: this is how one sees that they are read and not made again.
    files["default-1.json"]["heldout"]["mean"] = 271.25
    for name, content in files.items():
        (tmp_path / name).write_text(sealed(content))
    notebook = _with_parameters(_read("evaluate"), PUBLISHED=tmp_path)
    found = _run(notebook, "{'origin': origin, 'verdicts': {claim.claim: claim.verdict for claim in judged}}")
    assert found["origin"] == "published results"
    table = _shown(notebook, "table")["text/markdown"]
    assert "| default | 271.2 | " in table
    assert row in table
    assert found["verdicts"]["The float genome reaches 270 in 300 generations"] == "holds"
    assert found["verdicts"]["BitGenome reaches 254.29 in 300 generations"] == "does not hold"
    assert len(found["verdicts"]) >= 10
    assert _shown(notebook, "claims")["text/markdown"].count("\n") == len(found["verdicts"]) + 1
    assert "<svg" in _shown(notebook, "fitness")["image/svg+xml"]
    assert "<svg" in _shown(notebook, "growth")["image/svg+xml"]
    assert base64.b64decode(_shown(notebook, "walk")["image/png"]).startswith(b"\x89PNG")


def test_the_notebook_on_evaluating_shows_what_is_committed() -> None:
    published = ROOT / "docs" / "paper" / "results"
    if not all((published / f"{job}.json").exists() for job in ("default-1", "bit-1")):
        pytest.skip("the runs of the paper's budget are not committed yet")
    assert _run(_read("evaluate"), "origin") == "published results"


def test_a_cell_that_fails_fails_the_test() -> None:
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0", id="bad")])
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        _run(notebook, "0")


def test_every_notebook_is_run_here_and_told_of_on_the_page() -> None:
    assert {path.name for path in FOLDER.glob("*.ipynb")} == {f"{name}.ipynb" for name in NAMES}
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"({name}.ipynb)" in page for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_committed_without_outputs_or_traces_of_a_machine(name: str) -> None:
    text = (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    notebook = nbformat.reads(text, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert text == nbformat.writes(notebook) + "\n"
    assert notebook.metadata == {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    ids = [cell.id for cell in notebook.cells]
    assert len(set(ids)) == len(ids)
    for cell in notebook.cells:
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", cell.id), cell.id
        assert set(cell.metadata) <= {"tags"}
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


@pytest.mark.parametrize("name", NAMES)
def test_the_commands_that_a_notebook_shows_exist(name: str) -> None:
    shown = {
        command
        for cell in _read(name).cells
        if cell.cell_type == "markdown"
        for command in re.findall(r"^ {4}bitneat (\w+)", cell.source, re.MULTILINE)
    }
    assert shown
    assert shown <= set(COMMANDS)
