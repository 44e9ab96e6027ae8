# SPDX-License-Identifier: MIT
"""``bitneat completion``: a script with which a shell completes bitneat's command lines.

shtab writes it from the parsers themselves. The script holds all it needs, so that completing starts no Python.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HELP = "print a script that completes commands and options in a shell"
DESCRIPTION = """\
Prints a script for bash, zsh or fish that completes sub-commands, options,
their values, presets, targets and the names of champion files. It is made from
the commands of this version of bitneat: print it again after an upgrade."""
EXAMPLE = """\
  bitneat completion bash > ~/.local/share/bash-completion/completions/bitneat
  bitneat completion zsh > ~/.zfunc/_bitneat              where fpath has ~/.zfunc, before compinit
  bitneat completion fish > ~/.config/fish/completions/bitneat.fish"""
FILES = """\
  nothing; the script goes to standard output"""

SHELLS = ("bash", "zsh", "fish")

_CHAMPIONS = ("*.pkl", "*.json")
_SUFFIXES = {"MAP.toml": ("*.toml",), "FILE.c": ("*.c",), "INI": ("*.ini",), "NPZ": ("*.npz",)}
_FOLDERS = ("RUN", "DIR")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``completion``."""
    parser.add_argument("shell", choices=SHELLS, help="the shell that is to read the script")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    print(script(args.shell))
    return 0


def script(shell: str) -> str:
    """The script for one of `SHELLS`."""
    import shtab

    from bitneat.cli.main import COMMANDS, build_parser

    parser = build_parser(tuple(COMMANDS))
    for action in _actions(parser):
        _say_how(action)
    return str(shtab.complete(parser, shell=shell))


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument of the parser and of its sub-commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            action.help = None  # bitneat --help lists the sub-commands itself; shtab leaves out what is suppressed
            for subparser in action.choices.values():
                yield from _actions(subparser)
        else:
            yield action


def _say_how(action: argparse.Action) -> None:
    """Tell shtab what completes an argument, where its own choices do not."""
    import shtab

    metavar = action.metavar if isinstance(action.metavar, str) else ""
    completer: Any = None
    if action.dest in ("champion", "champions"):
        completer = shtab.glob(*_CHAMPIONS)
    elif action.dest == "targets":
        from bitneat.verify.targets import TARGETS

        action.choices = ("all", *TARGETS)  # of this parser, which parses nothing
    elif "PRESET" in metavar:
        from bitneat.evolve.config import preset_names

        action.choices = tuple(preset_names())
    elif metavar in _SUFFIXES:
        completer = shtab.glob(*_SUFFIXES[metavar])
    elif metavar in _FOLDERS:
        completer = shtab.DIRECTORY
    elif action.type is Path:
        completer = shtab.FILE
    if completer is not None:
        action.complete = completer  # type: ignore[attr-defined]
