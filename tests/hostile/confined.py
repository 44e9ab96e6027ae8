# SPDX-License-Identifier: MIT
"""A command in a child that may take little memory and time, and that is watched for what no loader does."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bitneat.cli.main import main

MEMORY = 1 << 30
"""Bytes of address space beyond what the parent has."""
SECONDS = 20
"""Of processor time."""

FORBIDDEN = (
    "os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "pickle.find_class"
)  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    """Exit status, or minus the number of the signal."""
    errors: str
    seconds: float
    forbidden: str
    """What it did that no loader does, a line each."""


def confined(arguments: Sequence[str], folder: Path) -> Ended:
    """Run ``bitneat`` with these arguments in ``folder``, where alone it may write."""
    errors, watched = folder / ".errors", folder / ".watched"
    began = time.monotonic()
    process = os.fork()
    if process == 0:
        status = 70
        try:
            os.chdir(folder)
            for path, number in ((errors, 2), (Path(os.devnull), 1)):
                os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600), number)
            sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
            sys.dont_write_bytecode = True
            _limit()
            _watch(folder, os.open(watched, os.O_WRONLY | os.O_CREAT, 0o600))
            status = main(list(arguments))
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    ended = Ended(status, errors.read_text(), time.monotonic() - began, watched.read_text() if watched.exists() else "")
    errors.unlink(missing_ok=True)
    watched.unlink(missing_ok=True)
    return ended


def _limit() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    space = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
    used = int(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used + SECONDS, used + SECONDS + 1))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(3 * SECONDS)  # of waiting, for a pipe, say


def _watch(folder: Path, log: int) -> None:
    inside = str(folder.resolve())

    def look(event: str, arguments: tuple[object, ...]) -> None:
        if event in FORBIDDEN:
            os.write(log, f"{event} {arguments!r:.200}\n".encode())
        elif event == "open":
            path, _, flags = arguments
            writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR)
            if (
                writes
                and isinstance(path, str)
                and not os.path.realpath(path).startswith((inside, "/dev/", "/proc/self"))
            ):
                os.write(log, f"writes {path}\n".encode())

    sys.addaudithook(look)
