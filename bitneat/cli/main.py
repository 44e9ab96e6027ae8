# SPDX-License-Identifier: MIT
"""Choosing the sub-command, and turning whatever happens into an exit status and at most one line on stderr.

A sub-command is a module of this package with

- ``HELP``: what it does, one line; the same as in `COMMANDS`, which has it so that ``bitneat --help`` imports nothing;
- ``DESCRIPTION``: a paragraph, in lines of at most 80 characters, that begins its ``--help``;
- ``EXAMPLE``: command lines that show it, printed at the end of its ``--help``;
- ``FILES``: what it reads and writes, a line each, printed after that;
- ``STATUS``, if the exit status 0 or 1 says more than usual: a line for each;
- ``add_arguments(parser)``;
- ``also_writes(args)``, if it writes more than ``args.output`` and ``args.json``: the other paths;
- ``run(args) -> int``: the exit status; 0, or 1 if what was to be checked does not hold.

It may raise `BitneatError`, whose message is the line the user sees. It imports nothing heavy at its top. Ctrl-C and SIGTERM reach
it as a KeyboardInterrupt; one that can be continued raises it with the line that says how.
"""

from __future__ import annotations

import argparse
import codecs
import difflib
import io
import os
import re
import signal
import sys
import textwrap
from collections.abc import Collection, Sequence
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, cast

from bitneat.cli.interrupts import TerminatedError, interrupts_arrive
from bitneat.errors import BitneatError, printable
from bitneat.version import __version__

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

GOOD = 0
CHECK_FAILED = 1
BAD_INPUT = 2
INTERNAL_ERROR = 70  # EX_SOFTWARE of sysexits.h
INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
_BROKEN_PIPE = 128 + signal.SIGPIPE
_STDOUT = "standard output"
_TRACEBACK = "BITNEAT_TRACEBACK"

COMMANDS: dict[str, tuple[str, str]] = {
    "evolve": ("bitneat.cli.evolve", "evolve a ternary controller in a Gymnasium environment"),
    "linear": ("bitneat.cli.linear", "find a linear policy, and write it as a ternary champion to polish"),
    "polish": ("bitneat.cli.polish", "make a champion better, or smaller at the same reward, by small changes"),
    "reproduce": (
        "bitneat.cli.reproduce",
        "run the Bit-Pedal Walker paper's experiments again: tables, figures, verdicts",
    ),
    "quantize": (
        "bitneat.cli.quantize",
        "make a float champion an integer or ternary one, an integer champion ternary",
    ),
    "distill": (
        "bitneat.cli.distill",
        "train a ternary controller to imitate a float champion of the walker (needs bitneat[baselines])",
    ),
    "baseline": (
        "bitneat.cli.baseline",
        "train a baseline for BipedalWalker-v3 by ARS, PPO or DQN (needs bitneat[baselines])",
    ),
    "codegen": ("bitneat.cli.codegen", "write a champion as C that only adds and subtracts"),
    "verify": ("bitneat.cli.verify", "compare generated C with its champion, bit for bit, in the simulator's loop"),
    "prove": (
        "bitneat.cli.prove",
        "prove that the compiled C computes the champion, for all inputs (needs bitneat[prove])",
    ),
    "size": (
        "bitneat.cli.size",
        "say what a champion takes: links, packed bytes, flash, RAM, stack and, with --targets, instructions a step",
    ),
    "report": (
        "bitneat.cli.report",
        "write one HTML file: the walk, the controller at work, its C in the browser, sizes, verdicts, provenance",
    ),
    "doctor": ("bitneat.cli.doctor", "say which compilers, emulators and extras are there, and test a controller"),
    "completion": ("bitneat.cli.completion", "print a script that completes commands and options in a shell"),
    "bench": ("bitneat.cli.bench", "measure speed against neat-python, Gymnasium and Python's own start"),
    "plot": (
        "bitneat.cli.plot",
        "draw runs, networks, champions by size, sizes, or the activations (needs bitneat[plot])",
    ),
    "render": (
        "bitneat.cli.render",
        "record an episode as .gif, .mp4 or a strip of pictures (needs bitneat[render])",
    ),
    "import": (
        "bitneat.cli.import_",
        "make a champion from a neat-python genome, a stable-baselines3 model or layers in a .npz file",
    ),
}
"""Name of a sub-command: its module, and its one line of help."""

GROUPS: dict[str, tuple[str, ...]] = {
    "make a controller": ("evolve", "linear", "polish", "import", "quantize", "distill", "baseline"),
    "deploy it": ("codegen",),
    "check it": ("verify", "prove", "doctor"),
    "look at it": ("report", "size", "plot", "render"),
    "compare": ("reproduce", "bench"),
    "the command line itself": ("completion",),
}
"""What the sub-commands are for, in the order of ``bitneat --help``."""

_DESCRIPTION = """\
Evolve ternary neural controllers, compile them to C that only adds and
subtracts, and verify them bit for bit."""

_MORE = """\
bitneat help COMMAND, or bitneat COMMAND --help, says all about one of them.

exit status:
  0    good
  1    what was to be checked does not hold
  2    bad input or arguments, or a missing tool: one line on standard error
  70   internal error, a fault of bitneat's: one line on standard error;
       with BITNEAT_TRACEBACK=1 in the environment where it came from, too
  130  interrupted
  141  the reader of standard output has gone away, as head does
  143  terminated"""

_STATUS = """\
  0    done"""
_STATUS_ALWAYS = """\
  2    bad input or arguments, or a missing tool: one line on standard error
  130  interrupted; 143 terminated"""


class Command(Protocol):
    """What a sub-command's module offers."""

    HELP: str
    DESCRIPTION: str
    EXAMPLE: str
    FILES: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the sub-command's own arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Do the work and return the exit status."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit status; whatever happens is at most one line, and a traceback only if asked for."""
    _ready_streams()
    try:
        with interrupts_arrive():
            status = _run(sys.argv[1:] if argv is None else list(argv))
            _flush_stdout()
    except BitneatError as error:
        status = _fail(str(error), error.exit_status)
    except TerminatedError as stop:
        status = _fail(str(stop) or "terminated", TERMINATED)
    except KeyboardInterrupt as stop:
        status = _fail(str(stop) or "interrupted", INTERRUPTED)
    except BrokenPipeError:
        status = _BROKEN_PIPE
    except OSError as error:
        status = _fail(_describe(error), BAD_INPUT)
    except MemoryError:
        status = _fail("out of memory", BAD_INPUT)
    except Exception as error:  # status 1, which Python would exit with, says that a check has failed
        status = _fail_by_our_fault(error)
    _settle_streams()
    return status


def load(name: str) -> Command:
    """Import the module of a sub-command."""
    return cast(Command, import_module(COMMANDS[name][0]))


def build_parser(names: Collection[str]) -> argparse.ArgumentParser:
    """Make the parser of the whole command line; only the modules of the sub-commands in ``names`` are imported."""
    parser = _Parser(
        prog="bitneat",
        usage="%(prog)s [-h] [--version] COMMAND ...",
        description=_DESCRIPTION,
        epilog=f"{_overview()}\n\n{_MORE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"bitneat {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True, help=argparse.SUPPRESS, prog="bitneat")
    for name in COMMANDS:
        if name not in names:
            subparsers.add_parser(name, add_help=False)
            continue
        command = load(name)
        subparser = subparsers.add_parser(
            name,
            help=command.HELP,
            description=f"{command.HELP}\n\n{command.DESCRIPTION}",
            epilog=_epilog(command),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return parser


def _overview() -> str:
    """The sub-commands by what they are for, each with its line of help."""
    width = max(map(len, COMMANDS)) + 2
    listed = {name for names in GROUPS.values() for name in names}
    others = tuple(name for name in COMMANDS if name not in listed)
    sections = []
    for title, names in {**GROUPS, "other commands": others}.items():
        lines = [
            textwrap.fill(
                COMMANDS[name][1],
                width=78,
                initial_indent=f"  {name:{width}}",
                subsequent_indent=" " * (width + 2),
                break_on_hyphens=False,
            )
            for name in names
            if name in COMMANDS
        ]
        if lines:
            sections.append("\n".join([f"{title}:", *lines]))
    return "\n\n".join(sections)


def _epilog(command: Command) -> str:
    """What follows the options: examples, exit status and files."""
    status = f"{getattr(command, 'STATUS', _STATUS)}\n{_STATUS_ALWAYS}"
    return f"example:\n{command.EXAMPLE}\n\nexit status:\n{status}\n\nfiles:\n{command.FILES}"


def _run(argv: list[str]) -> int:
    # Only the module of the sub-command that is asked for is imported; the others are names in a list.
    if argv[:1] == ["help"]:
        argv = _help(argv[1:])
    named = next((argument for argument in argv if not argument.startswith("-")), None)
    if named is not None and named not in COMMANDS:
        raise BitneatError(_no_such_command(named))
    if named is None:
        for argument in argv:
            if argument not in ("-h", "--help", "--version"):
                raise BitneatError(f"{argument}: no such option before a command (see bitneat --help)")
    parser = build_parser(() if named is None else (named,))
    try:
        args = parser.parse_args(argv)
    except SystemExit as stop:  # --help and --version, which have printed what they had to
        return int(stop.code or GOOD)
    from bitneat.cli.arguments import require_few_workers
    from bitneat.cli.clashes import require_distinct

    require_few_workers(args)
    if named is not None:
        require_distinct(args, parser, named, getattr(load(named), "also_writes", None))
    if getattr(args, "json", None) is not None:
        from bitneat.files import require_writable

        require_writable(args.json)
    return int(args.run(args))


def _help(words: list[str]) -> list[str]:
    """The command line that prints what ``bitneat help`` and these words ask for."""
    words = [word for word in words if word not in ("-h", "--help")]
    if words[:1] == ["help"]:
        words = words[1:]
    if len(words) > 1 and words[0] in COMMANDS:
        parser = argparse.ArgumentParser(add_help=False)
        load(words[0]).add_arguments(parser)
        below = parser._subparsers._group_actions[0].choices if parser._subparsers else ()
        if words[1] not in (below or ()) or len(words) > 2:
            expected = f", one of {', '.join(below)} after it," if below else ""
            raise BitneatError(f"help {' '.join(words)}: expected one command{expected} and no more")
    return [*words, "--help"]


class _Parser(argparse.ArgumentParser):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # argparse's own knows no exponents, and takes -1e3 for options.
        self._negative_number_matcher = re.compile(
            r"-(\d[\d_]*\.?\d*|\.\d+)(e[+-]?\d+)?$|-(inf|infinity|nan)$", re.IGNORECASE
        )

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        # The empty text is what an unset variable of a shell gives; as a path it would be the current folder.
        if "" in arg_strings and action.nargs != argparse.PARSER:
            raise argparse.ArgumentError(action, "expected a value, got an empty one")
        return super()._get_values(action, arg_strings)

    def _print_message(self, message: str, file: SupportsWrite[str] | None = None) -> None:
        # argparse's own is content with help that could not be written.
        (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        raise BitneatError(f"{message} (see {self.prog} --help)")


def _no_such_command(name: str) -> str:
    close = difflib.get_close_matches(name, COMMANDS, n=1)
    hint = f"did you mean {close[0]}?" if close else f"the commands are {', '.join(COMMANDS)}"
    return f"{name or repr(name)}: no such command; {hint}"


def _fail(message: str, status: int) -> int:
    with suppress(OSError):  # there is nowhere left to say so
        print("bitneat:", printable(" ".join(message.split("\n"))), file=sys.stderr, flush=True)
    return status


def _fail_by_our_fault(error: Exception) -> int:
    asked = bool(os.environ.get(_TRACEBACK))
    if asked:
        import traceback

        with suppress(OSError):
            traceback.print_exception(error)
    how = "" if asked else f"; {_TRACEBACK}=1 in the environment shows where"
    text = str(BitneatError(str(error))) or "no message"
    return _fail(
        f"internal error: {type(error).__name__}: {text} (a fault of bitneat's{how}; please report it)", INTERNAL_ERROR
    )


def _describe(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    names = [
        os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, str | bytes | os.PathLike)
    ]
    if not names and error.errno is not None:
        try:
            sys.stdout.flush()
        except OSError as again:  # what could not be written is in its buffer still
            if again.errno == error.errno:
                names = [_STDOUT]
    return ": ".join([" -> ".join(names), reason] if names else [reason])


def _flush_stdout() -> None:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, _STDOUT) from error


def _ready_streams() -> None:
    """Have all three streams, closed ones as the null device, and none that dies of a character it cannot encode."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            null = os.open(os.devnull, os.O_RDWR)  # the lowest free number: that of the closed stream
            if null == number:
                os.set_inheritable(null, True)  # else a child's first file would become its output
            setattr(sys, name, os.fdopen(null, "w" if number else "r", encoding="utf-8", errors=_ERRORS))
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ERRORS)


def _plain(error: UnicodeError) -> tuple[str | bytes, int]:
    """What a stream has instead of characters that its encoding lacks."""
    if isinstance(error, UnicodeEncodeError):
        char = error.object[error.start]
        if char in _PLAIN:
            return _PLAIN[char], error.start + 1
        return char.encode("unicode_escape").decode("ascii"), error.start + 1
    raise error


_ERRORS = "bitneat.plain"
_PLAIN = {"±": "+-", "…": "...", "–": "-", "−": "-", "×": "x", "→": "->", "≤": "<=", "·": ".", "“": '"', "”": '"'}
codecs.register_error(_ERRORS, _plain)


def _settle_streams() -> None:
    """Keep the interpreter's own flush at exit, which would change the status, from failing where ours has failed already."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
