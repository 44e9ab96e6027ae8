# SPDX-License-Identifier: MIT
"""Whatever ends a command, its processes end with it, and what it had saved is whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.evolve.test_run import assert_all_gone, wait_for

BUSY_POOL = """
import sys, time
from bitneat.evolve.pool import WorkerPool

def job(name):
    open(name, "w").close()
    time.sleep(600)

if __name__ == "__main__":
    pool = WorkerPool(job, 2)
    list(pool.map(sys.argv[1:]))
"""


def test_a_worker_ends_in_the_middle_of_a_job_when_its_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "busy.py"
    script.write_text(BUSY_POOL)
    begun = [tmp_path / "first", tmp_path / "second"]
    process = subprocess.Popen([sys.executable, str(script), *map(str, begun)], start_new_session=True)
    wait_for(lambda: all(path.exists() for path in begun), process)
    process.kill()
    process.wait()
    assert_all_gone(process.pid)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGKILL, -9), (signal.SIGTERM, 143)])
def test_the_jobs_of_a_reproduction_end_with_it(tmp_path: Path, number: int, status: int) -> None:
    folder = tmp_path / "paper"
    arguments = ["reproduce", "--budget", "hour", "-o", str(folder), "--workers", "2"]
    only = ["--only", "bit-1", "--only", "default-1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "bitneat", *arguments, *only],
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    checkpoints = [folder / "runs" / name / "checkpoints" / "generation-000001.json" for name in ("bit-1", "default-1")]
    wait_for(lambda: all(path.exists() for path in checkpoints), process)
    os.kill(process.pid, number)
    sent = time.monotonic()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == status
    assert_all_gone(process.pid)
    assert time.monotonic() - sent < 10
    if number == signal.SIGTERM:
        assert errors == b"bitneat: stopped; the same command goes on\n"
    for checkpoint in checkpoints:  # those that are there are whole
        for path in checkpoint.parent.glob("generation-*.json"):
            json.loads(path.read_text())
