# SPDX-License-Identifier: MIT
"""A process that is started to work for another ends with it, however the other ends, and not by Ctrl-C.

A parent that is killed by SIGKILL cannot end its children. `multiprocessing` gives each child the end of a pipe that closes with
its parent, on every system, so a thread that waits for it is enough; that thread runs while the work is in native code, too,
as such calls let go of the interpreter.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from multiprocessing.connection import wait

EXIT_STATUS = 1


def end_with_parent() -> None:
    """From now on end this process, at once and without a word, when the one that started it is gone.

    Files that `bitneat.files.write_atomic` was about to replace stay as they are. In a process that `multiprocessing` did not
    start there is nothing to wait for, and nothing happens.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_for, args=(parent.sentinel,), name="parent", daemon=True).start()


@contextlib.contextmanager
def children_ignore_interrupts() -> Iterator[None]:
    """What is started meanwhile ignores SIGINT from its first instruction on, so that Ctrl-C cannot interrupt its imports.

    The terminal sends it to all processes; the parent ends its children. Python lets only the main thread say so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _wait_for(sentinel: int) -> None:
    wait([sentinel])
    os._exit(EXIT_STATUS)
