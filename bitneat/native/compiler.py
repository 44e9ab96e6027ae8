# SPDX-License-Identifier: MIT
"""Which C compiler there is: the system's where there is one, else the one that the ziglang package brings."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from bitneat.errors import BitneatError

Family = Literal["gcc", "clang", "zig", "other"]


class CompilerError(BitneatError):
    """There is no C compiler, or it refused a source."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler that answered when asked for its version.

    ``command`` starts with an absolute path and takes gcc's common options; ``version`` is all that it says of itself,
    so that an upgrade in place is another compiler; ``title`` is the first line of that.
    """

    command: tuple[str, ...]
    family: Family
    version: str

    @property
    def title(self) -> str:
        """The name and version in one line, as reports print it."""
        return self.version.splitlines()[0]


def host_compiler() -> Compiler:
    """Return the compiler for this machine: ``$CC``, else the first of cc, gcc, clang and ziglang's that works.

    Raises:
        CompilerError: ``$CC`` does not work, or nothing was found; the message says what to install.
    """
    return _host_compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))


@lru_cache
def _host_compiler(named: str, _path: str) -> Compiler:
    if named.strip():
        compiler = identify(_split(named))
        if compiler is None:
            raise CompilerError(f"CC={named}: not a working C compiler; set CC to one, or unset it")
        return compiler
    for command in ("cc", "gcc", "clang"):
        compiler = identify([command])
        if compiler is not None:
            return compiler
    compiler = zig_compiler()
    if compiler is not None:
        return compiler
    raise CompilerError("no C compiler found; install one (Debian: apt install gcc; anywhere: pip install ziglang)")


def _split(named: str) -> list[str]:
    try:
        return shlex.split(named)
    except ValueError:  # an open quote: take it for a name, which will not be found
        return [named]


def zig_compiler(target: str | None = None) -> Compiler | None:
    """Return the compiler of the ziglang package, for this machine or for a zig target triple; None if not installed."""
    spec = find_spec("ziglang")
    if spec is None or spec.origin is None:
        return None
    binary = Path(spec.origin).with_name("zig")
    command = [str(binary)] if binary.is_file() else [sys.executable, "-m", "ziglang"]
    return identify([*command, "cc", *(["-target", target] if target else [])])


def identify(command: Sequence[str]) -> Compiler | None:
    """Ask a compiler for its version; None if there is no such program or it does not answer."""
    return _identify(tuple(command), os.environ.get("PATH", ""))


@lru_cache
def _identify(command: tuple[str, ...], _path: str) -> Compiler | None:
    program = shutil.which(command[0])
    if program is None:
        return None
    resolved = (str(Path(program).absolute()), *command[1:])
    try:
        answer = subprocess.run(
            [*resolved, "--version"],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            check=False,
        )
    except OSError:
        return None
    version = answer.stdout.strip()
    if answer.returncode != 0 or not version:
        return None
    return Compiler(resolved, _family(resolved, version), version)


def _family(command: Sequence[str], version: str) -> Family:
    if "cc" in command[1:] and ("zig" in Path(command[0]).name or "ziglang" in command):
        return "zig"
    if "clang" in version:
        return "clang"
    if "Free Software Foundation" in version:
        return "gcc"
    return "other"
