# SPDX-License-Identifier: MIT
"""The live view: what it says, that it fits, and how a real run shows it on a real (pseudo-)terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyte
import pytest
from rich.console import Console

from bitneat.cli.main import main
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.evolve.live import LiveProgress, sparkline
from bitneat.evolve.progress import PlainProgress, Together, progress_for
from bitneat.evolve.search import Candidate, Generation

CONTROLLER = Controller((Input(), Input()), (Node((Link(0), Link(1, 0, 0, -1))),), (Signal(2),))


def a_search(history: list[Generation], linear: int = 3, generation: int | None = None, name: str = "X-v0") -> Any:
    return SimpleNamespace(
        config={"evolve": {"max_total_steps": 0, "linear_generations": linear}, "NEAT": {"pop_size": 40}},
        spec=SimpleNamespace(id=name), generation=len(history) if generation is None else generation, total_steps=0,
        seed=7, history=history, candidates=[Candidate(CONTROLLER, 0, (1.0,))] if history else [],
    )  # fmt: skip


def a_row(generation: int, best: float = 10.0, selection: float = 5.0) -> Generation:
    return Generation(generation, best, best / 2, selection, 3, 4, 9, 9.0, 2, 10, 1000)


def shown(width: int, act: Callable[[LiveProgress], None], **options: Any) -> list[str]:
    """The last picture that a console of this width records."""
    console = Console(record=True, width=width, height=30, force_terminal=True, file=StringIO(), **options)
    live = LiveProgress(console)
    act(live)
    live.close()
    with console.capture() as captured:
        console.print(live._view())
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", captured.get()).splitlines()


@pytest.mark.parametrize("width", [20, 40, 79, 80, 200])
def test_it_fits_the_terminal_and_eighty_columns(width: int) -> None:
    def act(live: LiveProgress) -> None:
        live.start(a_search([], name="A-very-long-name-of-an-environment-" * 3 + "v0"), 10, None)
        for number in range(5):
            live.generation(a_row(number, 1e6, 12345.6), Candidate(CONTROLLER, number, (12345.6,) * 32))
        live.choosing()

    assert max(map(len, shown(width, act))) <= min(width, 80)


def test_it_says_phase_best_walk_species_speed_and_time() -> None:
    def act(live: LiveProgress) -> None:
        live.start(a_search([]), 10, None)
        live.generation(a_row(0), Candidate(CONTROLLER, 0, (4.0, 6.0)))

    text = "\n".join(shown(80, act))
    assert "X-v0, population 40, seed 7" in text
    assert re.search(r"generation +1 of 10", text)
    assert "linear start, generation 2 of 3, then NEAT" in text
    assert re.search(r"best walk +5\.0 over 2 selection seeds, 2 links, \d+ bytes, generation 0", text)
    assert "3 species, 100 steps an episode" in text
    assert "steps/s" in text
    assert re.search(r"time +0:00:0\d in all", text)

    def go_on(live: LiveProgress) -> None:
        live.start(a_search([a_row(i) for i in range(3)]), 10, None)
        live.generation(a_row(3), Candidate(CONTROLLER, 0, (4.0, 6.0)))

    assert "NEAT, after 3 generations of linear start" in "\n".join(shown(80, go_on))


def test_a_linear_start_that_is_all_of_the_run_says_so() -> None:
    assert "and no NEAT after it" in "\n".join(shown(80, lambda live: live.start(a_search([], linear=10), 10, None)))


@pytest.mark.parametrize(("selection", "solved"), [(299.9, False), (300.0, True)])
def test_it_says_when_the_selection_score_reaches_the_environments_threshold(selection: float, solved: bool) -> None:
    stream = StringIO()
    for progress in (LiveProgress(Console(file=StringIO(), force_terminal=True)), PlainProgress(stream)):
        progress.start(a_search([], name="BipedalWalker-v3"), 10, None)
        for number in range(3):
            progress.generation(a_row(number, selection=selection), None)
        progress.close()

    def act(live: LiveProgress) -> None:
        live.start(a_search([], name="BipedalWalker-v3"), 10, None)
        live.generation(a_row(0, selection=selection), None)

    text = f"solved on the selection seeds: {selection:.1f}, and 300 is asked for"
    assert (text in "\n".join(shown(80, act))) == solved
    assert stream.getvalue().splitlines().count(text) == int(solved)


def test_a_console_without_unicode_gets_other_blocks() -> None:
    def act(live: LiveProgress) -> None:
        live.start(a_search([]), 10, None)
        for number in range(4):
            live.generation(a_row(number, float(number)), None)

    console = Console(file=SimpleNamespace(encoding="ascii", write=len, flush=int), width=80, force_terminal=True)  # type: ignore[arg-type]
    live = LiveProgress(console)
    act(live)
    live.close()
    with console.capture() as captured:
        console.print(live._view())
    assert captured.get().isascii()


def test_a_sparkline_pools_and_stretches() -> None:
    assert sparkline([0.0, 1.0], 4, 0.0, 1.0, blocks="01") == "0011"
    assert sparkline([0, 1, 0, 0, 0, 0, 1, 1], 4, 0, 1, pool=max, blocks="01") == "1001"
    assert sparkline([0, 1, 0, 0, 0, 0, 1, 1], 4, 0, 1, pool=min, blocks="01") == "0001"
    assert sparkline([5.0], 3, 5.0, 5.0) == "▁▁▁"
    levels = sparkline(list(range(8)), 8, 0, 7)
    assert levels == "▁▂▃▄▅▆▇█"


def test_all_are_told_in_their_order() -> None:
    told: list[str] = []

    class Part:
        def __init__(self, name: str) -> None:
            self.name = name

        def __getattr__(self, method: str) -> Callable[..., None]:
            return lambda *_: told.append(f"{self.name} {method}")

    both: Any = Together((Part("a"), Part("b")))  # type: ignore[arg-type]
    both.start(None, 1, None)
    both.generation(None, None)
    both.choosing()
    both.close()
    assert told == [f"{n} {m}" for m in ("start", "generation", "choosing", "close") for n in "ab"]


def test_all_are_closed_though_one_is_interrupted() -> None:
    closed: list[str] = []

    def interrupted() -> None:
        raise KeyboardInterrupt

    first: Any = SimpleNamespace(close=interrupted)
    second: Any = SimpleNamespace(close=lambda: closed.append("second"))
    with pytest.raises(KeyboardInterrupt):
        Together((first, second)).close()
    assert closed == ["second"]


def test_the_curves_are_whole_at_every_moment_of_a_generation() -> None:
    """The view is drawn by a thread of its own, at any time."""
    live = LiveProgress(Console(file=StringIO(), force_terminal=True, width=80))
    live.start(a_search([]), 10, None)
    drawn: list[int] = []

    def draw(frame: Any, event: str, argument: Any) -> Any:
        if frame.f_code is LiveProgress.generation.__code__:
            sys.settrace(None)
            with Console(file=StringIO()).capture():
                Console(file=StringIO(), width=80).print(live._view())
            drawn.append(frame.f_lineno)
            sys.settrace(draw)
            return draw
        return None

    before = sys.gettrace()
    sys.settrace(draw)
    try:
        live.generation(a_row(0), None)
    finally:
        sys.settrace(before)
        live.close()
    assert len(drawn) > 4


@pytest.mark.parametrize("term", ["dumb", "xterm"])
def test_plain_lines_where_there_is_no_terminal_to_draw_on(term: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", term)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert isinstance(progress_for(StringIO()), PlainProgress)
    terminal: Any = SimpleNamespace(isatty=lambda: True, encoding="utf-8", write=len, flush=int)
    assert isinstance(progress_for(terminal, plain=True), PlainProgress)
    assert isinstance(progress_for(terminal), PlainProgress if term == "dumb" else LiveProgress)


class Terminal:
    """A run on a terminal of its own, and what a person sees there."""

    def __init__(self, arguments: list[str], columns: int, rows: int, folder: Path, **environment: str) -> None:
        self.screen = pyte.Screen(columns, rows)
        self.raw = b""
        self._stream = pyte.ByteStream(self.screen)
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            os.chdir(folder)
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # whoever runs the tests may ignore it
            size = {"COLUMNS": "", "LINES": ""}
            variables = {**os.environ, "TERM": "xterm-256color", **size, **environment}
            os.execve(sys.executable, [sys.executable, "-m", "bitneat", *arguments], variables)
        self.resize(columns, rows)

    def resize(self, columns: int, rows: int) -> None:
        """As a terminal's window does, which sends SIGWINCH too."""
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.screen.resize(rows, columns)

    def type(self, keys: bytes) -> None:
        os.write(self._master, keys)

    @property
    def text(self) -> str:
        return "\n".join(line.rstrip() for line in self.screen.display).rstrip()

    def wait_for(self, pattern: str, seconds: float = 60) -> None:
        deadline = time.monotonic() + seconds
        while not re.search(pattern, self.text):
            assert time.monotonic() < deadline, self.text
            assert self._read(1.0), self.text

    def exit_status(self) -> int:
        """Read to the end, and wait."""
        while self._read(60.0):
            pass
        _, status = os.waitpid(self.pid, 0)
        os.close(self._master)
        self.pid = 0
        return os.waitstatus_to_exitcode(status)

    def _read(self, seconds: float) -> bool:
        """False once nothing more can come."""
        if select.select([self._master], [], [], seconds)[0]:
            try:
                data = os.read(self._master, 1 << 16)
            except OSError:  # how Linux says that the other end is closed
                return False
            self.raw += data
            self._stream.feed(data)
            return bool(data)
        return True


TINY = """
[evolve]
race_episodes = 1 2
race_fractions = 1 0.3
selection_episodes = 1
final_episodes = 2
report_episodes = 2
finalists = 2
max_steps = 60
linear_generations = 2
[NEAT]
pop_size = 12
"""
COLOUR = rb"\x1b\[(?:[0-9;]*;)?(?:3[0-8]|4[0-8]|9[0-7])(?:;[0-9;]*)?m"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tiny.ini").write_text(TINY)
    return tmp_path


def arguments(generations: int, *more: str) -> list[str]:
    common = ["evolve", "--env", "CartPole-v1", "--config", "tiny.ini", "--workers", "1", "-o", "run"]
    return [*common, "--generations", str(generations), *more]


def test_a_real_run_shows_it_survives_a_resize_and_ends_cleanly_on_control_c(folder: Path) -> None:
    terminal = Terminal(arguments(100_000), 100, 30, folder)
    terminal.wait_for(r"phase +NEAT, after 2 generations of linear start")
    terminal.wait_for(r"best walk +[\d.]+ over 1 selection seed, ")
    assert re.search(COLOUR, terminal.raw)
    terminal.resize(60, 30)
    seen = int(re.findall(r"generation +(\d+) of", terminal.text)[0])
    terminal.wait_for(rf"generation +(?!{seen} )\d+ of 100000")
    terminal.wait_for(r"over 1 selection seed, \d+ links")
    assert max(map(len, terminal.text.splitlines())) <= 60
    terminal.type(b"\x03")
    assert terminal.exit_status() == 130
    text = terminal.text
    assert text.count("population 12, seed 0") == 1, text  # one picture, and nothing left over of earlier ones
    assert text.count("best walk") == 1
    assert re.search(r"time +0:\d\d:\d\d in all", text)
    assert "bitneat: stopped; continue with: bitneat evolve --resume" in text
    assert "Traceback" not in text
    assert not terminal.screen.cursor.hidden
    assert list((folder / "run" / "checkpoints").glob("generation-*.json"))


def test_a_finished_run_leaves_a_summary_without_colour_where_that_is_asked_for(folder: Path) -> None:
    terminal = Terminal(arguments(4), 80, 24, folder, NO_COLOR="1")
    assert terminal.exit_status() == 0
    assert not re.search(COLOUR, terminal.raw)
    text = terminal.text
    assert text.count("CartPole-v1, population 12, seed 0") == 1, text
    assert re.search(r"generation +4 of 4", text)
    assert "champion: " in text
    assert not terminal.screen.cursor.hidden


def test_plain_is_plain_on_a_terminal_too(folder: Path) -> None:
    terminal = Terminal(arguments(2, "--plain"), 80, 24, folder)
    assert terminal.exit_status() == 0
    assert b"\x1b" not in terminal.raw
    assert b"generation 1 best" in terminal.raw
    assert b"only the linear start runs: it takes 2 generations, and 2 are asked for" in terminal.raw
    assert b"NEAT goes on" not in terminal.raw


def test_a_time_limit_within_the_linear_start_is_told_of(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(arguments(9, "--time", "1e-9")) == 0
    assert (
        "stopped by --time in the linear start, before NEAT began: 1 of its 2 generations\n" in capsys.readouterr().out
    )
    assert main(["evolve", "--resume", "run", "--time", "1000", "--workers", "1"]) == 0
    captured = capsys.readouterr()
    assert "stopped" not in captured.out
    assert "the linear start is over; NEAT goes on from its policy\n" in captured.err
