# SPDX-License-Identifier: MIT
"""Mutation testing of templates, printed C and runtime: ``python -m tests.mutation.run_c -o RESULTS``.

Each mutant is judged by parity: the corpus (`tests.mutation.corpus`) is generated, compiled and run, and every output
compared with the reference's. What reads blobs is judged by blobs of all kinds, too, which it must accept or refuse as
Python does. What survives is compiled again by gcc with the sanitizers of addresses and undefined behaviour.

An outcome is ``parity``, ``blobs``, ``sanitizer`` or ``hang`` (the mutant is killed), ``compile`` (it is no C, and does not
count) or ``survived``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from bitneat.controller import packing, passes
from tests.mutation import parity
from tests.mutation.c_source import Mutant, mutants
from tests.mutation.checker import PROGRAM
from tests.mutation.corpus import blobs, subjects
from tests.mutation.survivors import TABLE, arguments_of

generating = sys.modules["bitneat.codegen.generate"]  # the package has a function of that name

ROOT = Path(__file__).resolve().parents[2]
TEMPLATES = ("arithmetic", "common", "interpreter", "kernels", "runtime_interpreter", "selftest", "table", "unrolled")
PRINTERS = ("view", "interpreter", "kernels")
FILES = (
    *(f"codegen/templates/{name}.c.j2" for name in TEMPLATES),
    *(f"bitneat/codegen/{name}.py" for name in PRINTERS),
    *(f"runtime_c/src/{name}.c" for name in parity.RUNTIME_SOURCES),
)
"""``runtime_c/src/interpreter.c`` is written from the templates, whose mutants it shares."""

READS_BLOBS = ("open.c", "reader.c", "validate.c")
RUN_SECONDS = 20
KILLED = ("parity", "blobs", "sanitizer", "hang")


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant, and the first difference."""

    outcome: str
    detail: str = ""

    @property
    def survived(self) -> bool:
        """Whether nothing was seen."""
        return self.outcome == "survived"


def _remember() -> None:
    """What no mutant of C changes is computed once: blobs and optimized controllers."""
    packing.pack_blob = cache(packing.pack_blob)
    passes.optimize = cache(passes.optimize)
    passes.order_depth_first = cache(passes.order_depth_first)
    generating.pack_blob, generating.optimize = packing.pack_blob, passes.optimize
    generating.order_depth_first = passes.order_depth_first


class Judge:
    """Compiles and runs the corpus with a mutant in it, in a folder of its own."""

    def __init__(self, folder: Path, *, sanitize: bool) -> None:
        self.folder = folder
        self.sanitize = sanitize
        _remember()
        self.subjects = subjects()
        self.few, self.chosen = parity.instances(self.subjects, 1), parity.instances(self.subjects)
        parity.write_data(self.subjects, folder / "data")
        for name in ("include", "src"):
            shutil.copytree(ROOT / "runtime_c" / name, folder / name)
        self.fast = shutil.which("tcc") is not None
        self.quick = ["tcc", "-std=c99", "-w"] if self.fast else ["gcc", "-std=c99", "-w", "-O0"]
        self.main = parity.generated_source(self.subjects, self.chosen)
        self.interpreter = parity.runtime_source()
        self._write(self.main, self.interpreter)
        self.blobs, self.refused = blobs()
        (folder / "blobs").write_bytes(b"".join(struct.pack("<I", len(blob)) + blob for blob in self.blobs))
        (folder / "checker.c").write_text(PROGRAM)
        compilers = [(self.quick, "quick")]
        if sanitize:
            compilers.append((["gcc", "-std=c99", "-w", *parity.SANITIZERS], "checked"))
        for flags, suffix in compilers:
            for name in ("main", "checker"):
                self._must(
                    [*flags, *self._include, "-c", str(folder / f"{name}.c"), "-o", str(folder / f"{name}.{suffix}.o")]
                )
        outcome = self._stages(runtime=True, reads_blobs=True)
        if not outcome.survived:
            raise SystemExit(f"without a mutant: {outcome}")

    @property
    def _include(self) -> list[str]:
        return [f"-I{self.folder / name}" for name in ("include", "src")]

    def _must(self, command: Sequence[str]) -> None:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(f"{' '.join(command)}: {done.stderr[:500]}")

    def _write(self, main: str, interpreter: str) -> None:
        (self.folder / "main.c").write_text(main)
        (self.folder / "src" / "interpreter.c").write_text(interpreter)

    def judge(self, mutant: Mutant, source: str) -> Outcome:
        """Put a mutant in, and see."""
        text = mutant.applied(source)
        if mutant.path.startswith("runtime_c/"):
            file = self.folder / "src" / Path(mutant.path).name
            file.write_text(text)
            try:
                return self._stages(runtime=True, reads_blobs=file.name in READS_BLOBS)
            finally:
                file.write_text(source)
        # Most mutants show in the C of a few controllers.
        rendered = _in_child(lambda: _rendered(mutant.path, text, self, self.few))
        if rendered is None:
            return Outcome("compile", "codegen fails")
        try:
            self._write(*rendered)
            outcome = self._run(self.quick, "quick", runtime=False, reads_blobs=False)
        finally:
            self._write(self.main, self.interpreter)
        if not outcome.survived:
            return outcome
        main, interpreter = _in_child(lambda: _rendered(mutant.path, text, self, self.chosen)) or ("", "")
        if (main, interpreter) == (self.main, self.interpreter):
            return Outcome("survived", "no text changes")
        try:
            self._write(main, interpreter)
            return self._stages(runtime=main == self.main, reads_blobs=False)
        finally:
            self._write(self.main, self.interpreter)

    def _stages(self, *, runtime: bool, reads_blobs: bool) -> Outcome:
        outcome = self._run(self.quick, "quick", runtime=runtime, reads_blobs=reads_blobs)
        if outcome.survived and self.sanitize:
            checked = ["gcc", "-std=c99", "-w", *parity.SANITIZERS]
            outcome = self._run(checked, "checked", runtime=runtime, reads_blobs=reads_blobs)
            if outcome.outcome in ("parity", "blobs"):
                return Outcome("sanitizer", outcome.detail)
        return outcome

    def _run(self, flags: Sequence[str], suffix: str, *, runtime: bool, reads_blobs: bool) -> Outcome:
        sources = [str(self.folder / "src" / f"{name}.c") for name in ("interpreter", *parity.RUNTIME_SOURCES)]
        main = str(self.folder / (f"main.{suffix}.o" if runtime else "main.c"))
        program = self.folder / "program"
        done = subprocess.run(
            [*flags, *self._include, main, *sources, "-o", str(program)], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            return Outcome("compile", next((line for line in done.stderr.splitlines() if "error" in line), "")[-120:])
        outcome = self._execute([str(program), str(self.folder / "data")], None, "parity")
        if not outcome.survived or not reads_blobs:
            return outcome
        checker = str(self.folder / f"checker.{suffix}.o")
        self._must([*flags, *self._include, checker, *sources, "-o", str(program)])
        return self._execute([str(program)], self.folder / "blobs", "blobs")

    def _execute(self, command: Sequence[str], data: Path | None, stage: str) -> Outcome:
        with (data or Path(os.devnull)).open("rb") as stream:
            try:
                done = subprocess.run(command, stdin=stream, capture_output=True, check=False, timeout=RUN_SECONDS)
            except subprocess.TimeoutExpired:
                return Outcome("hang")
        if done.returncode != 0:
            said = (done.stdout[-200:] if stage == "parity" else b"") or done.stderr[:200]
            return Outcome(stage, f"status {done.returncode}: {said.decode(errors='replace')}".replace("\n", " ")[:160])
        if stage == "blobs":
            for blob, letter, refused in zip(self.blobs, done.stdout.decode(), self.refused, strict=True):
                if refused is not None and (letter == "n") != refused:
                    return Outcome(stage, f"{'accepts' if refused else 'refuses'} {blob.hex()}"[:160])
        return Outcome("survived")


def _rendered(path: str, text: str, judge: Judge, chosen: Sequence[parity.Instance]) -> tuple[str, str]:
    """The program and the interpreter with a template or a module of code generation replaced; changes this process."""
    import jinja2

    if path.endswith(".j2"):
        from bitneat.codegen.templating import environment

        # Into Jinja's own cache of templates, so that the others need not be compiled again.
        name, jinja = Path(path).name, environment()
        compiled = jinja2.Template.from_code(jinja, jinja.compile(text, name), jinja.make_globals(None))
        assert jinja.cache is not None
        jinja.cache[weakref.ref(jinja.loader), name] = compiled  # type: ignore[index]
        generated, interpreter = parity.generated_source, parity.runtime_source
    else:
        module = path.removesuffix(".py").replace("/", ".")
        for loaded in [name for name in sys.modules if name.startswith("bitneat.codegen") or name == parity.__name__]:
            del sys.modules[loaded]
        import importlib.abc
        import importlib.util

        class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
            def find_spec(self, fullname: str, path: object, target: object = None) -> object:
                return importlib.util.spec_from_loader(fullname, self) if fullname == module else None

            def exec_module(self, found: object) -> None:
                exec(compile(text, path, "exec"), found.__dict__)

        sys.meta_path.insert(0, Finder())  # type: ignore[arg-type]
        fresh = importlib.import_module(parity.__name__)
        generated, interpreter = fresh.generated_source, fresh.runtime_source
    return generated(judge.subjects, chosen), interpreter()


def _in_child(work: Callable[[], tuple[str, str]]) -> tuple[str, str] | None:
    """The result of work in a forked process, which may change whatever it likes; None if it raises."""
    with tempfile.TemporaryFile() as stream:
        child = os.fork()
        if child == 0:
            status = 1
            try:
                stream.write("\0".join(work()).encode())
                stream.flush()
                status = 0
            finally:
                os._exit(status)
        _, status = os.waitpid(child, 0)
        if status != 0:
            return None
        stream.seek(0)
        main, interpreter = stream.read().decode().split("\0")
        return main, interpreter


def all_mutants(files: Iterable[str] = FILES) -> dict[str, tuple[str, list[Mutant]]]:
    """For each file its text and its mutants."""
    texts = {file: (ROOT / file).read_text(encoding="utf-8") for file in files}
    return {file: (text, mutants(file, text)) for file, text in texts.items()}


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", default=list(FILES), help="default: all")
    parser.add_argument("--sample", type=int, help="so many mutants, drawn with seed 1")
    parser.add_argument("--quick", action="store_true", help="without the sanitizers, which take most of the time")
    parser.add_argument("--again", type=Path, metavar="RESULTS", help="only what survived there")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    done = set()
    if arguments.output.is_file():
        rows = map(json.loads, arguments.output.read_text().splitlines())
        done = {(row["path"], row["before"], row["after"], row["line"]) for row in rows}
    found = all_mutants(arguments.files)
    todo = [mutant for _, listed in found.values() for mutant in listed]
    if arguments.again is not None:
        rows = map(json.loads, arguments.again.read_text().splitlines())
        survived = {(row["path"], row["before"], row["after"]) for row in rows if row["outcome"] == "survived"}
        todo = [mutant for mutant in todo if mutant.key in survived]
    # In an order of chance, so that what has been run when somebody stops it is a sample of all.
    random.Random(1).shuffle(todo)
    todo = todo[: arguments.sample]
    todo = [mutant for mutant in todo if (*mutant.key, mutant.line) not in done]
    counts: Counter[str] = Counter()
    argued = arguments_of("c")
    open_ones = 0
    with tempfile.TemporaryDirectory(prefix="bitneat-mutation-") as folder:
        judge = Judge(Path(folder), sanitize=not arguments.quick)
        for number, mutant in enumerate(todo):
            outcome = judge.judge(mutant, found[mutant.path][0])
            counts[outcome.outcome] += 1
            open_ones += outcome.survived and mutant.key not in argued
            row = {
                "path": mutant.path,
                "line": mutant.line,
                "kind": mutant.kind,
                "before": mutant.before,
                "after": mutant.after,
                "outcome": outcome.outcome,
                "detail": outcome.detail,
            }
            with arguments.output.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            if outcome.survived or number % 100 == 0:
                change = f"{mutant.path}:{mutant.line} {mutant.before} -> {mutant.after}"
                print(f"{number}/{len(todo)} {outcome.outcome} {change} {outcome.detail}", flush=True)
    print(f"{dict(counts)}; {open_ones} survivors are not argued in {TABLE.name}")
    return min(open_ones, 1)


if __name__ == "__main__":
    sys.exit(main())
