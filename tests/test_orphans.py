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
def test_the_job_of_a_reproduction_ends_with_it(tmp_path: Path, number: int, status: int) -> None:
    folder = tmp_path / "paper"
    arguments = ["reproduce", "--budget", "smoke", "-o", str(folder), "--workers", "1", "--only", "bit-1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "bitneat", *arguments], start_new_session=True, stderr=subprocess.PIPE
    )
    checkpoints = folder / "runs" / "bit-1" / "checkpoints"
    wait_for((checkpoints / "generation-000001.json").exists, process)
    os.kill(process.pid, number)  # to the parent alone
    _, errors = process.communicate(timeout=60)
    assert process.returncode == status
    assert_all_gone(process.pid)
    assert not list((folder / "results").iterdir())  # it did not run on to its end
    if number == signal.SIGTERM:
        assert errors.splitlines()[-1] == b"bitneat: stopped; the same command goes on"
        assert b"Traceback" not in errors
    saved = list(checkpoints.glob("generation-*.json"))
    assert saved
    for path in saved:
        json.loads(path.read_text())


def test_an_interrupt_while_the_jobs_of_a_reproduction_start_is_one_line(tmp_path: Path) -> None:
    arguments = ["reproduce", "--budget", "smoke", "-o", str(tmp_path / "paper"), "--workers", "1", "--only", "bit-1"]
    # A handler, since what ignores SIGINT in here, as a shell's background does, would be inherited.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "bitneat", *arguments], start_new_session=True, stderr=subprocess.PIPE
        )
    finally:
        signal.signal(signal.SIGINT, before)

    def starting() -> bool:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        return any(b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes() for child in children)

    wait_for(starting, process)
    time.sleep(0.1)  # the parent is done with the start, its job imports yet
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"Traceback" not in errors
    assert errors.splitlines()[-1] == b"bitneat: stopped; the same command goes on"
    assert_all_gone(process.pid)
