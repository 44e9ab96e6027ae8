# SPDX-License-Identifier: MIT
import argparse
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from bitneat.cli.main import COMMANDS, GROUPS, load, main
from bitneat.errors import BitneatError, CheckFailedError

HEAVY = ("numpy", "gymnasium", "neat", "jinja2", "cffi", "rich", "matplotlib", "elftools", "multiprocessing", "pickle")


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], int]], None]:
    """Make ``bitneat work`` do what the test says."""

    def install(work: Callable[[], int]) -> None:
        module = ModuleType("work")
        module.HELP = "work"  # type: ignore[attr-defined]
        module.DESCRIPTION = "Works."  # type: ignore[attr-defined]
        module.EXAMPLE = "  bitneat work"  # type: ignore[attr-defined]
        module.FILES = "  none"  # type: ignore[attr-defined]
        module.add_arguments = lambda parser: parser.add_argument("--count", type=int)  # type: ignore[attr-defined]
        module.run = lambda args: work()  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "work", module)
        monkeypatch.setitem(COMMANDS, "work", ("work", "work"))

    return install


def raiser(error: BaseException) -> Callable[[], int]:
    def work() -> int:
        raise error

    return work


def run_buffered(*command: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a command with Python's usual buffers: argparse keeps quiet about what an unbuffered write tells it."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False, env=environment, **options)


@pytest.mark.parametrize("status", [0, 1])
def test_a_commands_status_is_the_exit_status(status: int, command: Callable[[Callable[[], int]], None]) -> None:
    command(lambda: status)
    assert main(["work"]) == status


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (CheckFailedError("walker.c: stale"), 1, "bitneat: walker.c: stale\n"),
        (BitneatError("a.pkl: no champion"), 2, "bitneat: a.pkl: no champion\n"),
        (BitneatError("first\nsecond"), 2, "bitneat: first second\n"),
        (BitneatError("a \x1b[2Jb\r\u202e\udcff"), 2, "bitneat: a \\x1b[2Jb\\r\\u202e\\udcff\n"),
        (FileNotFoundError(2, "No such file or directory", "a.pkl"), 2, "bitneat: a.pkl: No such file or directory\n"),
        (PermissionError(13, "Permission denied", b"a"), 2, "bitneat: a: Permission denied\n"),
        (OSError(18, "Cross-device link", "a", None, "b"), 2, "bitneat: a -> b: Cross-device link\n"),
        (OSError(28, "No space left on device"), 2, "bitneat: No space left on device\n"),
        (OSError("odd"), 2, "bitneat: odd\n"),
        (MemoryError(), 2, "bitneat: out of memory\n"),
        (KeyboardInterrupt(), 130, "bitneat: interrupted\n"),
        (KeyboardInterrupt("stopped; go on with x"), 130, "bitneat: stopped; go on with x\n"),
        (BrokenPipeError(32, "Broken pipe"), 141, ""),
    ],
)
def test_what_goes_wrong_is_one_line_and_a_status(
    error: BaseException,
    status: int,
    line: str,
    command: Callable[[Callable[[], int]], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    command(raiser(error))
    assert main(["work"]) == status
    assert capsys.readouterr() == ("", line)


def test_sigterm_ends_a_command_in_one_line_and_goes_back_to_what_it_was(
    command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def terminated() -> int:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
        return 0

    before = signal.getsignal(signal.SIGTERM)
    command(terminated)
    assert main(["work"]) == 143
    assert capsys.readouterr() == ("", "bitneat: terminated\n")
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_comes_in_a_destructor_is_not_lost(
    number: int, status: int, command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str]
) -> None:
    class Body:
        """As the simulator has them."""

        def __del__(self) -> None:
            os.kill(os.getpid(), number)
            time.sleep(1)  # which the interrupt ends, and Python ignores that

    def simulate() -> int:
        Body()
        time.sleep(10)
        return 0

    before = sys.unraisablehook, signal.getsignal(signal.SIGTERM)
    command(simulate)
    assert main(["work"]) == status
    assert capsys.readouterr() == ("", f"bitneat: {'interrupted' if number == signal.SIGINT else 'terminated'}\n")
    assert (sys.unraisablehook, signal.getsignal(signal.SIGTERM)) == before


def test_other_faults_of_destructors_are_told_as_before(
    command: Callable[[Callable[[], int]], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Body:
        def __del__(self) -> None:
            raise ValueError("odd")

    told: list[str] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: told.append(str(lost.exc_value)))
    command(lambda: Body() and 0)
    assert main(["work"]) == 0
    assert told == ["odd"]


def test_whoever_has_plans_for_sigterm_keeps_them(command: Callable[[Callable[[], int]], None]) -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: seen.append(number))
    try:
        command(lambda: os.kill(os.getpid(), signal.SIGTERM) or 0)
        assert main(["work"]) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == [signal.SIGTERM]


def test_a_fault_of_ours_has_a_status_of_its_own_and_a_traceback_only_if_asked_for(
    command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command(raiser(ValueError("a bug\nof two lines")))
    assert main(["work"]) == 70
    assert capsys.readouterr() == (
        "",
        "bitneat: internal error: ValueError: a bug of two lines"
        " (a fault of bitneat's; BITNEAT_TRACEBACK=1 in the environment shows where; please report it)\n",
    )
    monkeypatch.setenv("BITNEAT_TRACEBACK", "1")
    assert main(["work"]) == 70
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert err.endswith("of two lines (a fault of bitneat's; please report it)\n")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "the following arguments are required: COMMAND (see bitneat --help)"),
        (["--nonsense"], "--nonsense: no such option before a command (see bitneat --help)"),
        ([""], "'': no such command; the commands are "),
        (["size", ""], "argument champion: expected a value, got an empty one (see bitneat size --help)"),
        (["evolve", "--env", ""], "argument --env: expected a value, got an empty one"),
        (["evolve", "--env="], "argument --env: expected a value, got an empty one"),
        (["evolve", "--config", ""], "argument --config: expected a value, got an empty one"),
        (["evolve", "-o", ""], "argument -o/--output: expected a value, got an empty one"),
        (["plot", "pareto", "a.pkl", "", "-o", "a.svg"], "argument PATH: expected a value, got an empty one"),
        (["evolve", "--workers", "3000"], "bitneat: --workers 3000: expected a whole number in 1..256"),
        (["polish", "a.pkl", "--workers", "257"], "bitneat: --workers 257: expected a whole number in 1..256"),
        (["linear", "--workers", "257"], "bitneat: --workers 257: expected a whole number in 1..256"),
        (["quantize", "a.pkl", "-o", "b.pkl", "--workers", "257"], "bitneat: --workers 257: expected a whole number"),
        (["reproduce", "--workers", "257"], "bitneat: --workers 257: expected a whole number in 1..256"),
        (["help", "plot", "nosuch"], "help plot nosuch: expected one command, one of fitness, network, pareto, size, "),
        (["help", "size", "nosuch"], "help size nosuch: expected one command and no more"),
        (["polish", "nothing.pkl", "--floor", "-1e3"], "nothing.pkl: cannot read"),
        (["polish", "nothing.pkl", "--floor", "-.5E+2"], "nothing.pkl: cannot read"),
        (["plot", "fitness", "nothing", "--reference", "-1e2", "-o", "a.svg"], "nothing"),
        (["wrok"], "wrok: no such command; did you mean work?"),
        (["zzz"], "zzz: no such command; the commands are "),
        (["work", "--count", "x"], "argument --count: invalid int value: 'x' (see bitneat work --help)"),
        (["work", "--cou", "1"], "unrecognized arguments: --cou 1"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_status_2(
    arguments: list[str],
    line: str,
    command: Callable[[Callable[[], int]], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    command(lambda: 0)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert line in err
    assert err.count("\n") == 1


def test_help_lists_every_command_under_what_it_is_for_and_exits_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for name, (_, help_text) in COMMANDS.items():
        assert f" {name} {help_text}" in " ".join(out.split())
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(COMMANDS)
    titles = [line[:-1] for line in out.splitlines() if line.endswith(":") and line[:-1] in GROUPS]
    assert titles == list(GROUPS)
    assert "other commands:" not in out, "a command is in no group of GROUPS"


def test_a_command_in_no_group_is_listed_all_the_same(
    command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str]
) -> None:
    command(lambda: 0)
    assert main(["--help"]) == 0
    assert "other commands:\n  work        work\n" in capsys.readouterr().out


def test_help_of_a_command_is_its_help_option(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, same in (
        (["help", "size"], ["size", "--help"]),
        (["help"], ["--help"]),
        (["help", "-h"], ["-h"]),
        (["help", "help"], ["-h"]),
        (["help", "plot", "size"], ["plot", "size", "-h"]),
    ):
        assert main(arguments) == 0
        said = capsys.readouterr().out
        assert main(same) == 0
        assert said == capsys.readouterr().out
    assert main(["help", "sise"]) == 2
    assert capsys.readouterr().err == "bitneat: sise: no such command; did you mean size?\n"


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("bitneat 0.")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_commands_help_says_what_it_does_how_it_ends_and_what_it_touches(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    module = load(name)
    assert COMMANDS[name][1] == module.HELP
    assert "\n" not in module.HELP
    assert main([name, "--help"]) == 0
    out = capsys.readouterr().out
    _, example, status, files = re.split(r"\n\n(?:example|exit status|files):\n", out)
    assert f"{module.HELP}\n\n{module.DESCRIPTION}\n\n" in out
    assert 80 < len(module.DESCRIPTION) < 500
    assert max(map(len, [*module.DESCRIPTION.splitlines(), *files.splitlines()])) <= 84
    assert f"bitneat {name}" in example
    assert [line.split()[0] for line in status.splitlines()] in (["0", "2", "130"], ["0", "1", "2", "130"])
    assert files.strip()
    assert isinstance(module, ModuleType)
    module.add_arguments(argparse.ArgumentParser())


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)])
def test_help_starts_without_loading_anything_heavy(arguments: list[str]) -> None:
    code = (
        "import json, sys\n"
        "from bitneat.cli import main\n"
        f"status = main({arguments!r})\n"
        "print()\n"
        "print(json.dumps([status, sorted(sys.modules)]))\n"
    )
    # Where coverage is measured, processes would load what measures it.
    env = {key: value for key, value in os.environ.items() if not key.startswith("COVERAGE")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
    status, modules = json.loads(done.stdout.splitlines()[-1])
    assert status == 0
    assert not set(HEAVY) & set(modules)


def test_the_package_runs_as_a_module() -> None:
    done = run_buffered(sys.executable, "-m", "bitneat", "--version", stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("bitneat ")


def test_a_reader_that_goes_away_is_no_noise() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        done = run_buffered(sys.executable, "-m", "bitneat", "--help", stdout=pipe)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_standard_output_is_one_line_and_status_2() -> None:
    with Path("/dev/full").open("w") as full:
        done = run_buffered(sys.executable, "-m", "bitneat", "--help", stdout=full)
    assert (done.returncode, done.stderr) == (2, "bitneat: standard output: No space left on device\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["evolve", "--help"]])
def test_help_that_could_not_be_written_is_no_success_without_buffers_either(arguments: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-u", "-m", "bitneat", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert re.fullmatch(r"bitneat: (standard output: )?No space left on device\n", done.stderr)


@pytest.mark.parametrize(
    ("redirected", "status", "out", "err"),
    [
        ("--version >&-", 0, "", ""),
        ("size nothing.pkl >&-", 2, "", "bitneat: nothing.pkl: cannot read: No such file or directory\n"),
        ("size nothing.pkl 2>&-", 2, "", ""),
        ("size nothing.pkl <&- >&- 2>&-", 2, "", ""),
        ("size nothing.pkl 2>/dev/full", 2, "", ""),
    ],
)
def test_streams_that_are_closed_change_no_status(
    redirected: str, status: int, out: str, err: str, tmp_path: Path
) -> None:
    line = f"exec {sys.executable} -m bitneat {redirected}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for unbuffered in ("", "1"):
        environment["PYTHONUNBUFFERED"] = unbuffered
        done = subprocess.run(
            ["sh", "-c", line], capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
        )
        assert (done.returncode, done.stdout, done.stderr) == (status, out, err), unbuffered


def test_what_the_output_s_encoding_lacks_is_written_otherwise() -> None:
    code = (
        "import sys; from bitneat.cli import main\n"
        "from bitneat.cli.main import COMMANDS\n"
        "import types; work = types.ModuleType('work'); COMMANDS['work'] = ('work', 'work'); sys.modules['work'] = work\n"
        "work.HELP = work.DESCRIPTION = work.EXAMPLE = work.FILES = ''; work.add_arguments = lambda parser: None\n"
        "work.run = lambda args: print('1 \\xb1 2 \\u2026 \\u0436 \\udcff') or 0\n"
        "sys.exit(main(['work']))\n"
    )
    for encoding, said in (("ascii", "1 +- 2 ... \\u0436 \\udcff\n"), ("utf-8", "1 ± 2 … ж \\udcff\n")):
        environment = {**os.environ, "PYTHONIOENCODING": encoding}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False, env=environment)
        assert (done.returncode, done.stdout.decode(), done.stderr) == (0, said, b"")


@pytest.mark.parametrize(
    ("name", "reason"),
    [("no/out.json", "No such file or directory"), (".", "Is a directory"), ("f/o", "Not a directory")],
)
def test_a_result_that_cannot_be_written_is_noticed_before_the_work(
    name: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("f").touch()
    for command in ("verify", "size"):
        assert main([command, "nothing.pkl", "--json", name]) == 2
        assert capsys.readouterr().err == f"bitneat: {name}: cannot write: {reason}\n"
    for command in ("quantize", "import", "report"):
        assert main([command, "nothing.pkl", "-o", name]) == 2
        expected = "is a folder, expected the name of an HTML file" if (command, name) == ("report", ".") else None
        assert capsys.readouterr().err == f"bitneat: {name}: {expected or f'cannot write: {reason}'}\n"
    assert main(["size", "nothing.pkl", "--json", "/dev/stdout"]) == 2
    assert "nothing.pkl: cannot read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    ["render nothing.pkl -o no/x.png", "plot network nothing.pkl -o no/x.svg"],
)
def test_a_folder_that_is_missing_is_noticed_before_the_champion_is_read(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(command.split()) == 2
    assert re.fullmatch(r"bitneat: no/x\.\w+: cannot write: No such file or directory\n", capsys.readouterr().err)


def test_a_run_that_could_not_leave_its_champion_here_is_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("champion.pkl").mkdir()
    assert main(["evolve", "--env", "CartPole-v1", "--generations", "1", "--pop", "4", "--workers", "1"]) == 2
    assert capsys.readouterr().err == "bitneat: champion.pkl: cannot write: Is a directory\n"
    assert not Path("runs").exists()
