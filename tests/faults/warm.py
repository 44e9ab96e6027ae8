# SPDX-License-Identifier: MIT
"""Runs a scenario again and again in children of one warm process, under the shim, with a fault in each; prints what it found.

    LD_PRELOAD=shim.so python -m tests.faults.warm SCENARIO FOLDER FAULT SAMPLE SEED [PLANT]

FAULT is one of `FAULTS`. SAMPLE points are chosen at random, 0 is all. PLANT is a defect of ours to be found. The last line of the
output is JSON: how many points there are and were tried, and what went wrong, each with what replays it.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import io
import json
import os
import random
import re
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.faults.powerloss import Disk
from tests.faults.scenarios import SCENARIOS, Scenario, use_made_up_episodes

COUNT, KILL, FAIL, FAIL_ON, SHORT = range(5)
TEMPORARY = re.compile(r"\.(.+)\.\d+\.[0-9a-f]{8}\.tmp")
PARTS = 16
"""Places in a write at which it is cut off."""
CRASHED = 70
"""Exit status of a child with a traceback."""

Tree = dict[str, bytes | None]


class Call(NamedTuple):
    """A line of the shim's log."""

    name: str
    path: str
    other: str
    data: bytes


class Point(NamedTuple):
    """Where a fault is: the number of the call, and what the shim is told besides."""

    call: int
    extra: int


def parse(log: bytes) -> list[Call]:
    calls, position = [], 0
    while position < len(log):
        end = log.index(b"\n", position)
        name, path, other, size = log[position:end].decode().split("\t")
        calls.append(Call(name, path, other, log[end + 1 : end + 1 + int(size)]))
        position = end + 1 + int(size)
    return calls


def tree(folder: Path, *, temporary: bool = True) -> Tree:
    """Every file and folder by its path, without temporary ones if they do not count."""
    found: Tree = {}
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if temporary or not any(TEMPORARY.fullmatch(part) for part in relative.parts):
            found[str(relative)] = path.read_bytes() if path.is_file() else None
    return found


def child(action: Callable[[], int], output: Path) -> int:
    """Run in a forked child, its output in a file; the exit status, or minus the number of the signal that ended it."""
    process = os.fork()
    if process == 0:
        status = CRASHED
        try:
            descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            os.dup2(descriptor, 1)
            os.dup2(descriptor, 2)
            status = action()
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            with contextlib.suppress(Exception):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


class Bench:
    """A scenario, its whole run, and the trial of faults."""

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        self.scenario, self.folder = scenario, folder
        self.shim = ctypes.CDLL(None)
        # The same path in every trial: some messages and files have it in them.
        self.place = folder / "place"
        self.output = folder / "output.txt"
        self.failures: list[str] = []
        self.prepared = folder / "prepared"
        self.place.mkdir()
        self.run_unharmed(lambda: self.scenario.prepare(self.place) or 0)
        shutil.copytree(self.place, self.prepared)
        with contextlib.redirect_stderr(
            io.StringIO()
        ):  # once here, for what is imported and opened when it is first used
            assert self.scenario.start(self.place) == 0
        self.calls = self.record()
        self.whole = tree(self.place, temporary=False)
        self.versions = self.written()

    def fresh(self) -> None:
        shutil.rmtree(self.place, ignore_errors=True)
        shutil.copytree(self.prepared, self.place)

    def run_unharmed(self, action: Callable[[], int]) -> None:
        status = child(action, self.output)
        assert status == 0, f"status {status}: {self.output.read_text()}"

    def armed(self, what: int, point: Point, log: int = -1) -> Callable[[], int]:
        def action() -> int:
            self.shim.faults_arm(
                str(self.place).encode(), what, ctypes.c_long(point.call), ctypes.c_long(point.extra), log
            )
            status = self.scenario.start(self.place)
            self.shim.faults_arm(b"", COUNT, ctypes.c_long(0), ctypes.c_long(0), -1)
            return status

        return action

    def record(self) -> list[Call]:
        """The calls of a run without a fault."""
        self.fresh()
        path = self.folder / "log"
        log = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
        self.run_unharmed(self.armed(COUNT, Point(0, 0), log))
        os.close(log)
        return parse(path.read_bytes())

    def written(self) -> dict[str, set[bytes]]:
        """Every content that a file has had at any moment under its own name."""
        versions: dict[str, set[bytes]] = {}
        if not self.scenario.alone:
            return versions
        disk = Disk(self.prepared, self.place)
        for step in (None, *self.calls):
            if step is not None:
                disk.do(step)
            for name, content in disk.current().items():
                if content is not None:
                    versions.setdefault(name, set()).add(content)
        return versions

    def complain(self, text: str) -> None:
        self.failures.append(text)

    def goes_on(self, where: str) -> None:
        """Go on after a fault, and compare the end with that of a whole run."""
        status = child(lambda: self.scenario.go_on(self.place), self.output)
        if status != 0:
            self.complain(f"{where}: went on to status {status}: {self.output.read_text()[-300:]}")
            return
        end = tree(self.place, temporary=self.scenario.leaves_nothing)
        if end != self.whole:
            names = sorted(name for name in {*end, *self.whole} if end.get(name, b"-") != self.whole.get(name, b"-"))
            self.complain(f"{where}: ended otherwise in {', '.join(names)}")

    def is_whole(self, where: str) -> None:
        """Every file is one that a whole run had."""
        if not self.scenario.alone:
            return
        for name, content in tree(self.place, temporary=False).items():
            if content is not None and content not in self.versions.get(name, ()):
                self.complain(f"{where}: {name} is neither the old nor a new one")

    def kill(self, point: Point) -> None:
        where = f"killed at call {point.call} ({self.calls[point.call].name}) after {point.extra} bytes"
        self.fresh()
        status = child(self.armed(KILL, point), self.output)
        if status != -signal.SIGKILL:
            self.complain(f"{where}: status {status}: {self.output.read_text()[-300:]}")
        self.is_whole(where)
        self.goes_on(where)

    def fail(self, point: Point, what: int) -> None:
        """A call fails, or it and all after it: one line that names a file, and nothing lost."""
        called = self.calls[point.call].name
        where = f"{errno.errorcode[point.extra]} {'from' if what == FAIL_ON else 'at'} call {point.call} ({called})"
        self.fresh()
        status = child(self.armed(what, point), self.output)
        said = self.output.read_text()
        lines = [line for line in said.splitlines() if line.startswith("bitneat: ")]
        if status == 2:
            if len(lines) != 1 or str(self.place) not in lines[0] or os.strerror(point.extra) not in lines[0]:
                self.complain(f"{where}: said {said[-300:]!r}")
        elif status != 0:
            self.complain(f"{where}: status {status}: {said[-300:]}")
        if status == 0 and tree(self.place, temporary=False) != self.whole:
            self.complain(f"{where}: went well, and otherwise")
        self.is_whole(where)
        self.goes_on(where)

    def goes_well(self, point: Point, what: int) -> None:
        """Short writes and interrupted calls are no faults."""
        self.fresh()
        status = child(self.armed(what, point), self.output)
        if status != 0 or tree(self.place, temporary=False) != self.whole:
            self.complain(
                f"call {point.call}, {what}, {point.extra}: status {status}: {self.output.read_text()[-300:]}"
            )

    def lose_power(self, point: Point) -> None:
        """What a disk holds on which only what was synced is sure to be (0), or every name but only synced content (1)."""
        disk = Disk(self.prepared, self.place)
        for call in self.calls[: point.call]:
            disk.do(call)
        shutil.rmtree(self.place, ignore_errors=True)
        disk.put(disk.after_power_loss(names=bool(point.extra)), self.place)
        where = f"power lost before call {point.call}, {'all names' if point.extra else 'only synced names'} kept"
        self.is_whole(where)
        self.goes_on(where)

    def points(self, fault: str) -> Iterator[Point]:
        for number, call in enumerate(self.calls):
            size = len(call.data)
            if fault == "kill" and call.name == "write":
                parts = {0, 1, size - 1, *(size * part // (PARTS - 3) for part in range(1, PARTS - 2))}
                yield from (Point(number, part) for part in sorted(parts))
            elif fault == "kill":
                yield Point(number, 0)
            elif fault == "power":
                yield from (Point(number, 0), Point(number, 1))
            elif fault in ("error", "errors"):
                yield from (Point(number, code) for code in (errno.ENOSPC, errno.EIO, errno.EROFS))
            elif fault == "interrupt" and call.name in ("write", "fsync", "create"):
                yield Point(number, errno.EINTR)
        if fault == "short":
            yield from (Point(0, size) for size in (1, 7, 100))


FAULTS: dict[str, Callable[[Bench, Point], None]] = {
    "kill": Bench.kill,
    "power": Bench.lose_power,
    "error": lambda bench, point: bench.fail(point, FAIL),
    "errors": lambda bench, point: bench.fail(point, FAIL_ON),
    "interrupt": lambda bench, point: bench.goes_well(point, FAIL),
    "short": lambda bench, point: bench.goes_well(point, SHORT),
}


def plant(defect: str) -> None:
    """A defect that the trial must find."""
    from bitneat import files

    if defect == "in place":
        files._replace = lambda target, content, mode: target.write_bytes(content) and None  # type: ignore[assignment]
    elif defect == "unsynced":
        files.os.fsync = lambda descriptor: None  # type: ignore[assignment]
    else:
        assert not defect


def run(name: str, folder: Path, fault: str, sample: int, seed: int, defect: str) -> dict[str, object]:
    use_made_up_episodes()
    plant(defect)
    bench = Bench(SCENARIOS[name], folder)
    points = list(bench.points(fault))
    chosen = points if not sample else random.Random(seed).sample(points, min(sample, len(points)))
    for point in chosen:
        FAULTS[fault](bench, point)
    return {"calls": len(bench.calls), "points": len(points), "tried": len(chosen), "failures": bench.failures}


if __name__ == "__main__":
    scenario, place, fault, sample, seed, defect = (*sys.argv[1:], "")[:6]
    print(json.dumps(run(scenario, Path(place), fault, int(sample), int(seed), defect)))
