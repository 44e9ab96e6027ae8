# SPDX-License-Identifier: MIT
"""``bitneat polish``: make a champion better, or smaller, by small changes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, add_time, seed, time_limit, whole_number
from bitneat.cli.outcome import controller_data, print_champion, say_how_to_go_on, warn
from bitneat.cli.simulator import add_simulator, choose_simulator, evaluator_for
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.evolve.polish import Polish, Row
    from bitneat.evolve.polish_run import PolishFolder, PolishSettings
    from bitneat.evolve.search import Score

HELP = "make a champion better, or smaller at the same reward, by small changes"
DESCRIPTION = """\
Varies champions a little, lets the variants race on common seeds, and keeps the
best few of every packed size. The result depends on the arguments alone. It can
be stopped at any moment (Ctrl-C), and --resume goes on."""
EXAMPLE = """\
  bitneat polish champion.pkl -o better                    look for the highest reward
  bitneat polish champion.pkl --max-bytes 128 --risk 0.5 -o safe
  bitneat polish better/champion.pkl --for size --floor 300 -o tiny
  bitneat polish --resume tiny --generations 500"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json, one or more
  RUN/             written: polish.json (the checkpoint) and
                   polish-previous.json (the one before), history.csv, front.csv,
                   champion.pkl, champion.json
  RUN/front/       written with --front: BYTES.pkl for each packed size"""

DEFAULT_GENERATIONS = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``polish``; those that a resumed run must not change default to None."""
    parser.add_argument("champions", metavar="CHAMPION", type=Path, nargs="*", help="champion files to start from")
    search = parser.add_argument_group("search")
    search.add_argument("--for", choices=("reward", "size"), dest="objective", help="what to look for (default reward)")
    search.add_argument(
        "--floor", metavar="R", type=float, help="mean reward that --for size keeps (default 300); progress tells of it"
    )
    search.add_argument(
        "--max-bytes", metavar="B", type=whole_number(1), help="packed bytes that the champion may have at most"
    )
    search.add_argument(
        "--risk",
        metavar="K",
        type=float,
        help="standard deviations of an episode that a mean loses when means are compared (default 0); makes falls rare",
    )
    search.add_argument(
        "--generations",
        metavar="N",
        type=whole_number(1),
        help=f"generations (default {DEFAULT_GENERATIONS}); with --resume, a new total",
    )
    add_time(search)
    search.add_argument("--seed", metavar="S", type=seed, help="seed of all randomness (default 0)")
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
    results.add_argument("-o", "--output", metavar="RUN", type=Path, help="run folder (default runs/polish-SEED)")
    results.add_argument("--resume", metavar="RUN", type=Path, help="continue a run; its settings come from RUN")
    results.add_argument(
        "--front", action="store_true", help="write the controllers that no smaller one equals, too, with their scores"
    )
    add_json(results)


def run(args: argparse.Namespace) -> int:
    """Polish, and leave the champion in the run folder."""
    from bitneat.controller.packing import pack
    from bitneat.evolve.polish import Polish
    from bitneat.evolve.polish_run import PolishFolder
    from bitneat.sim.environment import allow_imports

    time_limit(args.time)  # to refuse what is none before anything else
    if args.floor is not None and not abs(args.floor) < float("inf"):
        raise BitneatError(f"--floor {args.floor}: expected a finite reward")
    if args.risk is not None and not 0 <= args.risk < float("inf"):
        raise BitneatError(f"--risk {args.risk}: expected a number of at least 0")
    allow_imports(args.imports or ())
    history: list[Row] = []
    if args.resume is None:
        settings = _new_settings(args)
        folder = PolishFolder(args.output or Path("runs") / f"polish-{settings.seed}", warn)
        polish = Polish(settings.start, settings.goal, settings.seed)
    else:
        folder = PolishFolder(args.resume, warn)
        settings, polish, history = _resumed(args, folder)
    champion, score, finished = _polish(args, folder, settings, polish, history)
    if not finished:
        warn(f"--time cut the run short, which cannot be reproduced; bitneat polish --resume {folder.path} goes on")
    summary = _summary(folder, champion, score, finished)
    if excess := settings.goal.excess(len(pack(champion.controller))):
        warn(f"none of at most {settings.goal.max_bytes} packed bytes was found: the champion has {excess} more")
    print_champion(summary)
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, summary)
    return 0


def _polish(
    args: argparse.Namespace, folder: PolishFolder, settings: PolishSettings, polish: Polish, history: list[Row]
) -> tuple[Champion, Score, bool]:
    from bitneat.evolve.polish_run import carry_on
    from bitneat.sim.environment import inspect

    spec = settings.environment
    info = inspect(spec)
    sizes = {(len(c.inputs), len(c.outputs)) for c in settings.start}
    if sizes != {(info.num_inputs, info.action.num_outputs)}:
        raise BitneatError(f"{spec.id}: the champions do not fit it, or one another")
    if settings.action != info.action:
        raise BitneatError(f"{spec.id}: the champions are for another action space than its own")
    simulator = choose_simulator(spec, args.simulator)
    if args.resume is None:
        folder.create()
    evaluator = None
    try:
        try:
            evaluator, recheck = evaluator_for(simulator, args.workers, spec, info, settings.max_steps)
            return carry_on(folder, settings, polish, history, evaluator, tell=_tell, check=recheck, front=args.front)
        finally:
            if evaluator is not None:
                evaluator.close()
    except KeyboardInterrupt as stop:  # a second one while it closes, too
        say_how_to_go_on(stop, f"bitneat polish --resume {folder.path}", begun=folder.is_begun)
        raise


def _tell(row: Row) -> None:
    smallest = "-" if row.smallest is None else f"{row.smallest} bytes at {row.smallest_mean:.1f}"
    print(
        f"generation {row.generation} best {row.best:.1f} in {row.best_bytes} bytes, smallest above the floor {smallest},"
        f" archive {row.archive}, episodes {row.episodes}, steps {row.steps}",
        file=sys.stderr,
        flush=True,
    )


def _summary(folder: PolishFolder, champion: Champion, score: Score, finished: bool) -> dict[str, Any]:

    controller = champion.controller
    return {
        "run": str(folder.path),
        "champion": str(folder.champion_pickle),
        "finished": finished,
        "controller": controller_data(controller),
        "held_out": score.to_data(),
    }


def _new_settings(args: argparse.Namespace) -> PolishSettings:
    from bitneat.champion import load
    from bitneat.evolve.polish import Goal
    from bitneat.evolve.polish_run import PolishSettings
    from bitneat.sim.environment import inspect
    from bitneat.sim.walker.trigonometry import probe_for

    if not args.champions:
        raise BitneatError("polish: expected a CHAMPION to start from, or --resume RUN")
    champions = [load(path) for path in args.champions]
    first = champions[0]
    if first.environment is None:
        raise BitneatError(f"{args.champions[0]}: names no environment to polish in")
    for path, champion in zip(args.champions, champions, strict=True):
        if (champion.environment, champion.action) != (first.environment, first.action):
            raise BitneatError(f"{path}: is for another environment than {args.champions[0]}")
    limits = [
        int(limit)
        for limit in (first.provenance.get("max_steps"), inspect(first.environment).max_steps)
        if isinstance(limit, int) and limit > 0
    ]
    if not limits:
        raise BitneatError(f"environment {first.environment.id}: has no time limit, and {args.champions[0]} names none")
    return PolishSettings(
        first.environment,
        first.action,
        tuple(champion.controller for champion in champions),
        Goal(args.objective or "reward", 300.0 if args.floor is None else args.floor, args.max_bytes, args.risk or 0.0),
        args.generations or DEFAULT_GENERATIONS,
        args.seed or 0,
        min(limits),
        time_limit(args.time),
        probe_for(first.environment),
    )


def _resumed(args: argparse.Namespace, folder: PolishFolder) -> tuple[PolishSettings, Polish, list[Row]]:
    from dataclasses import replace

    from bitneat.sim.walker.trigonometry import refuse_other

    given = {
        "CHAMPION": args.champions or None,
        "--for": args.objective,
        "--floor": args.floor,
        "--max-bytes": args.max_bytes,
        "--risk": args.risk,
        "--seed": args.seed,
        "-o": args.output,
    }
    for option, value in given.items():
        if value is not None:
            raise BitneatError(f"{option}: not with --resume, which takes it from the run")
    settings, polish, history = folder.load()
    refuse_other(settings.trigonometry, str(folder.path / "polish.json"))
    if args.generations is not None:
        if args.generations < polish.generation:
            raise BitneatError(
                f"--resume {args.resume}: has completed {polish.generation} generations, more than the"
                f" {args.generations} asked for"
            )
        settings = replace(settings, generations=args.generations)
    return replace(settings, seconds=time_limit(args.time, settings.seconds)), polish, history
