# SPDX-License-Identifier: MIT
"""Runs chosen tests in a forked child of a process that has the libraries imported, but nothing of the project.

A mutant costs a fork and the import of the project, a fraction of a second, instead of the seconds that a new interpreter
takes to import NumPy, Gymnasium and pytest. The child imports the project from a copy of the checkout, so a mutant is a
changed file, and processes that the tests start see it too.
"""

from __future__ import annotations

import importlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_OURS = ("bitneat", "tests", "tools", "benchmarks", "conftest")


@dataclass(frozen=True)
class Verdict:
    """How a run of tests ended: ``passed``, ``failed`` (``test`` is the first that did), ``error``, ``timeout`` or ``none``."""

    outcome: str
    test: str
    seconds: float

    @property
    def caught(self) -> bool:
        """Whether the tests saw the mutant."""
        return self.outcome in ("failed", "error", "timeout")


def copy_of_checkout(folder: Path) -> None:
    """The files that git knows of, or would, in a folder."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        source, target = ROOT / name, folder / name
        if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)


class Runner:
    """Runs tests of a copy of the checkout.

    Args:
        copy: the folder of the copy; becomes the working folder of this process.
        test_files: those whose imports are made once, here.
    """

    def __init__(self, copy: Path, test_files: Sequence[str]) -> None:
        self.copy = copy
        os.chdir(copy)
        sys.path[:] = [str(copy), *(p for p in sys.path if p not in ("", str(ROOT)))]
        os.environ["PYTHONPATH"] = str(copy)
        # Kept from run to run; it is by contents, so that no mutant is taken for another.
        os.environ["BITNEAT_CACHE_DIR"] = str(ROOT / "build" / "mutation-cache")
        for name in self._libraries(test_files):
            with suppress(Exception):
                importlib.import_module(name)
        for name in [name for name in sys.modules if name.split(".")[0] in _OURS]:
            del sys.modules[name]
        importlib.invalidate_caches()
        # What is imported from now on may be a mutant.
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"

    def _libraries(self, test_files: Sequence[str]) -> list[str]:
        """What the tests import that is not the project's; collecting them also leaves their compiled forms behind."""
        listing = self.copy / "build" / "libraries.txt"
        listing.parent.mkdir(exist_ok=True)
        child = os.fork()
        if child == 0:
            _silence()
            for name in [name for name in sys.modules if name.split(".")[0] in _OURS]:
                del sys.modules[name]
            pytest.main([*_QUIET, "--collect-only", *test_files])
            names = [name for name in sys.modules if name.split(".")[0] not in _OURS]
            listing.write_text("\n".join(names))
            os._exit(0)
        os.waitpid(child, 0)
        return listing.read_text().splitlines()

    def run(self, tests: Sequence[str], limit: float) -> Verdict:
        """Run tests, given by their names in that order, up to the first failure.

        Args:
            tests: names as pytest has them, ``tests/x/test_y.py::test_z[case]``.
            limit: seconds after which they count as hanging.
        """
        if not tests:
            return Verdict("none", "", 0.0)
        report = self.copy / "build" / "first-failure.txt"
        report.unlink(missing_ok=True)
        start = time.monotonic()
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            _silence()
            status = 3
            try:
                files = list(dict.fromkeys(test.split("::")[0] for test in tests))
                status = int(pytest.main([*_QUIET, "-x", *files], plugins=[_Chosen(tests, report)]))
            finally:
                os._exit(status)
        status = _wait(child, limit)
        seconds = time.monotonic() - start
        test = report.read_text() if report.is_file() else ""
        if status is None:
            return Verdict("timeout", test, seconds)
        outcome = {0: "passed", 1: "failed", 5: "none"}.get(status, "error")
        return Verdict(outcome, test, seconds)


_QUIET = (
    "-q",
    "--no-header",
    "--tb=no",
    "-p",
    "no:cacheprovider",
    "-p",
    "no:xdist",
    "-p",
    "no:cov",
    "-p",
    "no:randomly",
)


class _Chosen:
    """Keeps the chosen tests of what was collected, in their order, and notes the first that fails."""

    def __init__(self, tests: Collection[str], report: Path) -> None:
        self._place = {test: place for place, test in enumerate(tests)}
        self._report = report

    def pytest_collection(self) -> None:
        # After the profile of conftest.py is loaded and before a test is imported. A failure is enough, however long it is.
        from hypothesis import Phase, settings

        settings.register_profile("mutation", settings(), phases=(Phase.explicit, Phase.generate))
        settings.load_profile("mutation")

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self._place), key=lambda item: self._place[item.nodeid]
        )

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self._report.exists():
            self._report.write_text(report.nodeid)


def _silence() -> None:
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)


def _wait(child: int, limit: float) -> int | None:
    """The exit status of a child; None if it took too long and was ended, with all that it started."""
    end = time.monotonic() + limit
    pause = 0.01
    status: int | None = None
    while time.monotonic() < end:
        done, code = os.waitpid(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(code)
            break
        time.sleep(pause)
        pause = min(2 * pause, 0.1)
    # A mutant may leave processes of its own behind.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    if status is None:
        os.waitpid(child, 0)
    return status


def in_order(tests: Iterable[str], durations: dict[str, float], most_seconds: float) -> list[str]:
    """Tests whose times together stay within ``most_seconds``.

    Of each function the fastest case goes first, then the second fastest of each, and so on: cases of one function tend to
    see the same mutants.
    """
    seen: dict[str, int] = {}
    ranked = []
    for test in sorted(tests, key=lambda test: (durations.get(test, 1.0), test)):
        function = test.split("[")[0]
        seen[function] = seen.get(function, -1) + 1
        ranked.append((seen[function], durations.get(test, 1.0), test))
    chosen: list[str] = []
    total = 0.0
    for _, seconds, test in sorted(ranked):
        if chosen and total + seconds > most_seconds:
            continue
        total += seconds
        chosen.append(test)
    return chosen
