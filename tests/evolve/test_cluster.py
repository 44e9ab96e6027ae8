# SPDX-License-Identifier: MIT
"""Episodes on a Ray cluster of two nodes, both on this machine: the same bytes, whatever dies on the way."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bitneat.cli.main import main
from bitneat.errors import MissingExtraError
from bitneat.evolve import cluster as clusters
from bitneat.evolve.cluster import chunks
from tests.evolve.ray_process import QUIET_AND_LOCAL

os.environ.update(QUIET_AND_LOCAL)  # for the runs that tests start
ROOT = Path(__file__).parents[2]
SETTINGS = ["--pop", "16", "--generations", "10", "--seed", "3"]
LIMIT = 240.0
"""Seconds for anything that is waited for, on a machine that does much else."""


@given(st.integers(0, 40), st.integers(0, 40), st.integers(1, 64), st.integers(1, 16))
def test_every_episode_is_in_one_task(controllers: int, seeds: int, cores: int, least: int) -> None:
    seen = [
        (row, column)
        for chunk in chunks(controllers, seeds, cores, least)
        for row in range(controllers)[chunk.controllers]
        for column in range(seeds)[chunk.seeds]
    ]
    assert sorted(seen) == [(row, column) for row in range(controllers) for column in range(seeds)]


def test_tasks_are_about_four_a_core_and_none_is_tiny() -> None:
    def sizes(*arguments: int) -> list[int]:
        return [
            (chunk.controllers.stop - chunk.controllers.start) * (chunk.seeds.stop - chunk.seeds.start)
            for chunk in chunks(*arguments)
        ]

    assert sizes(200, 3, 2, 16) == [75] * 8
    assert sizes(200, 3, 1000, 16) == [15] * 40
    assert sizes(5, 128, 1000, 16) == [16] * 40
    assert sizes(1, 4, 8, 16) == [4]


@pytest.mark.parametrize("early", [True, False])
def test_signals_wait_for_a_place_where_they_can_be_raised(early: bool) -> None:
    def stop(number: int, frame: object) -> None:
        raise InterruptedError(number)

    reached = []

    def interrupted() -> None:
        with clusters._deferred_signals() as deliver:
            deliver()
            os.kill(os.getpid(), signal.SIGTERM)
            reached.append("after the signal")
            if early:
                deliver()
                reached.append("after its delivery")

    interrupt = signal.getsignal(signal.SIGINT)  # ignored in what a shell runs in the background
    before = signal.signal(signal.SIGTERM, stop)
    try:
        with pytest.raises(InterruptedError):
            interrupted()
        assert reached == ["after the signal"]
        assert signal.getsignal(signal.SIGTERM) is stop
        assert signal.getsignal(signal.SIGINT) is interrupt
    finally:
        signal.signal(signal.SIGTERM, before)


class Nodes:
    """A cluster of two nodes."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        said = json.loads(process.stdout.readline())
        self.address: str = said["address"]
        self.other_raylet: int = said["raylet"]

    def workers_of_other(self) -> list[int]:
        """Processes that run tasks on the other node."""
        children = Path(f"/proc/{self.other_raylet}/task/{self.other_raylet}/children").read_text().split()
        return [
            pid for pid in map(int, children) if "ray::" in Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
        ]


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    command = [sys.executable, "-m", "tests.evolve.ray_process", "nodes"]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        yield Nodes(process)
        process.communicate(timeout=LIMIT)


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run on one machine that the others must equal."""
    folder = tmp_path_factory.mktemp("local") / "run"
    assert main(["evolve", *SETTINGS, "-o", str(folder)]) == 0
    return folder


def wait_for(what: Any, process: subprocess.Popen[bytes]) -> Any:
    deadline = time.monotonic() + LIMIT
    while not (found := what()):
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


def rows(folder: Path) -> int:
    history = folder / "history.csv"
    return history.read_bytes().count(b"\n") - 1 if history.exists() else 0


def refuses_machines_that_differ_and_names_those_that_fail(nodes: Nodes) -> None:
    """And keeps to the cores that it may use."""
    command = [sys.executable, "-m", "tests.evolve.ray_process", "refusals", nodes.address]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=2 * LIMIT, check=False)
    assert done.returncode == 0, done.stderr
    version, package, trigonometry, environment, failure, cores = done.stdout.splitlines()
    assert re.fullmatch(r"node .*: has bitneat .*, expected 9\.9, as where the run began", version)
    assert re.fullmatch(r"node .*: has numpy [\d.]+, expected 0\.1, as where the run began", package)
    assert re.search(r"node .*: trigonometry: expected a C library", trigonometry)
    assert re.match(r"node \S+: environment Nowhere-v0: ", environment)
    assert re.fullmatch(r"--evaluator ray: node [\d.]+: a task failed: ZeroDivisionError: by zero", failure)
    assert cores == "4 True"


def stops_on_sigterm_as_without_ray(nodes: Nodes, folder: Path) -> None:
    """Although Ray has a handler of its own: the checkpoint stays, and a line says how to go on."""
    command = [sys.executable, "-m", "bitneat", "evolve", *SETTINGS, "-o", str(folder)]
    process = subprocess.Popen(
        [*command, "--evaluator", "ray", "--ray-address", nodes.address], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    wait_for(lambda: rows(folder) >= 1, process)
    process.terminate()
    _, error = process.communicate(timeout=LIMIT)
    assert process.returncode == 143, error
    assert error.decode().splitlines()[-1] == f"bitneat: stopped; continue with: bitneat evolve --resume {folder}"


def test_a_run_survives_kill_9_of_a_worker_and_of_a_node_and_ends_with_the_same_bytes(
    nodes: Nodes, local: Path, tmp_path: Path
) -> None:
    refuses_machines_that_differ_and_names_those_that_fail(nodes)  # here, since a cluster takes long to start
    stops_on_sigterm_as_without_ray(nodes, tmp_path / "stopped")
    folder = tmp_path / "ray"
    command = [sys.executable, "-m", "bitneat", "evolve", *SETTINGS, "-o", str(folder)]
    process = subprocess.Popen(
        [*command, "--evaluator", "ray", "--ray-address", nodes.address], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    worker = wait_for(lambda: rows(folder) >= 1 and nodes.workers_of_other(), process)[0]
    os.kill(worker, signal.SIGKILL)
    killed_at = rows(folder)
    wait_for(lambda: rows(folder) >= killed_at + 2, process)
    os.kill(nodes.other_raylet, signal.SIGKILL)
    assert rows(folder) < 10, "the run was over before the node died"
    _, error = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, error
    for name in ("champion.pkl", "history.csv", "report.json"):
        assert (folder / name).read_bytes() == (local / name).read_bytes(), name


@pytest.mark.parametrize(
    ("address", "knocked"), [("127.0.0.9", "127.0.0.9:6379"), ("ray://127.0.0.9", "ray://127.0.0.9:10001")]
)
def test_an_address_without_a_port_is_knocked_at_where_ray_would_be(
    address: str, knocked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    began = time.monotonic()
    arguments = ["evolve", *SETTINGS, "-o", str(tmp_path / "run"), "--evaluator", "ray", "--ray-address", address]
    assert main(arguments) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"bitneat: --ray-address {knocked}: no cluster: [Errno 111] Connection refused"
    )
    assert time.monotonic() - began < 60


@pytest.mark.parametrize("address", ["auto", "local", "ray://host:7", "10.0.0.7:6379", "[::1]:6379", "http://host/x"])
def test_other_addresses_are_left_alone(address: str) -> None:
    assert clusters._with_port(address) == address
    assert clusters._with_port("[::1]") == "[::1]:6379"


def test_where_there_is_no_cluster_it_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["evolve", *SETTINGS, "-o", str(tmp_path / "run"), "--evaluator", "ray", "--ray-address", "127.0.0.1:1"]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert re.search(r"^bitneat: --ray-address 127\.0\.0\.1:1: no cluster: ", error, re.MULTILINE), error
    assert not (tmp_path / "run").exists()
    assert main(["evolve", "--ray-address", "auto"]) == 2
    assert "--ray-address: only with --evaluator ray" in capsys.readouterr().err


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'bitneat\[cluster\]'"):
        clusters._ray()
