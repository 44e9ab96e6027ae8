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
GENERATIONS = 60


def completed(run: Path) -> int:
    """Generations, by the newest checkpoint."""
    return max((int(path.stem.split("-")[1]) for path in (run / "checkpoints").glob("generation-*.json")), default=0)


def kill_after(process: subprocess.Popen[bytes], seconds: float) -> None:
    with pytest.raises(subprocess.TimeoutExpired):  # or the run has ended by itself
        process.wait(seconds)
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
    began = time.monotonic()
    assert start(*common, *means, "-o", str(whole)).wait(600) == 0
    took = time.monotonic() - began
    moments, reached = random.Random(SEED), []
    for _ in range(KILLS):
        resumed = (killed / "run.json").exists()
        arguments = ["--resume", str(killed)] if resumed else [*common, "-o", str(killed)]
        # The start and a share of the run, on average, so that the kills spread over all of it.
        kill_after(start(*arguments, *means), moments.uniform(0.5, 1.5) * (1.5 + (took - 1.5) / (KILLS + 2)))
        reached.append(completed(killed))
    print(f"{simulator}: seed {SEED}, killed after generations {reached} of {GENERATIONS}")
    assert 0 < reached[-1] < GENERATIONS
    assert len(set(reached)) >= KILLS // 2
    assert start("--resume", str(killed), "--workers", "1").wait(600) == 0
    names = sorted(str(path.relative_to(whole)) for path in whole.rglob("*") if path.is_file())
    assert names == sorted(str(path.relative_to(killed)) for path in killed.rglob("*") if path.is_file())
    for name in names:
        assert (killed / name).read_bytes() == (whole / name).read_bytes(), name
