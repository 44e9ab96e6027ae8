# SPDX-License-Identifier: MIT
"""``bitneat plot``: draw a figure."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from bitneat.cli.arguments import whole_number
from bitneat.errors import BitneatError, printable

if TYPE_CHECKING:
    from bitneat.champion import EnvironmentSpec

HELP = "draw runs, networks, champions by size, sizes, or the activations (needs bitneat[plot])"
DESCRIPTION = """\
Draws a figure into one file. The bytes depend on the arguments and on the
version of Matplotlib."""
EXAMPLE = """\
  bitneat plot fitness runs/BipedalWalker-v3-0 -o fitness.svg
  bitneat plot network champion.pkl -o network.svg
  bitneat plot pareto runs examples/champions -o pareto.svg
  bitneat plot size champion.pkl -o size.svg
  bitneat plot activations -o activations.svg"""

_EXAMPLES = {
    "fitness": """\
  bitneat plot fitness runs/BipedalWalker-v3-0 -o fitness.svg
  bitneat plot fitness a1 a2 a3 b1 --label a --label a --label a --label b --x steps --curve selection -o fitness.png""",
    "network": "  bitneat plot network champion.pkl -o network.svg",
    "pareto": """\
  bitneat plot pareto runs examples/champions -o pareto.svg
  bitneat plot pareto small.pkl large.pkl --reference 300 -o pareto.png""",
    "size": "  bitneat plot size champion.pkl --targets cortex-m0,avr -o size.svg",
    "activations": "  bitneat plot activations --frac-bits 6 -o activations.png",
}
FILES = """\
  FILE             written: .svg or .png"""

_LARGEST = 1e100
"""Reward that a line is drawn at: an axis to the largest of all numbers has no room for its ticks."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add a sub-command for each figure."""
    figures = parser.add_subparsers(title="figures", metavar="FIGURE", required=True, dest="figure")

    def figure(name: str, help_text: str, draw: Callable[[argparse.Namespace, str], bytes]) -> argparse.ArgumentParser:
        sub = figures.add_parser(
            name,
            help=help_text,
            description=help_text,
            epilog=f"example:\n{_EXAMPLES[name]}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        sub.set_defaults(draw=draw)
        sub.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="an .svg or .png file")
        return sub

    sub = figure("fitness", "reward over the generations or steps of runs", _fitness)
    sub.add_argument("runs", metavar="RUN", type=Path, nargs="+", help="run folders of evolve, or their history.csv")
    sub.add_argument("--x", choices=("generations", "steps"), default="generations", help="what the axis counts")
    sub.add_argument(
        "--label",
        metavar="NAME",
        action="append",
        help="one for each RUN; runs of one name become a median with a band",
    )
    sub.add_argument(
        "--curve",
        metavar="CURVE",
        choices=("best", "mean", "selection"),
        action="append",
        help="best, mean or selection, once for each (default: all)",
    )
    _add_reference(sub)
    sub = figure("network", "what a champion reads, what its nodes do, what comes out", _network)
    _add_champion(sub)
    sub = figure("pareto", "champions by held-out reward and packed bytes, and the front", _pareto)
    sub.add_argument(
        "paths", metavar="PATH", type=Path, nargs="+", help="champions, run folders, or folders of such, at any depth"
    )
    sub.add_argument(
        "--env",
        metavar="ID",
        help="of champions for several environments, those for this one (default: for which most are)",
    )
    _add_reference(sub)
    sub = figure("size", "where a champion's packed bytes go, and its flash, RAM and stack on targets", _size)
    _add_champion(sub)
    from bitneat.cli.size import add_targets

    add_targets(sub)
    sub = figure("activations", "the integer activations against neat-python's", _activations)
    sub.add_argument(
        "--frac-bits", metavar="F", type=whole_number(4, 12), default=8, help="fractional bits of a signal (default 8)"
    )


def run(args: argparse.Namespace) -> int:
    """Draw the figure and write it."""
    from bitneat.files import require_writable, write_atomic
    from bitneat.report.figure import file_format, require_matplotlib

    file_type = file_format(args.output)
    require_matplotlib()
    require_writable(args.output)
    write_atomic(args.output, args.draw(args, file_type))
    print(f"wrote {args.output}")
    return 0


def _add_champion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="champion.pkl or champion.json"
    )


def _add_reference(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--reference",
        metavar="R",
        type=float,
        action="append",
        help="draw a line at this reward (default: where the environment counts as solved)",
    )


def _fitness(args: argparse.Namespace, file_type: str) -> bytes:
    from bitneat.report.fitness import CURVES, fitness_figure, read_history

    labels = [printable(label) for label in args.label or ()] or [_run_name(path) for path in args.runs]
    if len(labels) != len(args.runs):
        raise BitneatError(f"--label: expected one for each of {len(args.runs)} runs, or none, got {len(labels)}")
    histories = [read_history(path, label) for path, label in zip(args.runs, labels, strict=True)]
    curves = [curve for curve in CURVES if args.curve is None or curve in args.curve]
    references = _references(args, (history.environment for history in histories))
    return fitness_figure(histories, curves, args.x == "steps", references, file_type)


def _network(args: argparse.Namespace, file_type: str) -> bytes:
    from bitneat.champion import load_any
    from bitneat.report.wiring import network_figure

    return network_figure(load_any(args.champion), _champion_name(args.champion), file_type)


def _pareto(args: argparse.Namespace, file_type: str) -> bytes:
    from bitneat.report.pareto import collect, of_one_environment, pareto_figure

    found = of_one_environment(collect(args.paths), args.env)
    for line in found.left_out:
        print(f"left out: {line}", file=sys.stderr)
    return pareto_figure(found.points, _references(args, (point.environment for point in found.points)), file_type)


def _size(args: argparse.Namespace, file_type: str) -> bytes:
    from bitneat.champion import load
    from bitneat.cli.size import target_names
    from bitneat.report.sizes import size_figure
    from bitneat.verify.size import measure_sizes
    from bitneat.verify.targets import select

    report = measure_sizes(load(args.champion), select(target_names(args.targets), run=False))
    return size_figure(report, _champion_name(args.champion), file_type)


def _activations(args: argparse.Namespace, file_type: str) -> bytes:
    from bitneat.report.activations import activations_figure

    return activations_figure(args.frac_bits, file_type)


def _references(args: argparse.Namespace, environments: Iterable[EnvironmentSpec | None]) -> list[float]:
    """Those asked for; else the thresholds of the environments."""
    from bitneat.sim.environment import reward_threshold

    if args.reference is not None:
        for value in args.reference:
            if not abs(value) <= _LARGEST:
                raise BitneatError(f"--reference {value:g}: expected a reward in {-_LARGEST:g}..{_LARGEST:g}")
        return list(args.reference)
    return sorted({t for spec in environments if spec is not None and (t := reward_threshold(spec)) is not None})


def _run_name(path: Path) -> str:
    return printable((path.parent if path.name == "history.csv" else path).resolve().name)


def _champion_name(path: Path) -> str:
    """The folder's name where the file's says nothing."""
    folder = path.resolve().parent.name
    return printable(path.stem if path.stem != "champion" or not folder else f"{folder}/champion")
