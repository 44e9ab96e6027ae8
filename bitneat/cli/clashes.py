# SPDX-License-Identifier: MIT
"""No command writes a result over a file that it reads, or over another result: that is seen before it runs."""

from __future__ import annotations

import argparse
import os
import stat
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from bitneat.errors import BitneatError
from bitneat.folders import KINDS, Kind

_RESULTS = ("output", "json")
"""Arguments that name what is written; any other path is read."""
_READ_AS_TEXT = ("config",)
"""Arguments that name a file, or something else."""


@dataclass(frozen=True)
class _Named:
    name: str  # as the user knows the argument: -o, --json, CHAMPION
    path: Path


def require_distinct(
    args: argparse.Namespace,
    parser: argparse.ArgumentParser,
    command: str,
    beside: Callable[[argparse.Namespace], list[Path]] | None,
) -> None:
    """Refuse a command line that has a result written over something that it reads, or over another result.

    Args:
        args: what was parsed.
        parser: what parsed it, for the names of the arguments.
        command: the sub-command.
        beside: what a command writes besides ``args.output``, if it writes more.

    Raises:
        BitneatError: which two arguments name the same file, links followed.
    """
    names = _names(parser)
    written = [_Named(names[key], path) for key in _RESULTS if isinstance(path := getattr(args, key, None), Path)]
    if beside is not None:
        written[1:1] = [_Named(names["output"], path) for path in beside(args)]
    read = list(_read(args, names))
    own = [kind for kind in KINDS if kind.command == command]
    for number, result in enumerate(written):
        for source in read:
            if _same(result.path, source.path):
                raise BitneatError(
                    f"{result.name} {result.path}: would overwrite {source.name} {source.path}, which is read;"
                    " expected another name"
                )
            if any(_is_of(kind, result.path, source.path) for kind in KINDS if kind.is_in(source.path)):
                raise BitneatError(
                    f"{result.name} {result.path}: would overwrite a file of the run {source.name} {source.path};"
                    " expected another name"
                )
        for other in written[:number]:
            if _same(result.path, other.path) or any(_is_of(kind, result.path, other.path) for kind in own):
                raise BitneatError(
                    f"{result.name} {result.path}: would overwrite what {other.name} writes; expected another name"
                )


def _read(args: argparse.Namespace, names: Mapping[str, str]) -> Iterator[_Named]:
    for key, value in vars(args).items():
        if key in _RESULTS:
            continue
        for path in value if isinstance(value, list) else [value]:
            if isinstance(path, Path) or (key in _READ_AS_TEXT and isinstance(path, str)):
                yield _Named(names.get(key, key), Path(path))
    source = getattr(args, "c", None)
    if isinstance(source, Path):  # a generated source is read with its header
        yield _Named("the header of --c", source.with_suffix(".h"))


def _names(parser: argparse.ArgumentParser) -> dict[str, str]:
    """The arguments of a parser and of those below it, each by the name that a command line has for it."""
    names: dict[str, str] = {}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                names.update(_names(below))
        elif action.option_strings:
            names[action.dest] = action.option_strings[0]
        else:
            names[action.dest] = str(action.metavar or action.dest.upper())
    return names


def _same(one: Path, other: Path) -> bool:
    """Whether both are one regular file, hard links included, or would be one as soon as it is written."""
    if os.path.realpath(one) == os.path.realpath(other):
        return not one.exists() or one.is_file()  # two ways to a terminal or a pipe overwrite nothing
    try:
        first, second = one.stat(), other.stat()
    except (OSError, ValueError):
        return False
    return stat.S_ISREG(first.st_mode) and os.path.samestat(first, second)


def _is_of(kind: Kind, path: Path, folder: Path) -> bool:
    """Whether a path is one of those by which a run of this kind is kept in a folder."""
    inside = os.path.relpath(os.path.realpath(path), os.path.realpath(folder))
    return any(fnmatchcase(inside, pattern) for pattern in (*kind.states, *kind.written))
