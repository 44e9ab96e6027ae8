# SPDX-License-Identifier: MIT
"""The pool of workers: order, errors, deaths."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from bitneat.errors import BitneatError
from bitneat.evolve.pool import WorkerPool


def job(number: int) -> tuple[int, int]:
    if number == -1:
        raise BitneatError("episode: refused")
    if number == -2:
        raise ZeroDivisionError("by zero")
    if number == -3:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == -4:
        os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.001 * (number % 5))
    return number, os.getpid()


@pytest.fixture
def pool() -> Iterator[WorkerPool]:
    pool = WorkerPool(job, 2)
    yield pool
    pool.close()


def test_results_come_in_the_order_of_the_jobs_from_all_workers(pool: WorkerPool) -> None:
    for _ in range(2):
        results = list(pool.map(range(60)))
        assert [number for number, _ in results] == list(range(60))
        assert len({process for _, process in results}) == 2
    assert list(pool.map([])) == []


def test_errors_come_out_in_one_line(pool: WorkerPool) -> None:
    with pytest.raises(BitneatError, match="episode: refused"):
        list(pool.map([1, -1, 2]))


def test_unexpected_errors_are_named(pool: WorkerPool) -> None:
    with pytest.raises(BitneatError, match="ZeroDivisionError: by zero"):
        list(pool.map([-2]))


def test_a_killed_worker_is_an_error_and_not_a_hang(pool: WorkerPool) -> None:
    with pytest.raises(BitneatError, match="a worker process died"):
        list(pool.map([1, 2, -3, 3, 4]))


def test_workers_ignore_the_interrupt_that_the_terminal_sends_to_all(pool: WorkerPool) -> None:
    assert len(list(pool.map([-4, 1, 2, -4, 3]))) == 5


def test_no_process_is_left_after_close() -> None:
    pool = WorkerPool(job, 2)
    processes = {process for _, process in pool.map(range(20))}
    pool.close()
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
