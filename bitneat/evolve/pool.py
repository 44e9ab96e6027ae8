# SPDX-License-Identifier: MIT
"""Processes that stay, take jobs and give results back in order.

The standard library's pools either hang when a worker is killed or print tracebacks when the user presses Ctrl-C. Here workers
ignore SIGINT, which reaches the whole process group, and end with their parent, however it died, in the middle of a job too.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from bitneat.errors import BitneatError
from bitneat.orphans import children_ignore_interrupts, end_with_parent

_AHEAD = 2
"""Jobs a worker has at a time, so that it need not wait for the next."""


class WorkerPool:
    """``workers`` processes that apply one function.

    Args:
        function: picklable; a `BitneatError` that it raises comes out of `map`.
        workers: at least one.
    """

    def __init__(self, function: Callable[[Any], Any], workers: int) -> None:
        self._function = function
        self._count = workers
        self._closed = False
        self._turn: object | None = None
        """The `map` that has jobs at the workers."""
        self._workers: list[tuple[Any, Connection]] = []
        self._start()

    def map(self, jobs: Sequence[Any]) -> Iterator[Any]:
        """The results in the order of the jobs; ``jobs`` go to whichever worker is free.

        Whatever ends it before its last result, an error, Ctrl-C or who stops asking, ends the workers too: they have jobs of it,
        and a message may be cut in two. The next `map` starts others.

        Raises:
            BitneatError: if a job raised it, a worker died, or the pool is closed.
        """
        if self._closed:
            raise BitneatError("the worker processes are closed; an evaluator is of no use after close()")
        if self._turn is not None:  # one that was left in the middle, and that something still holds
            self._stop()
        self._turn = turn = object()
        try:
            if not self._workers:
                self._start()
            for number, result in enumerate(self._results(jobs), start=1):
                if number == len(jobs):
                    self._turn = None  # nothing is left at the workers, whether or not anybody asks for an end
                yield result
                if number < len(jobs) and self._turn is not turn:
                    raise BitneatError("the worker processes have gone on to other jobs")
            if not jobs:
                self._turn = None
        except BaseException:
            if self._turn is turn:
                self._stop()
            raise

    def close(self) -> None:
        """Stop all processes, at once."""
        self._closed = True
        self._stop()

    def _results(self, jobs: Sequence[Any]) -> Iterator[Any]:
        results: dict[int, Any] = {}
        queue = iter(enumerate(jobs))
        load = {connection: 0 for _, connection in self._workers}
        for _ in range(_AHEAD):
            for connection in load:
                self._give(connection, queue, load)
        for index in range(len(jobs)):
            while index not in results:
                for ready in wait([connection for connection, count in load.items() if count]):
                    assert isinstance(ready, Connection)
                    number, result, error = self._take(ready)
                    if error is not None:
                        raise BitneatError(error)
                    results[number] = result
                    load[ready] -= 1
                    self._give(ready, queue, load)
            yield results.pop(index)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        try:
            with children_ignore_interrupts():
                for _ in range(self._count):
                    ours, theirs = context.Pipe()
                    process = context.Process(target=_work, args=(theirs, self._function), daemon=True)
                    process.start()
                    theirs.close()
                    self._workers.append((process, ours))
        except BaseException:
            self._stop()
            raise

    def _stop(self) -> None:
        for process, connection in self._workers:
            connection.close()
            process.terminate()
        for process, _ in self._workers:
            process.join(5)
            if process.is_alive():
                process.kill()
                process.join()
        self._workers = []
        self._turn = None

    def _give(self, connection: Connection, queue: Iterator[tuple[int, Any]], load: dict[Connection, int]) -> None:
        job = next(queue, None)
        if job is not None:
            try:
                connection.send(job)
            except OSError:
                raise BitneatError(self._epitaph(connection)) from None
            load[connection] += 1

    def _take(self, connection: Connection) -> tuple[int, Any, str | None]:
        try:
            answer: tuple[int, Any, str | None] = connection.recv()
        except (EOFError, OSError):
            raise BitneatError(self._epitaph(connection)) from None
        return answer

    def _epitaph(self, connection: Connection) -> str:
        for process, own in self._workers:
            if own is connection:
                process.join(5)
                return f"a worker process died (exit status {process.exitcode}); --resume continues from the last checkpoint"
        return "a worker process died"


def _work(connection: Connection, function: Callable[[Any], Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    try:
        while True:
            number, job = connection.recv()
            try:
                answer: tuple[int, Any, str | None] = (number, function(job), None)
            except BitneatError as error:
                answer = (number, None, str(error))
            except Exception as error:
                answer = (number, None, f"a job failed: {type(error).__name__}: {' '.join(str(error).split())}")
            connection.send(answer)
    except (EOFError, OSError):
        pass  # the parent is gone or done with us
