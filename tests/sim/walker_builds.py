# SPDX-License-Identifier: MIT
"""Other builds of the walker's C: with a fault planted, and as a program with a sanitizer."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bitneat.native.compiler import host_compiler
from bitneat.sim.walker import binding as native

_OTHER_WIDTHS = """
#include <stdlib.h>
#include "walker.h"
size_t walker_scratch_4(void) { abort(); }
void walker_solve_4(struct walker *const *walkers, int count, void *scratch)
{
    (void)walkers, (void)count, (void)scratch;
    abort();
}
size_t walker_scratch_8(void) { abort(); }
void walker_solve_8(struct walker *const *walkers, int count, void *scratch)
{
    (void)walkers, (void)count, (void)scratch;
    abort();
}
"""
"""The faulty builds have the widths 1 and 16 only, to save the compiler's time."""


@dataclass(frozen=True)
class Fault:
    """A text that is in a source once, and what a mistake would have made of it."""

    name: str
    file: str
    text: str
    wrong: str


class FaultyBuilds:
    """Builds in a folder of their own; what a fault does not touch is compiled once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        sources, (self._original, *self._includes) = native.sources()
        (folder / "sound").mkdir()
        self._sound = self._copy(folder / "sound" / "csrc")
        outside = [source for source in sources if source.parent != self._original]
        self._objects = self._compile_all([*self._sources(self._sound), *outside], self._sound, folder / "sound")

    def sound(self) -> Any:
        """The simulator as it is, compiled as the faulty ones are."""
        return self._link(self._objects, self._folder / "sound")

    def faulty(self, fault: Fault) -> Any:
        """The simulator with a fault."""
        folder = self._folder / fault.name.replace(" ", "-")
        folder.mkdir()
        csrc = self._copy(folder / "csrc")
        file = csrc / fault.file
        text = file.read_text()
        found = text.count(fault.text)
        assert found == 1, f"{fault.file} holds {fault.text!r} {found} times; the fault must be planted anew"
        file.write_text(text.replace(fault.text, fault.wrong))
        sources = self._sources(csrc)
        if file.suffix == ".c":  # headers are anywhere; this is in one unit, or in the solver's two
            sources = [s for s in sources if s.name == file.name or s.stem.startswith(f"{file.stem}_")]
        return self._link({**self._objects, **self._compile_all(sources, csrc, folder)}, folder)

    def _copy(self, csrc: Path) -> Path:
        shutil.copytree(self._original, csrc)
        (csrc / "other_widths.c").write_text(_OTHER_WIDTHS)
        return csrc

    def _sources(self, csrc: Path) -> list[Path]:
        names = [source.name for source in native.sources()[0] if source.parent == self._original]
        names = [name for name in names if name not in ("solver_4.c", "solver_8.c")]
        return [csrc / name for name in (*names, "other_widths.c")]

    def _compile_all(self, sources: Sequence[Path], csrc: Path, folder: Path) -> dict[str, Path]:
        """The objects, by the names of their sources."""
        flags = ["-O1" if flag == "-O3" else flag for flag in native.FLAGS if not flag.startswith("-l")]
        objects = {}
        for source in sources:
            target = folder / f"{source.stem}.o"
            _cc([*flags, "-fPIC", "-c"], [csrc, *self._includes], [source], target)
            objects[source.name] = target
        return objects

    def _link(self, objects: dict[str, Path], folder: Path) -> Any:
        target = folder / "walker.so"
        libraries = [flag for flag in native.FLAGS if flag.startswith(("-l", "-pthread"))]
        _cc(["-shared"], [], list(objects.values()), target, libraries)
        library = native.ffi().dlopen(str(target))
        library.simulator_open()
        return library


def program(main: str, flags: Sequence[str], folder: Path) -> Path:
    """The whole simulator and a source with a main function as one program."""
    sources, includes = native.sources()
    (folder / "main.c").write_text(main)
    target = folder / "walker"
    chosen = [flag for flag in native.FLAGS if flag != "-O3" and not flag.startswith("-l")]
    _cc([*chosen, *flags], includes, [*sources, folder / "main.c"], target, ["-lm"])
    return target


def _cc(
    flags: Sequence[str], includes: Sequence[Path], sources: Sequence[Path], target: Path, libraries: Sequence[str] = ()
) -> None:
    folders = [f"-I{folder}" for folder in includes]
    command = [*host_compiler().command, *flags, *folders, *map(str, sources), *libraries, "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]
