# SPDX-License-Identifier: MIT
"""A whole run of ``bitneat evolve`` that is killed with kill -9 at ten random moments, all of its processes at once."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.evolve.test_run import SMALL, assert_all_gone, start
from tests.faults.test_faults import SEED

KILLS = 10
GENERATIONS = 90
LAST = 60
"""Kills begin to wait for no later generation."""


def completed(run: Path) -> int:
    """Generations, by the newest checkpoint."""
    return max((int(path.stem.split("-")[1]) for path in (run / "checkpoints").glob("generation-*.json")), default=0)


def kill_after(process: subprocess.Popen[bytes], run: Path, generation: int, seconds: float) -> None:
    """Kill so long after a checkpoint, whatever a generation takes on this machine at this time."""
    limit = time.monotonic() + 600
    while completed(run) < generation:
        assert process.poll() is None, "ended by itself"
        assert time.monotonic() < limit
        time.sleep(0.002)
    time.sleep(seconds)
    assert process.poll() is None, "ended by itself"
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert_all_gone(process.pid)


@pytest.mark.long
@pytest.mark.parametrize("simulator", ["native", "gymnasium"])
def test_a_run_killed_at_ten_random_moments_ends_byte_identical(tmp_path: Path, simulator: str) -> None:
    config = tmp_path / "small.ini"
    config.write_text(
        SMALL.replace("generations = 4", f"generations = {GENERATIONS}").replace("max_steps = 60", "max_steps = 200")
    )
    common = ["--env", "BipedalWalker-v3", "--config", str(config), "--seed", "7"]
    means = ["--workers", "2", "--simulator", simulator]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert start(*common, *means, "-o", str(whole)).wait(600) == 0
    moments, reached = random.Random(SEED), []
    for done in range(KILLS):
        resumed = (killed / "run.json").exists()
        arguments = ["--resume", str(killed)] if resumed else [*common, "-o", str(killed)]
        # Some in the start, the others all over the run, and none so late that it could have ended.
        before = completed(killed)
        generation = before + moments.randint(0, max(LAST - before, 0) * 2 // (KILLS - done + 1))
        kill_after(start(*arguments, *means), killed, generation, moments.uniform(0.0, 0.5))
        reached.append(completed(killed))
    print(f"{simulator}: seed {SEED}, killed after generations {reached} of {GENERATIONS}")
    assert 0 < reached[-1] < GENERATIONS
    assert len(set(reached)) >= KILLS // 2
    assert start("--resume", str(killed), "--workers", "1").wait(600) == 0
    names = sorted(str(path.relative_to(whole)) for path in whole.rglob("*") if path.is_file())
    assert names == sorted(str(path.relative_to(killed)) for path in killed.rglob("*") if path.is_file())
    for name in names:
        assert (killed / name).read_bytes() == (whole / name).read_bytes(), name
