# SPDX-License-Identifier: MIT
"""``bitneat distill``: a ternary controller that imitates a float champion."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_json, whole_number
from bitneat.cli.outcome import controller_data, print_champion, warn
from bitneat.errors import BitneatError, MissingExtraError

if TYPE_CHECKING:
    from bitneat.champion import Champion, FloatChampion
    from bitneat.distill.imitation import RoundRow
    from bitneat.distill.run import ReinforceRow, RoundingRow

HELP = "train a ternary controller to imitate a float champion of the walker (needs bitneat[baselines])"
DESCRIPTION = """\
Trains a small layered network to do what a float champion does, where the small
one itself goes (DAgger). It computes with integer weights and power-of-two gains
from early on, so that the controller is what was trained. With --reinforce it
goes on by its own reward, and is rounded layer by layer from there; so does
what an earlier run made, polished or not, without imitation. The same command
again goes on, if it was stopped. docs/distill.md explains it."""
EXAMPLE = """\
  bitneat baseline ppo --hardcore -o teacher
  bitneat distill teacher/champion.pkl -o student
  bitneat distill teacher/champion.pkl --reinforce 80000000 -o better
  bitneat distill better/champion.pkl --reinforce 80000000 -o still-better
  bitneat distill teacher/champion.pkl --hidden 48 --planes 1 -o smaller"""
FILES = """\
  TEACHER          read: the champion.pkl or champion.json of a float network,
                   or of a controller that distill made
  RUN/             written: distill.json, imitation.pt, reinforcement.pt,
                   champion.pkl, champion.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``distill``."""
    parser.add_argument(
        "teacher",
        metavar="TEACHER",
        type=Path,
        help="a float champion for the walker; or, with --reinforce, a distilled controller, which goes on",
    )
    student = parser.add_argument_group("student")
    student.add_argument(
        "--hidden",
        metavar="N",
        type=whole_number(1, 1024),
        nargs="+",
        help="nodes of each hidden layer (default 20 14; those of a controller that goes on are as they are)",
    )
    student.add_argument(
        "--planes",
        type=int,
        choices=(1, 2, 3),
        default=3,
        help="weights of up to 1, 3 or 7 times a power of two, as sums of links of weight 1 (default 3)",
    )
    training = parser.add_argument_group("training")
    training.add_argument(
        "--rounds",
        metavar="N",
        type=whole_number(3, 1000),
        default=16,
        help="rounds of walking and learning; with --reinforce, of rounding (default 16)",
    )
    training.add_argument(
        "--updates",
        metavar="N",
        type=whole_number(1),
        help="steps of the optimizer in each round of imitation (default 3000)",
    )
    training.add_argument(
        "--reinforce",
        metavar="STEPS",
        type=whole_number(0),
        default=0,
        help="before it has integers, let it go on by PPO for STEPS steps of the environment (default 0)",
    )
    training.add_argument(
        "--seed", metavar="S", type=whole_number(0), default=0, help="seed of all randomness (default 0)"
    )
    results = parser.add_argument_group("results")
    results.add_argument("-o", "--output", metavar="RUN", type=Path, help="run folder (default runs/distill-SEED)")
    add_json(results)


def run(args: argparse.Namespace) -> int:
    """Train or go on training, and say what came of it."""
    from bitneat.champion import Champion, load_any

    teacher = load_any(args.teacher)
    if isinstance(teacher, Champion):
        _require_going_on(args)
    _require_walkers(teacher, args.teacher)
    try:
        from bitneat.distill.imitation import DistillSettings
        from bitneat.distill.reinforcement import ReinforceSettings
        from bitneat.distill.run import distill
    except ImportError as error:
        raise MissingExtraError(
            f"distill: {error.name or 'a library'} is not installed; pip install 'bitneat[baselines]'"
        ) from None
    given = {"hidden": args.hidden and tuple(args.hidden), "updates": args.updates}
    settings = DistillSettings(
        planes=args.planes, rounds=args.rounds, **{key: value for key, value in given.items() if value is not None}
    )
    folder: Path = args.output or Path("runs") / f"distill-{args.seed}"
    try:
        settings_of = ReinforceSettings.going_on if isinstance(teacher, Champion) else ReinforceSettings
        champion, score = distill(
            teacher, settings, args.seed, folder, tell=_tell, reinforce=settings_of(args.reinforce)
        )
    except KeyboardInterrupt as stop:
        stop.args = ("stopped; the same command goes on from the last checkpoint",)
        raise
    summary = {
        "run": str(folder),
        "champion": str(folder / "champion.pkl"),
        "controller": controller_data(champion.controller),
        "held_out": score.to_data(),
    }
    print_champion(summary)
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, summary)
    return 0


def _require_going_on(args: argparse.Namespace) -> None:
    """Refuse what only imitation has a use for."""
    if not args.reinforce:
        raise BitneatError(
            f"{args.teacher}: is a controller already, which can go on with --reinforce STEPS; or give a float champion"
        )
    for option, value in (("--hidden", args.hidden), ("--updates", args.updates)):
        if value is not None:
            raise BitneatError(f"{option}: {args.teacher} is a controller already, which goes on without imitation")


def _require_walkers(teacher: Champion | FloatChampion, path: Path) -> None:
    """A file may name the walker and hold anything: to be known before the run is begun."""
    from bitneat.champion import Champion
    from bitneat.sim.bipedal import is_walker
    from bitneat.sim.walker.episodes import ACTION, NUM_INPUTS

    spec = teacher.environment
    if spec is None or not is_walker(spec):
        raise BitneatError(f"{path}: expected a teacher for BipedalWalker-v3 or BipedalWalkerHardcore-v3")
    inputs = len(teacher.controller.inputs) if isinstance(teacher, Champion) else teacher.network.num_inputs
    if inputs != NUM_INPUTS:
        raise BitneatError(f"{path}: has {inputs} inputs, {spec.id} gives {NUM_INPUTS}")
    if teacher.action != ACTION:
        raise BitneatError(f"{path}: is for another action space than that of {spec.id}")
    if isinstance(teacher, Champion):
        from bitneat.distill.layers import layers_of

        try:
            left_out = layers_of(teacher.controller).left_out
        except BitneatError as error:
            raise BitneatError(f"{path}: {error}") from None
        if left_out:
            warn(f"{path}: links that skip a layer are left out: {left_out}")


def _tell(row: RoundRow | ReinforceRow | RoundingRow) -> None:
    print(row.line, file=sys.stderr, flush=True)
