# SPDX-License-Identifier: MIT
"""Processes that stay, take jobs and give results back in order.

The standard library's pools either hang when a worker is killed or print tracebacks when the user presses Ctrl-C. Here workers
ignore SIGINT, which reaches the whole process group, and end with their parent, however it died, in the middle of a job too.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from bitneat.errors import BitneatError
from bitneat.orphans import end_with_parent

_AHEAD = 2
"""Jobs a worker has at a time, so that it need not wait for the next."""


class WorkerPool:
    """``workers`` processes that apply one function.

    Args:
        function: picklable; a `BitneatError` that it raises comes out of `map`.
        workers: at least one.
    """

    def __init__(self, function: Callable[[Any], Any], workers: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._workers: list[tuple[Any, Connection]] = []
        in_main_thread = threading.current_thread() is threading.main_thread()
        # A worker inherits that SIGINT is ignored, so that not even its start can be interrupted.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main_thread else None
        try:
            for _ in range(workers):
                ours, theirs = context.Pipe()
                process = context.Process(target=_work, args=(theirs, function), daemon=True)
                process.start()
                theirs.close()
                self._workers.append((process, ours))
        except BaseException:
            self.close()
            raise
        finally:
            if in_main_thread:
                signal.signal(signal.SIGINT, before)

    def map(self, jobs: Sequence[Any]) -> Iterator[Any]:
        """The results in the order of the jobs; ``jobs`` go to whichever worker is free.

        Raises:
            BitneatError: if a job raised it, or a worker died.
        """
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

    def close(self) -> None:
        """Stop all processes, at once."""
        for process, connection in self._workers:
            connection.close()
            process.terminate()
        for process, _ in self._workers:
            process.join(5)
            if process.is_alive():
                process.kill()
                process.join()
        self._workers = []

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
