# SPDX-License-Identifier: MIT
"""``bitneat quantize``: integer and ternary champions after training."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, seed, whole_number
from bitneat.cli.columns import columns
from bitneat.cli.simulator import add_simulator, choose_simulator, evaluator_for
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import AnyChampion
    from bitneat.evolve.quantizing import Arena, Outcome, Request
    from bitneat.evolve.recheck import Recheck
    from bitneat.evolve.search import Score

HELP = "make a float champion an integer or ternary one, an integer champion ternary"
DESCRIPTION = """\
Makes a controller of a float network, or a ternary one of an integer one, and
prints what it loses: mean official reward before and after over 100 held-out
episodes. docs/quantize.md explains the methods."""
EXAMPLE = """\
  bitneat quantize float.pkl -o champion.pkl --to ternary
  bitneat quantize float.pkl -o champion.pkl --to int --method round
  bitneat quantize float.pkl -o champion.pkl --to ternary --method search --generations 100"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json
  FILE             written: .pkl or .json, the same content"""

_FLOAT_BYTES = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``quantize``."""
    parser.add_argument("champion", metavar="CHAMPION", type=Path, help="a float champion, or an integer one")
    method = parser.add_argument_group("method")
    method.add_argument("--to", choices=("int", "ternary"), default="ternary", help="kind of weights (default ternary)")
    add_method(method)
    method.add_argument("--frac-bits", metavar="F", type=whole_number(4, 12), help="fractional bits (default 8)")
    running = parser.add_argument_group("how it runs, which changes no result")
    running.add_argument(
        "--import",
        metavar="MODULE",
        action="append",
        dest="imports",
        help="import MODULE, which registers the environment",
    )
    add_simulator(running)
    results = parser.add_argument_group("results")
    results.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="the new champion; .json or .pkl"
    )
    add_json(results)


def add_method(parser: argparse._ActionsContainer) -> None:
    """Add what says how to quantize."""
    parser.add_argument(
        "--method",
        choices=("round", "twn", "gains", "search"),
        help="round: weight by weight; twn: a threshold and a scale for each node; gains: sums of powers of two;"
        " search: small changes to the best of the others (default gains)",
    )
    parser.add_argument("--generations", metavar="N", type=whole_number(1), help="of --method search (default 60)")
    parser.add_argument("--seed", metavar="S", type=seed, help="of --method search (default 0)")


def run(args: argparse.Namespace) -> int:
    """Quantize, compare, write."""
    from bitneat.champion import Champion, load_any
    from bitneat.files import require_writable
    from bitneat.sim.environment import allow_imports

    allow_imports(args.imports or ())
    require_writable(args.output)
    source = load_any(args.champion)
    if args.frac_bits is not None and isinstance(source, Champion):
        raise BitneatError("--frac-bits: an integer champion keeps its own")
    summary = make_champion(source, args, args.frac_bits or 8, str(args.champion))
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, summary)
    return 0


def make_champion(source: AnyChampion, args: argparse.Namespace, frac_bits: int, name: str) -> dict[str, Any]:
    """Quantize, write the champion to ``args.output`` and print how it compares; returns that as plain data.

    Raises:
        BitneatError: if the source, called ``name`` in messages, cannot be quantized as asked for.
    """
    from bitneat.champion import save_json, save_pickle
    from bitneat.evolve.quantizing import quantize

    request = _request(args, frac_bits)
    with _arena(source, args) as (arena, recheck):
        try:
            outcome = quantize(source, request, arena, tell=_tell)
        except BitneatError as error:
            raise BitneatError(f"{name}: {error}") from None
        if arena is not None and recheck is not None:
            _compare_with_gymnasium(outcome, arena, recheck)
    (save_json if args.output.suffix == ".json" else save_pickle)(outcome.champion, args.output)
    summary = _summary(source, outcome, str(args.output))
    _print(summary)
    return summary


def _request(args: argparse.Namespace, frac_bits: int) -> Request:
    from bitneat.evolve.quantizing import DEFAULT_GENERATIONS, Request

    for option, value in {"--generations": args.generations, "--seed": args.seed}.items():
        if value is not None and args.method != "search":
            raise BitneatError(f"{option}: only with --method search")
    return Request(args.to, args.method or "gains", frac_bits, args.generations or DEFAULT_GENERATIONS, args.seed or 0)


@contextlib.contextmanager
def _arena(source: AnyChampion, args: argparse.Namespace) -> Iterator[tuple[Arena | None, Recheck | None]]:
    """Where the champion is at home, and what compares the native simulator with Gymnasium."""
    from bitneat.evolve.quantizing import Arena
    from bitneat.sim.environment import inspect

    spec = source.environment
    if spec is None:
        yield None, None
        return
    info = inspect(spec)
    limits = [n for n in (source.provenance.get("max_steps"), info.max_steps) if isinstance(n, int) and n > 0]
    if not limits:
        raise BitneatError(f"environment {spec.id}: has no time limit, and the champion names none")
    max_steps = min(limits)
    evaluator, recheck = evaluator_for(choose_simulator(spec, args.simulator), args.workers, spec, info, max_steps)
    try:
        yield Arena(spec, info, max_steps, evaluator), recheck
    finally:
        evaluator.close()


def _compare_with_gymnasium(outcome: Outcome, arena: Arena, recheck: Recheck) -> None:
    from bitneat.evolve.randomness import selection_seeds
    from bitneat.evolve.search import Candidate

    controller = outcome.champion.controller
    (episodes,) = arena.evaluator.evaluate([controller], selection_seeds(1))
    recheck(Candidate(controller, 0, tuple(episode.reward for episode in episodes)))


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _summary(source: AnyChampion, outcome: Outcome, output: str) -> dict[str, Any]:
    from bitneat.champion import Champion
    from bitneat.cli.outcome import controller_data

    if isinstance(source, Champion):
        before = {"kind": "integer", **controller_data(source.controller)}
    else:
        network = source.network
        numbers = network.num_links + sum(node.bias != 0 for node in network.nodes)
        before = {
            "kind": "float",
            "sha256": network.sha256,
            "nodes": len(network.nodes),
            "links": network.num_links,
            "float32_bytes": _FLOAT_BYTES * numbers,
        }
    return {
        "champion": output,
        "source": {**before, "held_out": _score(outcome.before)},
        "controller": {**controller_data(outcome.champion.controller), "held_out": _score(outcome.after)},
        "exact": outcome.exact,
        "chosen": dict(outcome.trials[0].candidate.how),
        "tried": [trial.to_data() for trial in outcome.trials],
    }


def _score(score: Score | None) -> dict[str, Any] | None:
    return None if score is None else score.to_data()


def _print(summary: dict[str, Any]) -> None:
    source, controller = summary["source"], summary["controller"]
    kind = "ternary" if controller["ternary"] else "integer"

    def row(name: str, data: dict[str, Any], size: int) -> tuple[object, ...]:
        score = data["held_out"]
        reward = "-" if score is None else f"{score['mean']:.1f} ± {score['std']:.1f}"
        return name, reward, data["nodes"], data["links"], size

    size = source["float32_bytes"] if source["kind"] == "float" else source["packed_bytes"]
    rows = [
        row(f"before, {source['kind']}", source, size),
        row(f"after, {kind}", controller, controller["packed_bytes"]),
    ]
    print(columns(("", "reward over 100 held-out episodes", "nodes", "links", "bytes"), rows, indent=""))
    if source["kind"] == "float":
        print("bytes: of a float network 4 for each weight and bias, its topology left out; of a controller everything")
    chosen = " ".join(f"{key} {value}" if key != "method" else str(value) for key, value in summary["chosen"].items())
    print(f"chosen: {chosen}")
    print(f"written: {summary['champion']}")
