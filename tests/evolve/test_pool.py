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
    if number == -5:
        time.sleep(60)
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


def test_what_ended_early_leaves_nothing_for_the_next(pool: WorkerPool) -> None:
    with pytest.raises(BitneatError, match="refused"):
        list(pool.map([-1, 1, 2, 3]))
    assert [number for number, _ in pool.map([10, 11, 12, 13])] == [10, 11, 12, 13]
    left = pool.map([20, 21, 22, 23, 24])  # which is held, as a notebook holds what an exception went through
    assert next(left)[0] == 20
    assert [number for number, _ in pool.map([30, 31, 32])] == [30, 31, 32]
    with pytest.raises(BitneatError, match="gone on to other jobs"):
        next(left)
    assert [number for number, _ in pool.map([40, 41, 42])] == [40, 41, 42]
    over, other = pool.map([50]), pool.map([60, 61, 62])
    assert [next(over)[0], next(other)[0]] == [50, 60]
    assert not list(over)  # its end comes late, and is nothing to the other
    assert [number for number, _ in other] == [61, 62]


def test_it_goes_on_after_an_interrupt_and_after_a_death(pool: WorkerPool) -> None:
    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        with pytest.raises(KeyboardInterrupt):
            list(pool.map([-5, -5, 1, 2]))
    finally:
        signal.signal(signal.SIGALRM, before)
    assert [number for number, _ in pool.map([10, 11, 12])] == [10, 11, 12]
    with pytest.raises(BitneatError, match="died"):
        list(pool.map([-3, 1]))
    assert [number for number, _ in pool.map([20, 21, 22])] == [20, 21, 22]


def test_whoever_does_not_ask_for_the_end_keeps_the_processes(pool: WorkerPool) -> None:
    assert len({next(pool.map([number]))[1] for number in range(6)}) <= 2


def test_a_closed_pool_says_so() -> None:
    pool = WorkerPool(job, 1)
    pool.close()
    with pytest.raises(BitneatError, match="are closed"):
        list(pool.map([1]))
    pool.close()
