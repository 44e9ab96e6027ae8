# SPDX-License-Identifier: MIT
"""Walks a recorded trace over a firmware's serial line and compares every bit of every answer.

    python walk.py trace.txt -- COMMAND...

COMMAND's standard input and output are the serial line: an emulator, or for a board on a port such as
``socat - /dev/ttyACM0,b115200,raw,echo=0``. A trace has a step a line, observation and action as frames (frame.h). Exit
status 0 if every answer is the recorded one, 1 if not, 2 if the firmware or the trace is not what was expected.
"""

from __future__ import annotations

import re
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

SECONDS_TO_START = 30.0
SECONDS_TO_ANSWER = 10.0
GREETING = "tiny ready"

_STEP = re.compile(r"((?:[0-9a-f]{4})+) ((?:[0-9a-f]{4})+)")


class WalkError(Exception):
    """The walk cannot go on; the message says why."""


def read_trace(path: Path) -> list[tuple[str, str]]:
    """Every step's observation and action, as frames."""
    steps = []
    for number, line in enumerate(path.read_text(encoding="ascii").splitlines(), start=1):
        found = _STEP.fullmatch(line)
        if found is None:
            raise WalkError(f"{path}:{number}: expected an observation and an action in hexadecimal digits")
        steps.append((found[1], found[2]))
    if not steps:
        raise WalkError(f"{path}: no step in it")
    return steps


class Line:
    """A serial line to a process."""

    def __init__(self, command: Sequence[str]) -> None:
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self._waiting = b""

    def send(self, text: str) -> None:
        """Send a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(text.encode("ascii") + b"\n")

    def receive(self, seconds: float) -> str:
        """The next line, within so many seconds."""
        assert self._process.stdout is not None
        end = time.monotonic() + seconds
        while b"\n" not in self._waiting:
            ready, _, _ = select.select([self._process.stdout], [], [], max(end - time.monotonic(), 0.0))
            if not ready:
                raise WalkError(f"no answer within {seconds:g} seconds")
            part = self._process.stdout.read(4096)
            if not part:
                raise WalkError(f"the firmware's emulator ended with status {self._process.wait()}")
            self._waiting += part
        line, self._waiting = self._waiting.split(b"\n", 1)
        return line.decode("ascii", "replace").rstrip("\r")

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait()


def walk(line: Line, steps: Sequence[tuple[str, str]]) -> int:
    """Walk the trace; the number of steps whose answer differs, each printed."""
    said = line.receive(SECONDS_TO_START)
    if said != GREETING:
        raise WalkError(f"expected {GREETING!r} after the start, got {said!r}")
    differing = 0
    for number, (observation, action) in enumerate(steps, start=1):
        line.send(observation)
        answer = line.receive(SECONDS_TO_ANSWER)
        if answer != action:
            differing += 1
            print(f"step {number}: expected {action}, got {answer}")
    return differing


def main(arguments: Sequence[str]) -> int:
    """Run the command line; the exit status."""
    if len(arguments) < 3 or arguments[1] != "--":
        print("usage: walk.py TRACE -- COMMAND...", file=sys.stderr)
        return 2
    try:
        steps = read_trace(Path(arguments[0]))
        line = Line(arguments[2:])
        try:
            differing = walk(line, steps)
        finally:
            line.close()
    except (WalkError, OSError) as error:
        print(f"walk: {error}", file=sys.stderr)
        return 2
    print(f"{len(steps)} steps, {differing} with another answer than the recorded one")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
