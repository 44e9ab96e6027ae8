# SPDX-License-Identifier: MIT
"""Which simulator runs a command's episodes, and on how many cores: the same arguments and choice for each command."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from bitneat.cli.arguments import add_workers

if TYPE_CHECKING:
    from bitneat.champion import EnvironmentSpec
    from bitneat.evolve.evaluation import Evaluator
    from bitneat.evolve.recheck import Recheck
    from bitneat.sim.environment import EnvironmentInfo


def add_simulator(parser: argparse._ActionsContainer) -> None:
    """Add ``--workers`` and ``--simulator``, neither of which changes a result."""
    add_workers(parser, "processes or threads")
    parser.add_argument(
        "--simulator",
        choices=("auto", "native", "gymnasium"),
        default="auto",
        help="what runs the episodes; the results are the same (default: auto, native for BipedalWalker)",
    )


def choose_simulator(spec: EnvironmentSpec, wanted: str) -> str:
    """As `bitneat.evolve.simulators.choose`; what there is to say goes to stderr.

    Raises:
        BitneatError: if the native simulator is wanted and does not serve the environment.
    """
    from bitneat.evolve.simulators import choose
    from bitneat.native import build

    if sys.stderr.isatty():
        build.announce = _announce
    return choose(spec, wanted, lambda text: print(f"bitneat: {text}", file=sys.stderr))


def _announce(name: str) -> None:
    print(f"bitneat: compiling {name}, once; it takes some seconds", file=sys.stderr, flush=True)


def evaluator_for(
    simulator: str, workers: int | None, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int
) -> tuple[Evaluator, Recheck | None]:
    """As `bitneat.evolve.simulators.evaluator_for`, which is imported only now."""
    from bitneat.evolve.simulators import evaluator_for as make

    return make(simulator, workers, spec, info, max_steps)
