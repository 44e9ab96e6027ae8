# SPDX-License-Identifier: MIT
"""Ctrl-C and SIGTERM end a command alike, wherever it is when they come."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_SECONDS = 0.02
"""After which what was lost in a destructor is sent again: the destructor has ended, and nobody has noticed a delay."""


class TerminatedError(KeyboardInterrupt):
    """SIGTERM, which ends a command as Ctrl-C does: children ended, checkpoints kept, the terminal as it was."""


@contextmanager
def interrupts_arrive() -> Iterator[None]:
    """SIGTERM raises `TerminatedError` meanwhile, unless whoever runs this has other plans for it, and neither signal gets lost.

    Python ignores what is raised in a destructor, of which a simulator has many. An interrupt that comes in one is sent again.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours = signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    ignored = sys.unraisablehook
    waiting: list[threading.Timer] = []

    def stop(number: int, frame: object) -> NoReturn:
        del number, frame
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the second one ends what the first could not
        raise TerminatedError

    def send_again(lost: UnraisableHookArgs) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt):
            ignored(lost)
            return
        number = signal.SIGINT
        if isinstance(lost.exc_value, TerminatedError):
            number = signal.SIGTERM
            signal.signal(number, stop)
        later = threading.Timer(_AGAIN_SECONDS, os.kill, (os.getpid(), number))
        later.daemon = True
        later.start()
        waiting.append(later)

    if ours:
        signal.signal(signal.SIGTERM, stop)
    sys.unraisablehook = send_again
    try:
        yield
    finally:
        sys.unraisablehook = ignored
        for later in waiting:  # the command has ended in another way meanwhile
            later.cancel()
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
