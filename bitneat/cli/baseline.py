# SPDX-License-Identifier: MIT
"""``bitneat baseline``: what a library for reinforcement learning makes of the same walker."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from bitneat.cli.arguments import add_json, whole_number

if TYPE_CHECKING:
    from bitneat.baselines import TrainingProgress

HELP = "train a baseline for BipedalWalker-v3 by ARS, PPO or DQN (needs bitneat[baselines])"
DESCRIPTION = """\
Trains a policy on the native walker by augmented random search, PPO or DQN of
stable-baselines3 and sb3-contrib, scores it over 100 held-out episodes as
champions are scored, and writes it as a float network. docs/baselines.md has
settings and results."""
EXAMPLE = """\
  bitneat baseline ars -o runs/ars             the same command again goes on, if it was stopped
  bitneat baseline ppo --steps 100000 --seed 1 --json ppo.json
  bitneat baseline ppo --hardcore -o teacher   for BipedalWalkerHardcore-v3; an hour"""
FILES = """\
  RUN/             written: baseline.json, checkpoint.pt, history.csv, policy.npz,
                   champion.pkl (not for dqn), model.zip, result.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``baseline``."""
    from bitneat.baselines.settings import DEFAULT_STEPS, HARDCORE_STEPS, METHODS

    defaults = ", ".join(f"{name} {steps}" for name, steps in DEFAULT_STEPS.items())
    parser.add_argument("method", choices=list(METHODS), help="the method")
    parser.add_argument(
        "--hardcore",
        action="store_true",
        help=f"train for BipedalWalkerHardcore-v3, by ppo (default budget {HARDCORE_STEPS})",
    )
    parser.add_argument(
        "--steps", metavar="N", type=whole_number(1), help=f"budget in steps of the environment (default {defaults})"
    )
    parser.add_argument(
        "--seed", metavar="S", type=whole_number(0), default=0, help="seed of all randomness (default 0)"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="RUN",
        type=Path,
        help="run folder (default runs/METHOD-SEED or runs/hardcore-METHOD-SEED)",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Train or go on training, and say what came of it."""
    from bitneat.baselines import train
    from bitneat.baselines.settings import DEFAULT_STEPS, HARDCORE_STEPS

    steps = args.steps or (HARDCORE_STEPS if args.hardcore else DEFAULT_STEPS[args.method])
    kind = f"hardcore-{args.method}" if args.hardcore else args.method
    folder: Path = args.output or Path("runs") / f"{kind}-{args.seed}"
    try:
        with _shown(sys.stderr) as show:
            result = train(args.method, steps, args.seed, folder, show, hardcore=args.hardcore)
    except KeyboardInterrupt as stop:
        stop.args = ("stopped; the same command goes on from the last checkpoint",)
        raise
    held_out = result.heldout
    print(
        f"{result.system}: {held_out.mean:.1f} ± {held_out.std:.1f} over {held_out.episodes} held-out episodes"
        f" (min {held_out.min:.1f}, max {held_out.max:.1f}, {100 * held_out.solved:.0f} % at 300 or more),"
        f" {result.parameters} parameters, {result.float_bytes} bytes, after {result.steps} steps"
    )
    print(f"written: {folder}")
    if args.json is not None:
        from bitneat.files import write_json

        write_json(args.json, result.to_data())
    return 0


@contextmanager
def _shown(stream: TextIO) -> Iterator[Callable[[TrainingProgress], None]]:
    """A bar on a terminal, a line an update elsewhere."""
    if not stream.isatty():
        yield lambda state: print(_line(state), file=stream, flush=True)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=stream)) as bar:
        task = bar.add_task("training")

        def show(state: TrainingProgress) -> None:
            bar.update(task, total=state.total, completed=min(state.steps, state.total), description=_line(state))

        yield show


def _line(state: TrainingProgress) -> str:
    recent = "-" if state.recent is None else f"{state.recent:.1f}"
    return f"{state.method} {state.phase} steps {state.steps} episodes {state.episodes} recent mean {recent}"
