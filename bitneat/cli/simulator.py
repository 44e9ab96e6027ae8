# SPDX-License-Identifier: MIT
"""Which simulator runs a command's episodes, and on how many cores: the same arguments and choice for each command."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from bitneat.cli.arguments import whole_number
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import EnvironmentSpec
    from bitneat.evolve.evaluation import Evaluator
    from bitneat.evolve.recheck import Recheck
    from bitneat.sim.environment import EnvironmentInfo


def add_simulator(parser: argparse._ActionsContainer) -> None:
    """Add ``--workers`` and ``--simulator``, neither of which changes a result."""
    parser.add_argument(
        "--workers", metavar="N", type=whole_number(1), help="processes or threads (default: one a core)"
    )
    parser.add_argument(
        "--simulator",
        choices=("auto", "native", "gymnasium"),
        default="auto",
        help="what runs the episodes; the results are the same (default: auto, native for BipedalWalker)",
    )


def choose_simulator(spec: EnvironmentSpec, wanted: str) -> str:
    """What runs the episodes: "native", or as `GymnasiumEvaluator` takes it.

    Raises:
        BitneatError: if the native simulator is wanted and does not serve the environment.
    """
    from bitneat.native import build
    from bitneat.sim import bipedal
    from bitneat.sim.walker.original import obstacle

    if wanted == "gymnasium":
        return wanted
    if sys.stderr.isatty():
        build.announce = _announce
    reason = obstacle(spec)
    if reason is None:
        return "native"
    if wanted == "native":
        raise BitneatError(f"--simulator native: {reason}")
    if bipedal.is_walker(spec):
        print(f"bitneat: the native simulator, which is much faster, cannot be used: {reason}", file=sys.stderr)
    return "auto"


def _announce(name: str) -> None:
    print(f"bitneat: compiling {name}, once; it takes some seconds", file=sys.stderr, flush=True)


def evaluator_for(
    simulator: str, workers: int | None, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int
) -> tuple[Evaluator, Recheck | None]:
    """The evaluator, and, of the native simulator, what compares it with Gymnasium now and then."""
    from bitneat.evolve.evaluation import GymnasiumEvaluator, NativeWalkerEvaluator
    from bitneat.evolve.recheck import Recheck
    from bitneat.sim.walker.binding import default_threads

    workers = workers or default_threads()
    if simulator == "native":
        return NativeWalkerEvaluator(spec, max_steps, workers), Recheck(spec, info.action, max_steps)
    return GymnasiumEvaluator(spec, info.action, max_steps, workers, simulator), None
