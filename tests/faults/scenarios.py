# SPDX-License-Identifier: MIT
"""What is killed: commands that write, in a folder of their own, and what a user does afterwards.

Each is a real command line in this process; only the episodes are made up (a reward of the controller's hash and the seed), so
that a whole run takes a fraction of a second.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bitneat.cli.evolve
import bitneat.cli.linear
import bitneat.cli.polish
from bitneat.cli.main import main
from bitneat.native import build
from bitneat.sim.environment import EpisodeResult
from tests.small import small_search

ROOT = Path(__file__).resolve().parents[2]
TINY = ROOT / "examples" / "champions" / "tiny.pkl"
CONFIGURATION = small_search(4, 8)


class MadeUp:
    """An evaluator whose rewards depend on controller and seed alone."""

    def evaluate(
        self, controllers: Sequence[Any], seeds: Sequence[int], shaping: Any = None
    ) -> list[list[EpisodeResult]]:
        return [[self.episode(sha256, seed) for seed in seeds] for sha256 in (one.sha256 for one in controllers)]

    def episode(self, sha256: str, seed: int) -> EpisodeResult:
        reward = zlib.crc32(f"{sha256} {seed}".encode()) / 2**32
        return EpisodeResult(reward, reward, 10, True, False)

    def close(self) -> None:
        pass


def use_made_up_episodes() -> None:
    for module in (bitneat.cli.evolve, bitneat.cli.linear, bitneat.cli.polish):
        module.evaluator_for = lambda *arguments: (MadeUp(), None)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Scenario:
    """A command and how to go on after it died; all in a folder that is empty before ``prepare``."""

    start: Callable[[Path], int]
    go_on: Callable[[Path], int]
    prepare: Callable[[Path], None] = lambda folder: None
    leaves_nothing: bool = True
    """Whether going on takes away the temporary files, too."""
    alone: bool = True
    """Whether this process writes everything itself, so that its log says all."""


def quietly(*arguments: str) -> int:
    """A command of which only errors are seen."""
    with contextlib.redirect_stdout(io.StringIO()):
        return main(list(arguments))


def _new_run(folder: Path) -> list[str]:
    return [
        "evolve",
        "--env",
        "CartPole-v1",
        "--config",
        str(folder / "small.ini"),
        "--seed",
        "3",
        "-o",
        str(folder / "run"),
    ]


def _configured(folder: Path) -> None:
    (folder / "small.ini").write_text(CONFIGURATION)


def _evolve(folder: Path) -> int:
    return quietly(*_new_run(folder))


def _holds_no_run(command: str, folder: Path) -> bool:
    """Whether ``--resume`` says so; then, and only then, the command is given anew."""
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        status = main([command, "--resume", str(folder / "run")])
    if status == 2 and "holds no" in errors.getvalue() and errors.getvalue().count("\n") == 1:
        return True
    if status != 0:
        print(errors.getvalue())
        raise SystemExit(status)
    return False


def _evolve_on(folder: Path) -> int:
    return _evolve(folder) if _holds_no_run("evolve", folder) else 0


def _half_done(folder: Path) -> None:
    _configured(folder)
    assert quietly(*_new_run(folder), "--generations", "2") == 0
    (folder / "next.ini").write_text(CONFIGURATION.replace("finalists = 2", "finalists = 3"))


def _reconfigure(folder: Path) -> int:
    return quietly("evolve", "--resume", str(folder / "run"), "--config", str(folder / "next.ini"))


def _reconfigure_on(folder: Path) -> int:
    """As a user does who sees in ``run.json`` whether the new configuration was taken."""
    taken = json.loads((folder / "run" / "run.json").read_text())["earlier"]
    return quietly("evolve", "--resume", str(folder / "run")) if taken else _reconfigure(folder)


def _champion(folder: Path) -> None:
    shutil.copy(TINY, folder / "tiny.pkl")


def _polish(folder: Path) -> int:
    return quietly("polish", str(folder / "tiny.pkl"), "--generations", "2", "-o", str(folder / "run"))


def _polish_on(folder: Path) -> int:
    return _polish(folder) if _holds_no_run("polish", folder) else 0


def _linear(folder: Path) -> int:
    return quietly("linear", "--env", "CartPole-v1", "--pop", "4", "--generations", "4", "-o", str(folder / "run"))


def _linear_on(folder: Path) -> int:
    return _linear(folder) if _holds_no_run("linear", folder) else 0


def _codegen(folder: Path) -> int:
    return quietly("codegen", str(folder / "tiny.pkl"), "-o", str(folder / "walker.c"), "--style", "unrolled")


def _package(folder: Path) -> int:
    output = str(folder / "library")
    return quietly("codegen", str(folder / "tiny.pkl"), "-o", output, "--package", "arduino", "--style", "unrolled")


def _old_package(folder: Path) -> None:
    _champion(folder)
    output = str(folder / "library")
    old = str(ROOT / "examples" / "walker" / "champion.pkl")
    assert (
        quietly("codegen", old, "-o", output, "--package", "arduino", "--style", "unrolled", "--name", "library") == 0
    )


def _build(folder: Path) -> int:
    build._cache_dir.cache_clear()
    source = folder / "answer.c"
    with contextlib.ExitStack() as stack:
        environment = build.os.environ
        before = environment["BITNEAT_CACHE_DIR"]
        environment["BITNEAT_CACHE_DIR"] = str(folder / "cache")
        stack.callback(environment.__setitem__, "BITNEAT_CACHE_DIR", before)
        library = build.shared_library([source], name="answer")
    import ctypes

    return 0 if ctypes.CDLL(str(library)).answer() == 42 else 1


def _source(folder: Path) -> None:
    (folder / "answer.c").write_text("int answer(void) { return 42; }\n")


SCENARIOS = {
    "evolve": Scenario(_evolve, _evolve_on, _configured),
    "evolve --config": Scenario(_reconfigure, _reconfigure_on, _half_done),
    "polish": Scenario(_polish, _polish_on, _champion),
    "linear": Scenario(_linear, _linear_on),
    "codegen": Scenario(_codegen, _codegen, _champion, leaves_nothing=False),
    "codegen --package": Scenario(_package, _package, _champion, leaves_nothing=False),
    "codegen --package again": Scenario(_package, _package, _old_package, leaves_nothing=False),
    "native build": Scenario(_build, _build, _source, leaves_nothing=False, alone=False),
}
