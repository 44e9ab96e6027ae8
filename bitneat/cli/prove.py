# SPDX-License-Identifier: MIT
"""``bitneat prove``: show that compiled C computes what its champion does, for all inputs and states."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_json
from bitneat.cli.columns import columns
from bitneat.cli.judged import code_to_judge
from bitneat.cli.size import target_names
from bitneat.errors import BitneatError, printable

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.prove.check import Note, ProofReport
    from bitneat.prove.proof import FunctionProof
    from bitneat.verify.cfile import CFile

HELP = "prove that the compiled C computes the champion, for all inputs (needs bitneat[prove])"
DESCRIPTION = """\
Executes the machine code of a champion's C on symbols instead of numbers and
proves, for every input and every state that can be reached, that each output
bit is the champion's; that no branch and no address depends on data; and that
it touches nothing but its inputs, outputs, state, constants and stack.
docs/verification.md says what such a proof trusts."""
EXAMPLE = """\
  bitneat prove                                     ./champion.pkl, its C in both styles, 12 compilations each
  bitneat prove champion.pkl --c walker.c --style own --targets cortex-m0 --optimize s
  bitneat prove champion.pkl --paranoid --json prove.json
  bitneat prove champion.pkl --c walker.c --targets cortex-m0 --object walker.o"""
STATUS = """\
  0    proved, all of it
  1    not proved; with a counterexample if one was found"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json
  FILE.c, FILE.h   read: the C for it, found beside it or here by its fingerprint;
                   if there is none, it is generated in a temporary folder
  FILE.o           read: an ELF object, in place of what the compiler would make"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``prove``."""
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="default: champion.pkl in this folder"
    )
    parser.add_argument(
        "--c", metavar="FILE.c", type=Path, help="the generated source (default: found by its fingerprint)"
    )
    parser.add_argument(
        "--style",
        choices=("own", "both"),
        default="both",
        help="prove the file alone, or what codegen writes in the other style as well (default both)",
    )
    parser.add_argument(
        "--targets",
        metavar="T,...",
        help="x86-64, cortex-m0, cortex-m3, cortex-m4 (default: all but cortex-m3)",
    )
    parser.add_argument(
        "--optimize", metavar="LEVELS", default="0,s,2,3", help="levels of the compilers (default 0,s,2,3)"
    )
    parser.add_argument(
        "--object", metavar="FILE.o", type=Path, help="prove this binary of the file, for the one target that is named"
    )
    parser.add_argument(
        "--paranoid",
        action="store_true",
        help="settle every step in all ways there are, by two solvers that must agree",
    )
    parser.add_argument("--no-cache", action="store_true", help="prove again what was proved before")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Prove, print, and say by the exit status whether it holds."""
    from bitneat.champion import load
    from bitneat.files import write_json
    from bitneat.prove.check import prove, require_tools

    require_tools()
    targets = _targets(args.targets)
    if args.object is not None:
        if len(targets) != 1:
            raise BitneatError("--object: name the one target that it was compiled for with --targets")
        args.style = "own"
    champion = load(args.champion)
    with tempfile.TemporaryDirectory(prefix="bitneat-") as name:
        folder = Path(name)
        code, handed_out = code_to_judge(champion, args.champion, args.c, "auto", folder)
        _require_current(champion, code)
        files = [code] if args.style == "own" else [code, _other_style(champion, code, folder)]
        print(f"proving {code.path if handed_out else code.path.name} (style {code.style})", flush=True)
        with _display() as note:
            report = prove(
                champion,
                files,
                targets=targets,
                optimizations=_levels(args.optimize),
                compiled=args.object,
                paranoid=args.paranoid,
                use_cache=not args.no_cache,
                note=note,
            )
    print(render(report))
    if args.json is not None:
        write_json(args.json, report.to_data())
    return 0 if report.passed else 1


def _targets(text: str | None) -> list[str]:
    from bitneat.prove.check import PROCESSORS, TARGETS

    names = target_names(text)
    if names is None:
        return list(TARGETS)
    if not names:
        raise BitneatError(f"--targets: names no target, expected some of {', '.join(PROCESSORS)}")
    return list(dict.fromkeys(names))


def _levels(text: str) -> list[str]:
    levels = [level.strip().removeprefix("-O") for level in text.split(",")]
    for level in levels:
        if level not in ("0", "1", "2", "3", "s", "z", "g"):
            raise BitneatError(f"--optimize: {level!r} is none of 0, 1, 2, 3, s, z, g")
    return [f"-O{level}" for level in dict.fromkeys(levels)]


def _require_current(champion: Champion, code: CFile) -> None:
    """A proof speaks of the file that is there, but a stale one is best said to be that."""
    if code.sha256 != champion.controller.sha256:
        raise BitneatError(
            f"{code.path}: stale: of controller {code.sha256[:12]}, not of this champion; generate it again"
        )


def _other_style(champion: Champion, code: CFile, folder: Path) -> CFile:
    from bitneat.codegen import STYLES
    from bitneat.verify.cfile import CFile

    other = next(style for style in STYLES if style != code.style)
    place = folder / other
    place.mkdir()
    return CFile.write(code.regenerated(champion, other), place)


def render(report: ProofReport) -> str:
    """The report as text, the verdict last."""
    rows = [
        (
            pair.target,
            pair.optimization,
            pair.style,
            pair.verdict.upper(),
            sum(one.instructions for one in pair.functions[:1]),
            max(one.stack_bytes for one in pair.functions),
            sum(one.effort.exhaustive + one.effort.solver + one.effort.known for one in pair.functions),
            "cached" if pair.cached else f"{pair.seconds:.1f} s",
            pair.compiler,
        )
        for pair in report.pairs
    ]
    head = ("target", "level", "style", "verdict", "instructions", "stack", "lemmas", "time", "compiler")
    lines = [columns(head, rows)]
    for pair in report.pairs:
        for one in pair.functions:
            if one.verdict != "proved":
                lines += _explained(f"{pair.target} {pair.optimization} {pair.style}", one)
    proved = sum(pair.proved for pair in report.pairs)
    word = "PROVED" if report.passed else "NOT PROVED"
    lines.append(
        f"{word}: {proved} of {len(report.pairs)} binaries compute controller {report.champion.controller.sha256[:12]}"
    )
    return "\n".join(printable(line) for text in lines for line in text.split("\n"))


def _explained(where: str, one: FunctionProof) -> list[str]:
    lines = [f"{where}: {one.function}: {one.verdict}: {one.reason}"]
    found = one.counterexample
    if found is not None:
        if found.state is not None:
            lines.append(f"  state    {_numbers(found.state)}")
        shown = found.sequence if len(found.sequence) <= 3 else found.sequence[-3:]
        if len(found.sequence) > len(shown):
            lines.append(f"  after {len(found.sequence) - len(shown)} steps from reset, which --json has")
        lines += [f"  inputs   {_numbers(inputs)}" for inputs in shown]
        lines.append(f"  expected {_numbers(found.expected)}")
        lines.append(f"  found    {'a crash' if found.found is None else _numbers(found.found)}, in the emulator")
    return lines


def _numbers(values: tuple[int, ...]) -> str:
    return " ".join(map(str, values))


@contextmanager
def _display() -> Iterator[Note]:
    """A bar on a terminal, a line a binary elsewhere; both on stderr."""
    if not sys.stderr.isatty():

        def line(done: int, total: int, what: str) -> None:
            if what:
                print(f"binary {done + 1} of {total}: {what}", file=sys.stderr, flush=True)

        yield line
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task("binaries", total=None)

        def advance(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total, description=what or "done")

        yield advance
