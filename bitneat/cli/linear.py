# SPDX-License-Identifier: MIT
"""``bitneat linear``: a linear policy as a ternary champion, to polish."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, seed, whole_number
from bitneat.cli.outcome import controller_data, print_champion, say_how_to_go_on, warn
from bitneat.cli.simulator import add_simulator, choose_simulator, evaluator_for
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import EnvironmentSpec
    from bitneat.controller import Input
    from bitneat.evolve.evaluation import Evaluator
    from bitneat.evolve.linear import LinearRow, LinearSearch
    from bitneat.evolve.recheck import Recheck
    from bitneat.sim.environment import EnvironmentInfo
    from bitneat.state import StateFile

HELP = "find a linear policy, and write it as a ternary champion to polish"
DESCRIPTION = """\
Finds a linear policy by an evolution strategy in the controller's own integers
and rounds it to powers of two; the rounding that does best on selection seeds
is the champion, with weights -1, 0 and +1. Minutes for BipedalWalker-v3."""
EXAMPLE = """\
  bitneat linear -o start                                  BipedalWalker-v3
  bitneat polish start/champion.pkl -o better"""
FILES = """\
  RUN/             written: linear.json (the checkpoint) and
                   linear-previous.json (the one before), champion.pkl,
                   champion.json"""

DEFAULT_GENERATIONS = 200
_WALKS_AT = 150.0
"""Median reward at which a walker's falls begin to count."""
_RESOLUTIONS = (1, 2, 3, 4)
_SELECTION_EPISODES = 64
_REPORT_EPISODES = 100
_FORMAT, _VERSION = "bitneat-linear", 2
"""Of the checkpoint; version 1 had no hash, and is read, too."""
_MAX_BYTES = 1 << 26
_STATE = "linear.json"
_FRAC_BITS = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``linear``; those that a resumed run must not change default to None."""
    environment = parser.add_argument_group("environment")
    environment.add_argument("--env", metavar="ID", help="Gymnasium environment (default BipedalWalker-v3)")
    environment.add_argument(
        "--import", metavar="MODULE", action="append", dest="imports", help="import MODULE, which registers ID"
    )
    search = parser.add_argument_group("search")
    search.add_argument("--pop", metavar="N", type=whole_number(4), help="policies in a generation (default 64)")
    search.add_argument(
        "--generations",
        metavar="N",
        type=whole_number(1),
        help=f"generations (default {DEFAULT_GENERATIONS}); with --resume, a new total",
    )
    search.add_argument("--seed", metavar="S", type=seed, help="seed of all randomness (default 0)")
    running = parser.add_argument_group("how it runs, which changes no result")
    add_simulator(running)
    results = parser.add_argument_group("results")
    results.add_argument("-o", "--output", metavar="RUN", type=Path, help="run folder (default runs/linear-SEED)")
    results.add_argument("--resume", metavar="RUN", type=Path, help="continue a run; its settings come from RUN")
    add_json(results)


def run(args: argparse.Namespace) -> int:
    """Search, and leave the best of the ternary roundings in the run folder."""
    from bitneat.champion import EnvironmentSpec
    from bitneat.evolve.linear import LinearSearch
    from bitneat.files import sole_user
    from bitneat.folders import LINEAR, begun
    from bitneat.sim import bipedal
    from bitneat.sim.environment import allow_imports, inspect

    allow_imports(args.imports or ())
    settings, imports, state, history, where = _settings(args)
    folder: Path = args.resume or args.output or Path("runs") / f"linear-{settings['seed']}"
    file = _state_file(folder)
    spec = EnvironmentSpec(settings["env"], {}, imports)
    info = inspect(spec)
    if info.max_steps is None:
        raise BitneatError(f"environment {spec.id}: has no time limit")
    simulator = choose_simulator(spec, args.simulator)
    walker = bipedal.is_walker(spec)
    search = LinearSearch(
        _inputs(info),
        info.action.num_outputs,
        _FRAC_BITS,
        settings["seed"],
        population=settings["population"],
        fall_reward=bipedal.FALL_REWARD if walker else math.nan,
        walks_at=_WALKS_AT if walker else math.inf,
    )
    if state is not None:
        _restore(where, search, state)
    if args.generations is not None and args.generations < search.generation:
        raise BitneatError(
            f"--resume {folder}: has completed {search.generation} generations, more than the {args.generations} asked for"
        )
    try:
        with ExitStack() as held:
            held.enter_context(begun(folder, LINEAR) if state is None else sole_user(folder))
            evaluator, recheck = evaluator_for(simulator, args.workers, spec, info, info.max_steps)
            held.callback(evaluator.close)
            while search.generation < settings["generations"]:
                row = search.advance(evaluator)
                history.append(list(vars(row).values()))
                _save(file, settings, imports, search, history)
                _tell(row)
            summary = _finish(folder, settings, search, evaluator=evaluator, recheck=recheck, spec=spec, info=info)
    except KeyboardInterrupt as stop:  # a second one while it closes, too
        say_how_to_go_on(stop, f"bitneat linear --resume {folder}", begun=file.exists())
        raise
    print_champion(summary)
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, summary)
    return 0


def _inputs(info: EnvironmentInfo) -> tuple[Input, ...]:
    """The scales that the bounds of the observation suggest, and one limit for all, which packs into a few bits."""
    from bitneat.sim.environment import default_inputs, one_limit

    return one_limit(default_inputs(info, _FRAC_BITS))


def _state_file(folder: Path) -> StateFile:
    from bitneat.state import StateFile

    return StateFile(folder / _STATE, _FORMAT, _VERSION, _MAX_BYTES)


def _settings(args: argparse.Namespace) -> tuple[dict[str, Any], tuple[str, ...], Any, list[Any], Path]:
    """What is asked for, the modules to import, and, of a resumed run, where it stands, its history and its file."""
    named = tuple(args.imports or ())
    if args.resume is None:
        settings = {
            "env": args.env or "BipedalWalker-v3",
            "seed": args.seed or 0,
            "population": args.pop or 64,
            "generations": args.generations or DEFAULT_GENERATIONS,
        }
        return settings, named, None, [], Path()
    for option, value in {"--env": args.env, "--seed": args.seed, "--pop": args.pop, "-o": args.output}.items():
        if value is not None:
            raise BitneatError(f"{option}: not with --resume, which takes it from the run")
    where, data = _load(args.resume)
    settings = data["settings"]
    if args.generations is not None:
        settings["generations"] = args.generations
    return settings, tuple(data.get("imports", named)), data["search"], data["history"], where


def _load(folder: Path) -> tuple[Path, Mapping[str, Any]]:
    from bitneat.files import refuse_links
    from bitneat.sim.walker.trigonometry import refuse_other

    file = _state_file(folder)
    if not file.exists():
        raise BitneatError(f"--resume {folder}: holds no run of bitneat linear: {_STATE} is missing")
    refuse_links(folder)
    path, data = file.load(warn)
    try:
        settings = data["settings"]
        numbers = [settings[key] for key in ("seed", "population", "generations")]
        if type(settings["env"]) is not str or any(type(n) is not int or n < 0 for n in numbers) or numbers[1] < 4:
            raise BitneatError("settings: expected the id of an environment and whole numbers")
        if type(data["history"]) is not list:
            raise BitneatError("history: expected a list")
        imports = data.get("imports", [])  # runs of before they were recorded lack the key
        if type(imports) is not list or any(type(name) is not str for name in imports):
            raise BitneatError("imports: expected a list of names")
        trigonometry = data["trigonometry"]
    except Exception as error:  # the file may be anyone's
        raise BitneatError(f"{path}: damaged: {_reason(error)}") from None
    refuse_other(trigonometry, str(path))
    return path, data


def _restore(path: Path, search: LinearSearch, state: Any) -> None:
    try:
        search.restore(state)
    except Exception as error:  # the file may be anyone's
        raise BitneatError(f"{path}: damaged: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:200] if isinstance(error, BitneatError) else type(error).__name__


def _save(
    file: StateFile, settings: dict[str, Any], imports: tuple[str, ...], search: LinearSearch, history: list[Any]
) -> None:
    from bitneat.champion import EnvironmentSpec
    from bitneat.sim.walker.trigonometry import probe_for

    file.save(
        {
            "settings": settings,
            "imports": list(imports),
            "trigonometry": probe_for(EnvironmentSpec(settings["env"])),
            "search": search.to_data(),
            "history": history,
        }
    )


def _tell(row: LinearRow) -> None:
    print(
        f"generation {row.generation} best {row.best:.1f} median {row.median:.1f} step size {row.step_size:.3f}"
        f" episodes {row.episodes} steps {row.steps}",
        file=sys.stderr,
        flush=True,
    )


def _finish(
    folder: Path,
    settings: dict[str, Any],
    search: LinearSearch,
    *,
    evaluator: Evaluator,
    recheck: Recheck | None,
    spec: EnvironmentSpec,
    info: EnvironmentInfo,
) -> dict[str, Any]:
    """Choose the resolution on the selection seeds, and report on others."""
    from bitneat.champion import Champion, save_json, save_pickle
    from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
    from bitneat.evolve.search import Candidate, Score
    from bitneat.version import __version__

    roundings = [search.ternary(resolution) for resolution in _RESOLUTIONS]
    results = evaluator.evaluate(roundings, selection_seeds(_SELECTION_EPISODES))
    scores = [Score.of(row) for row in results]
    best = max(range(len(roundings)), key=lambda i: scores[i].mean)
    controller = roundings[best]
    if recheck is not None:
        recheck(Candidate(controller, search.generation, tuple(e.reward for e in results[best])))
    held_out = Score.of(evaluator.evaluate([controller], report_seeds(_REPORT_EPISODES))[0])
    provenance = {
        "tool": f"bitneat {__version__}",
        "linear": {**settings, "resolution": _RESOLUTIONS[best]},
        "selection": {**scores[best].to_data(), "first_seed": SELECTION_START},
        "held_out": {**held_out.to_data(), "first_seed": REPORT_START},
        "max_steps": info.max_steps,
    }
    champion = Champion(controller, info.action, spec, provenance)
    save_json(champion, folder / "champion.json")
    save_pickle(champion, folder / "champion.pkl")
    return {
        "run": str(folder),
        "champion": str(folder / "champion.pkl"),
        "controller": controller_data(controller),
        "resolution": _RESOLUTIONS[best],
        "held_out": held_out.to_data(),
    }
