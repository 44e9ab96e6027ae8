# SPDX-License-Identifier: MIT
"""``bitneat evolve``: evolve a controller in a Gymnasium environment."""

from __future__ import annotations

import argparse
import ast
import contextlib
import filecmp
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, add_time, seed, time_limit, whole_number
from bitneat.cli.outcome import controller_data, print_champion, warn
from bitneat.cli.simulator import add_simulator, choose_simulator, evaluator_for
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import EnvironmentSpec
    from bitneat.controller import Controller
    from bitneat.evolve.config import Config
    from bitneat.evolve.evaluation import Evaluator
    from bitneat.evolve.progress import Progress
    from bitneat.evolve.recheck import Recheck
    from bitneat.evolve.run import Outcome
    from bitneat.evolve.run_folder import RunFolder, RunSettings
    from bitneat.sim.environment import EnvironmentInfo

HELP = "evolve a ternary controller in a Gymnasium environment"
DESCRIPTION = """\
Searches the topology of a network with weights -1, 0 and +1 by NEAT, in the
integers that the chip will compute. The result depends on environment,
configuration and seed alone: not on workers, simulator or interruptions. It
can be stopped at any moment (Ctrl-C), and --resume goes on."""
EXAMPLE = """\
  bitneat evolve                                          BipedalWalker-v3 into runs/BipedalWalker-v3-0
  bitneat evolve --env CartPole-v1 --generations 20 -o cartpole
  bitneat evolve --resume runs/BipedalWalker-v3-0
  bitneat evolve --start float.pkl -o from-teacher        from a float teacher
  bitneat evolve --evaluator ray --ray-address auto       the episodes on a Ray cluster"""
FILES = """\
  RUN/             written: config.ini, run.json, history.csv, checkpoints/,
                   champion.pkl, champion.json, report.json
  champion.pkl     written too, in this folder, if neither -o nor --resume is
                   given; one that is no copy of a run's in runs/ is refused
  FILE             with --config: read"""

DEFAULT_ENVIRONMENT = "BipedalWalker-v3"
_RUNS = Path("runs")
_COPY = Path("champion.pkl")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``evolve``; those that a resumed run must not change default to None."""
    environment = parser.add_argument_group("environment")
    environment.add_argument("--env", metavar="ID", help=f"Gymnasium environment (default {DEFAULT_ENVIRONMENT})")
    environment.add_argument(
        "--env-arg", metavar="K=V", action="append", help="argument of the environment, a Python literal or a string"
    )
    environment.add_argument(
        "--import",
        metavar="MODULE",
        action="append",
        dest="imports",
        help="import MODULE, which registers ID (again with --resume)",
    )
    search = parser.add_argument_group("search")
    search.add_argument(
        "--config", metavar="FILE|PRESET", help="configuration (default: the preset of the environment)"
    )
    search.add_argument(
        "--start",
        metavar="CHAMPION",
        type=Path,
        help="start from this champion, or from a float teacher's ternary versions, instead of from nothing",
    )
    search.add_argument("--pop", metavar="N", type=whole_number(2), help="population size")
    search.add_argument(
        "--generations", metavar="N", type=whole_number(1), help="generations; with --resume, a new total"
    )
    add_time(search)
    search.add_argument("--seed", metavar="S", type=seed, help="seed of all randomness (default 0)")
    running = parser.add_argument_group("how it runs, which changes no result")
    add_simulator(running)
    running.add_argument(
        "--evaluator",
        choices=("local", "ray"),
        default="local",
        help="where episodes run: on this machine, or on a Ray cluster (needs bitneat[cluster]); the results are the same",
    )
    running.add_argument(
        "--ray-address",
        metavar="ADDRESS",
        help="of the cluster, as auto or ray://HOST:PORT (default: RAY_ADDRESS, else one is started on this machine)",
    )
    running.add_argument("--plain", action="store_true", help="plain lines on a terminal, too, and no live view")
    results = parser.add_argument_group("results")
    results.add_argument("-o", "--output", metavar="RUN", type=Path, help="run folder (default runs/ENV-SEED)")
    results.add_argument("--resume", metavar="RUN", type=Path, help="continue a run; its settings come from RUN")
    results.add_argument(
        "--tensorboard",
        metavar="DIR",
        nargs="?",
        const="",
        help="log for TensorBoard, into DIR (default RUN/tensorboard; again with --resume; needs bitneat[tensorboard])",
    )
    add_json(results)


def run(args: argparse.Namespace) -> int:
    """Evolve, and leave the champion in the run folder, and in the current one if no folder was named."""
    from bitneat.evolve.run_folder import RunFolder
    from bitneat.files import require_writable
    from bitneat.sim.environment import allow_imports

    if args.ray_address is not None and args.evaluator != "ray":
        raise BitneatError("--ray-address: only with --evaluator ray")
    time_limit(args.time)  # to refuse what is none before anything else
    allow_imports(args.imports or ())
    if args.resume is None:
        if args.output is None:
            require_writable(_COPY)
            if not _is_copy():
                raise BitneatError(
                    f"{_COPY}: exists and would be overwritten, and no {_RUNS}/*/{_COPY} is the same;"
                    " move it elsewhere, or give -o"
                )
        settings = _new_settings(args)
        path = args.output or _RUNS / f"{settings.environment.id.replace('/', '-')}-{settings.seed}"
        folder = RunFolder(path, warn)
    else:
        _refuse_other_settings(args)
        folder = RunFolder(args.resume, warn)
        settings = _resumed_settings(args, folder)
    outcome = _evolve(args, folder, settings)
    if not outcome.finished:
        warn(f"--time cut the run short, which cannot be reproduced; bitneat evolve --resume {folder.path} goes on")
    if args.output is None and args.resume is None:
        from bitneat.champion import save_pickle

        if _is_copy():
            save_pickle(outcome.champion, _COPY)
        else:
            warn(f"{_COPY}: another was put here meanwhile, and stays; the champion is {folder.champion_pickle}")
    _print_summary(folder, outcome, settings.config)
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, summary(folder, outcome))
    return 0


def _is_copy() -> bool:
    """Whether the champion in the current folder is no loss: there is none, or a run that is kept has the same."""
    if not _COPY.is_file():
        return True
    with contextlib.suppress(OSError):
        return any(filecmp.cmp(_COPY, path, shallow=False) for path in _RUNS.glob(f"*/{_COPY}"))
    return False


def summary(folder: RunFolder, outcome: Outcome) -> dict[str, Any]:
    """What ``--json`` says."""
    controller = outcome.candidate.controller
    assert outcome.champion.environment is not None
    return {
        "run": str(folder.path),
        "champion": str(folder.champion_pickle),
        "environment": outcome.champion.environment.id,
        "finished": outcome.finished,
        "generation": outcome.candidate.generation,
        "controller": controller_data(controller),
        "held_out": outcome.score.to_data(),
    }


def _evolve(args: argparse.Namespace, folder: RunFolder, settings: RunSettings) -> Outcome:
    from dataclasses import replace

    from bitneat.evolve.run import carry_on, searching
    from bitneat.evolve.setup import episode_limit
    from bitneat.sim.environment import inspect

    info = inspect(settings.environment)
    max_steps = episode_limit(settings.config, settings.environment, info)
    simulator = choose_simulator(settings.environment, args.simulator)
    progress = _progress(args, folder)
    with folder.begin(settings) if args.resume is None else folder.alone():
        if args.resume is not None and (args.config, args.generations, args.time) != (None, None, None):
            # Only when the last checkpoint is known to go on with them: what is saved is what every later --resume takes.
            if args.config is not None:
                _renew_checkpoint(folder, info)
            search = searching(folder, settings, info)
            folder.restore(search, settings.begun_at)
            if search.finished and settings.seconds is not None:  # nothing is left that it could cut off
                settings = replace(settings, seconds=folder.settings().seconds)
            folder.save_settings(settings)
        _tell_of_linear_start_alone(settings.config)
        evaluator: Evaluator | None = None
        try:
            try:
                evaluator, recheck = _evaluator(args, simulator, settings.environment, info, max_steps)
                return carry_on(folder, settings, info, evaluator, progress, check=recheck)
            finally:
                # The terminal first: a cluster takes seconds to close, and who waits for that may press Ctrl-C again.
                try:
                    progress.close()
                finally:
                    if evaluator is not None:
                        evaluator.close()
        except KeyboardInterrupt as stop:
            stop.args = (f"stopped; continue with: bitneat evolve --resume {folder.path}",)
            raise


def _renew_checkpoint(folder: RunFolder, info: EnvironmentInfo) -> None:
    """Write the last checkpoint anew: an old one has numbers for activations, which only its own configuration explains."""
    from bitneat.evolve.run import searching

    before = folder.settings()
    if before.config["NEAT"]["genome"] == "PlainGenome" and folder.generations(before.begun_at):
        search = searching(folder, before, info)
        folder.restore(search, before.begun_at)
        folder.save_checkpoint(search)


def _evaluator(
    args: argparse.Namespace, simulator: str, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int
) -> tuple[Evaluator, Recheck | None]:
    if args.evaluator == "local":
        return evaluator_for(simulator, args.workers, spec, info, max_steps)
    from bitneat.evolve.cluster import RayEvaluator
    from bitneat.evolve.simulators import recheck_for

    cluster = RayEvaluator(
        spec, info.action, max_steps,
        simulator=simulator, address=args.ray_address, workers=args.workers,
        warn=warn,
    )  # fmt: skip
    return cluster, recheck_for(simulator, spec, info, max_steps)


def _progress(args: argparse.Namespace, folder: RunFolder) -> Progress:
    from bitneat.evolve.progress import Together, progress_for

    shown = progress_for(plain=args.plain)
    if args.tensorboard is None:
        return shown
    from bitneat.evolve.tensorboard import TensorBoardProgress

    return Together((shown, TensorBoardProgress(Path(args.tensorboard or folder.path / "tensorboard"), warn)))


def _tell_of_linear_start_alone(config: Config) -> None:
    linear, generations = config["evolve"]["linear_generations"], config["evolve"]["generations"]
    if 0 < generations <= linear:
        print(
            f"bitneat: only the linear start runs: it takes {linear} generations, and {generations} are asked for;"
            " NEAT begins after them",
            file=sys.stderr,
        )


def _new_settings(args: argparse.Namespace) -> RunSettings:
    from bitneat.champion import EnvironmentSpec
    from bitneat.evolve.config import load, preset_for
    from bitneat.evolve.run_folder import RunSettings
    from bitneat.sim.walker.trigonometry import probe_for

    spec = EnvironmentSpec(
        args.env or DEFAULT_ENVIRONMENT, _keyword_arguments(args.env_arg or []), tuple(args.imports or ())
    )
    config = load(args.config if args.config is not None else preset_for(spec))
    if args.pop is not None:
        config = config.with_values("NEAT", pop_size=args.pop)
    config = _with_generations(config, args.generations)
    start: tuple[Controller, ...] = ()
    if args.start is not None:
        from bitneat.champion import load_any
        from bitneat.evolve.starting import starting_point
        from bitneat.sim.environment import inspect

        config, start = starting_point(load_any(args.start), config, inspect(spec), f"--start {args.start}")
    return RunSettings(spec, config, args.seed or 0, time_limit(args.time), trigonometry=probe_for(spec), start=start)


def _resumed_settings(args: argparse.Namespace, folder: RunFolder) -> RunSettings:
    from dataclasses import replace

    from bitneat.evolve.config import load
    from bitneat.evolve.run_folder import Stage
    from bitneat.sim.walker.trigonometry import refuse_other

    settings = folder.settings()
    refuse_other(settings.trigonometry, str(folder.path / "run.json"))
    if args.config is not None:
        config = _as_begun(args.config, load(args.config), settings)
        if _with_generations(config, args.generations).text != settings.config.text:  # else it took over already
            stage = Stage(folder.generations(settings.begun_at), settings.config.text)
            settings = replace(settings, config=config, earlier=(*settings.earlier, stage))
    config = _with_generations(settings.config, args.generations)
    done, wanted = folder.generations(settings.begun_at), config["evolve"]["generations"]
    if wanted < done and (args.config, args.generations) != (None, None):
        raise BitneatError(
            f"--resume {folder.path}: has completed {done} generations, more than the {wanted} asked for"
        )
    return replace(settings, config=config, seconds=time_limit(args.time, settings.seconds))


def _as_begun(where: str, config: Config, settings: RunSettings) -> Config:
    """The new configuration of a run that has begun, with the inputs of what it started from.

    Raises:
        BitneatError: if it names other kinds of genome, reproduction or weights, or candidates would be scored otherwise.
    """
    for key in ("genome", "reproduction"):
        if config["NEAT"][key] != settings.config["NEAT"][key]:
            raise BitneatError(
                f"--config {where}: [NEAT] {key}: a run that has begun keeps its {settings.config['NEAT'][key]}"
            )
    weights = settings.config["PlainGenome"]["weights"]
    if config["NEAT"]["genome"] == "PlainGenome" and config["PlainGenome"]["weights"] != weights:
        raise BitneatError(f"--config {where}: [PlainGenome] weights: a run that has begun keeps its {weights} weights")
    for key in ("max_steps", "selection_episodes"):
        before = settings.config["evolve"][key]
        if config["evolve"][key] != before:
            raise BitneatError(
                f"--config {where}: [evolve] {key}: a run that has begun keeps its {before}, with which its candidates were scored"
            )
    if settings.start:
        kept = ("linear_generations", "frac_bits", "input_scales", "input_limits")
        config = config.with_values("evolve", **{key: settings.config["evolve"][key] for key in kept})
    linear = (
        ("linear_generations", "linear_population")
        if settings.config["evolve"]["linear_generations"]
        else ("linear_generations",)
    )
    for key in linear:
        if config["evolve"][key] != settings.config["evolve"][key]:
            raise BitneatError(f"--config {where}: [evolve] {key}: a run that has begun keeps its linear start")
    return config


def _with_generations(config: Config, generations: int | None) -> Config:
    return config if generations is None else config.with_values("evolve", generations=generations)


def _refuse_other_settings(args: argparse.Namespace) -> None:
    given = {
        "--env": args.env, "--env-arg": args.env_arg, "--pop": args.pop,
        "--seed": args.seed, "--start": args.start, "-o": args.output,
    }  # fmt: skip
    for option, value in given.items():
        if value is not None:
            raise BitneatError(f"{option}: not with --resume, which takes it from the run")


def _keyword_arguments(pairs: list[str]) -> dict[str, Any]:
    from bitneat.champion import plain_data

    arguments = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.isidentifier():
            raise BitneatError(f"--env-arg {pair}: expected NAME=VALUE")
        try:
            value = ast.literal_eval(text)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            value = {"true": True, "false": False, "none": None}.get(text.lower(), text)
        try:
            value = plain_data(value)  # as the champion file will hold it
        except BitneatError as error:
            reason = str(error).removeprefix("refused: ")
            raise BitneatError(f"--env-arg {key}: {reason}; expected numbers, text, lists or dictionaries") from None
        arguments[key] = value
    return arguments


def _print_summary(folder: RunFolder, outcome: Outcome, config: Config) -> None:
    from bitneat.evolve.lowering import has_path

    if not outcome.finished:
        done, linear = outcome.champion.provenance["generations"], config["evolve"]["linear_generations"]
        where = f" in the linear start, before NEAT began: {done} of its {linear} generations" if done < linear else ""
        print(f"stopped by --time{where}")
    print_champion(summary(folder, outcome))
    if not has_path(outcome.candidate.controller):
        print(
            "warning: the champion has no path from any input to an output; evolve longer, or with a larger population"
        )
