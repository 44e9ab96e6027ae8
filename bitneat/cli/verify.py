# SPDX-License-Identifier: MIT
"""``bitneat verify``: compare generated C with its champion, bit for bit, in the simulator's loop."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, whole_number
from bitneat.cli.columns import columns
from bitneat.cli.judged import code_to_judge
from bitneat.cli.size import add_targets, target_names
from bitneat.errors import BitneatError, printable

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.verify.campaign import FaultResult
    from bitneat.verify.cfile import CFile
    from bitneat.verify.check import Report, Settings
    from bitneat.verify.loop import Episode, Note, Progress
    from bitneat.verify.targets import ReadyTarget

HELP = "compare generated C with its champion, bit for bit, in the simulator's loop"
DESCRIPTION = """\
Runs the generated C and the exact reference in lock-step with Gymnasium and
compares every bit of every output, in every step, on this machine and on
emulated chips; and the object code is searched for multiplications, data and
foreign names. docs/verification.md says what that shows and what it does not."""
EXAMPLE = """\
  bitneat verify                                     ./champion.pkl and the C generated for it
  bitneat verify champion.pkl --c walker.c --episodes 20 --json verify.json
  bitneat verify champion.pkl --targets all --episodes 3
  bitneat verify champion.pkl --inject-fault 7       plant a fault: must fail"""
STATUS = """\
  0    the C does what the champion does
  1    it does not: an output differs, or the file is stale, edited or unfit"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json
  FILE.c, FILE.h   read: the C for it, found beside it or here by its fingerprint;
                   if there is none, it is generated in a temporary folder"""

REQUIRED_CAUGHT = 0.9
"""The part of a campaign's faults that must make verify fail, not counting those that change nothing."""


@dataclass(frozen=True)
class _Job:
    """What is to be verified, and how."""

    args: argparse.Namespace
    champion: Champion
    code: CFile
    handed_out: bool
    targets: list[ReadyTarget]
    settings: Settings
    display: _Display


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``verify``."""
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="default: champion.pkl in this folder"
    )
    parser.add_argument(
        "--c", metavar="FILE.c", type=Path, help="the generated source (default: found by its fingerprint)"
    )
    loop = parser.add_argument_group("what is compared")
    loop.add_argument("--episodes", metavar="N", type=whole_number(1, 100_000), default=5, help="episodes (default 5)")
    loop.add_argument(
        "--seed", metavar="S", type=whole_number(0, 2**31 - 1), default=0, help="seed of the first episode (default 0)"
    )
    add_targets(loop)
    loop.add_argument(
        "--vectors",
        metavar="N",
        type=whole_number(1, 10_000_000),
        help="random inputs besides the episodes (default 2000; with --targets all 100000)",
    )
    loop.add_argument("--hardcore", action="store_true", help="run BipedalWalkerHardcore-v3 (2000 steps) instead")
    loop.add_argument(
        "--import",
        metavar="MODULE",
        action="append",
        default=[],
        dest="imports",
        help="let the champion's environment import MODULE, which registers it",
    )
    faults = parser.add_argument_group("planted faults").add_mutually_exclusive_group()
    faults.add_argument(
        "--inject-fault",
        metavar="N",
        type=whole_number(0),
        help="flip one bit in a copy of the C, the N-th, and verify that",
    )
    faults.add_argument(
        "--fault-campaign", metavar="COUNT", type=whole_number(1), help="then judge the faults 0 to COUNT-1, too"
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Verify, print, and say by the exit status whether it holds."""
    from bitneat.champion import load
    from bitneat.files import write_json
    from bitneat.sim.environment import allow_imports
    from bitneat.verify.check import HARDCORE, THOROUGH_VECTORS, VECTORS, Settings
    from bitneat.verify.targets import select, style_for

    allow_imports(args.imports)
    champion = load(args.champion)
    if champion.environment is None and not args.hardcore:
        raise BitneatError(f"{args.champion}: names no environment, so there is no loop to verify it in")
    names = target_names(args.targets)
    settings = Settings(
        episodes=args.episodes,
        seed=args.seed,
        environment=HARDCORE if args.hardcore else None,
        record=args.fault_campaign is not None,
        vectors=args.vectors or (THOROUGH_VECTORS if names is not None and "all" in names else VECTORS),
    )
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        code, handed_out = code_to_judge(
            champion, args.champion, args.c, style_for(target_names(args.targets)), Path(folder)
        )
        if args.inject_fault is not None and names is None:
            names = _targets_of_style(code)
        with _display(verbose=settings.vectors > VECTORS) as display:
            job = _Job(args, champion, code, handed_out, select(names), settings, display)
            data, passed = _verify(job) if args.inject_fault is None else _verify_fault(job)
    if args.json is not None:
        write_json(args.json, data)
    return 0 if passed else 1


def _targets_of_style(code: CFile) -> list[str]:
    """The host in the style of the file: a fault in it is seen nowhere else."""
    return [f"host-{code.style}"]


def _verify(job: _Job) -> tuple[dict[str, Any], bool]:
    from bitneat.verify.check import verify

    print(f"checking {_title(job.code, job.handed_out)} against {job.args.champion}", flush=True)
    report = verify(
        job.champion,
        job.code,
        job.targets,
        job.settings,
        handed_out=job.handed_out,
        progress=job.display.progress,
        note=job.display.note,
    )
    job.display.end()  # before the report is printed
    print(render(report))
    data = report.to_data()
    if job.args.fault_campaign is None or not report.passed:
        return data, report.passed
    data["faults"], passed = _campaign(job.champion, job.code, report, job.args.fault_campaign)
    return data, passed


def _verify_fault(job: _Job) -> tuple[dict[str, Any], bool]:
    from bitneat.verify.campaign import verify_fault
    from bitneat.verify.check import stale_claims

    stale = stale_claims(job.champion, job.code)
    if stale:
        raise BitneatError(f"--inject-fault: wants a file that is right: {stale[0]}")
    number = job.args.inject_fault
    progress = job.display.progress
    fault, report = verify_fault(job.champion, job.code, number, job.targets, job.settings, progress=progress)
    job.display.end()
    report = replace(report, handed_out=job.handed_out)
    print(f"planted fault {number} in a copy of {_title(job.code, job.handed_out)}: {fault}")
    print(render(report))
    if report.passed:
        print("the fault changed nothing that was compared; --fault-campaign tells equivalent ones from unreached ones")
    return {**report.to_data(), "fault": {"number": number, **fault.to_data()}}, report.passed


def _campaign(champion: Champion, code: CFile, report: Report, count: int) -> tuple[dict[str, Any], bool]:
    from bitneat.native.compiler import host_compiler
    from bitneat.verify.campaign import MORE_VECTORS, run_campaign

    assert report.loop is not None
    results = []
    for result in run_campaign(champion, code, report.loop.episodes, host_compiler(), count):
        results.append(result)
        print(f"fault {result.number} of {count}: {_fate(result)}", flush=True)
    ways = {way: sum(result.outcome == way for result in results) for way in _WAYS}
    caught = sum(result.caught for result in results)
    parts = ", ".join(f"{number} by {_WAYS[way]}" for way, number in ways.items() if number and way in _CAUGHT_BY)
    # A fault that changes nothing is none, so it does not count against verify.
    passed = caught >= REQUIRED_CAUGHT * (count - ways["equivalent"])
    print(
        f"{'PASS' if passed else 'FAIL'} {caught} of {count} planted faults make verify fail ({parts or 'none'});"
        f" {ways['unreached']} were not reached, {ways['equivalent']} changed nothing on {MORE_VECTORS} random vectors"
    )
    data = {"count": count, "caught": caught, "outcomes": ways, "results": [result.to_data() for result in results]}
    return data, passed


_CAUGHT_BY = {
    "loop": "an output in the loop",
    "vectors": "an output on the vectors",
    "crash": "a crash",
    "table": "the table alone",
    "compile": "the compiler",
}
_WAYS = {**_CAUGHT_BY, "unreached": "nothing", "equivalent": "nothing"}


def _fate(result: FaultResult) -> str:
    fate = f"caught by {_CAUGHT_BY[result.outcome]}" if result.caught else "SURVIVED"
    text = f"{result.fault}: {fate}: {result.detail}"
    if result.counterexample is not None:
        text += f" ({', '.join(map(str, result.counterexample))})"
    return text


def _title(code: CFile, handed_out: bool) -> str:
    return f"{code.path if handed_out else code.path.name} (style {code.style})"


def render(report: Report) -> str:
    """The report as text, the verdict last."""
    lines = [f"warning: {warning}" for warning in report.warnings]
    data = report.to_data()
    if report.loop is not None:
        reward = data["reward"]
        lines.append(
            f"{report.environment_id}: {_count(data['episodes'], 'episode')}, {data['steps']} steps, reward {reward['mean']:.1f} ± "
            f"{reward['std']:.1f} (min {reward['min']:.1f}, max {reward['max']:.1f}); "
            f"then {report.vectors} vectors of the whole domain"
        )
        lines += _render_inputs(data)
        rows = [
            (
                entry["name"],
                entry["style"],
                entry["steps_compared"],
                entry["mismatches"],
                entry["flash_bytes"],
                entry["ram_bytes"],
                entry["stack_bytes"],
                None if entry["instructions_per_step"] is None else entry["instructions_per_step"]["max"],
                entry["cycles_per_step"],
                _independence(entry["trace"]),
                entry["compiler"],
            )
            for entry in data["targets"]
        ]
        head = "target, style, steps, mismatches, flash, RAM, stack, instructions, cycles, timing, compiler"
        lines.append(columns(head.split(", "), rows))
        lines += _render_timing(report)
    name = report.code.path if report.handed_out else report.code.path.name
    if report.passed:
        lines.append(f"PASS {name}: equal to the reference in every output bit of {_where_equal(report)}")
    else:
        lines += [f"failure: {failure}" for failure in report.failures[1:]]
        lines.append(f"FAIL {report.failures[0]}")
    return "\n".join(printable(line) for text in lines for line in text.split("\n"))


def _where_equal(report: Report) -> str:
    """The steps and targets, the file's own style first; those that took part in the first episode alone by themselves."""
    ran = [target for target in report.targets if target.steps_compared is not None]
    own = [target for target in ran if target.style == report.code.style]
    text = "; ".join(
        f"{steps} steps on {', '.join(target.name for target in own if target.loop_steps == steps)}"
        for steps in sorted({target.loop_steps or 0 for target in own}, reverse=True)
    )
    for style in dict.fromkeys(target.style for target in ran if target.style != report.code.style):
        text += f"; so is its {style} style on {', '.join(target.name for target in ran if target.style == style)}"
    return text


def _independence(trace: dict[str, Any] | None) -> str | None:
    if trace is None:
        return None
    words = {True: "data-independent", None: "same count", False: "DEPENDS ON DATA"}
    return words[trace["data_independent"]]


def _render_timing(report: Report) -> list[str]:
    """How much was traced, and whose cycles those are."""
    traced = [target.timing for target in report.targets if target.timing is not None]
    if not traced:
        return []
    inputs = sorted({timing.inputs for timing in traced})
    counts = " or ".join(str(count) for count in inputs)
    lines = [f"timing: addresses executed and touched, compared over {counts} traced inputs with the extremes"]
    counted = sorted({target.name for target in report.targets if target.timing and not target.timing.step.addresses})
    lines += [f"timing on {name}: only how many instructions each step executes" for name in counted]
    sources = {
        target.name: target.timing.step.cycles_source
        for target in report.targets
        if target.timing is not None and target.timing.cycles is not None
    }
    lines += [f"cycles of {name}: WCET = BCET, by {source}" for name, source in sources.items()]
    return lines


def _render_inputs(data: dict[str, Any]) -> list[str]:
    """The inputs that were clipped; --json has all of them."""
    clipped = [(i, entry) for i, entry in enumerate(data["inputs"]) if entry["clipped"]]
    saturated = f"saturated outputs: {data['saturated_outputs']}"
    if not clipped:
        return [f"no observation was beyond its input's limit; {saturated}"]
    rows = [(i, _number(entry["min"]), _number(entry["max"]), entry["clipped"]) for i, entry in clipped]
    return [columns(("clipped input", "min", "max", "steps"), rows), saturated]


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _number(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.4g}"


@dataclass(frozen=True)
class _Display:
    """How far it is: what is called after each episode, before anything else that takes long, and at the end."""

    progress: Progress
    note: Note
    end: Callable[[], None]


@contextmanager
def _display(*, verbose: bool) -> Iterator[_Display]:
    """A bar on a terminal, a line an episode elsewhere; both on stderr. What comes besides is said if there is much of it."""
    if not sys.stderr.isatty():

        def line(done: int, total: int, episode: Episode) -> None:
            text = f"episode {done} of {total}: seed {episode.seed}, {episode.steps} steps, reward {episode.reward:.1f}"
            print(text, file=sys.stderr, flush=True)

        def say(text: str) -> None:
            if verbose:
                print(text, file=sys.stderr, flush=True)

        yield _Display(line, say, lambda: None)
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task("episodes", total=None)

        def advance(done: int, total: int, episode: Episode) -> None:
            text = f"seed {episode.seed}: reward {episode.reward:.1f}"
            bar.update(task, completed=done, total=total, description=text)

        def describe(text: str) -> None:
            bar.update(task, description=text)

        yield _Display(advance, describe, bar.stop)
