# SPDX-License-Identifier: MIT
"""Which simulator runs the episodes of an environment, and the evaluator for it. The choice never changes a result."""

from __future__ import annotations

from collections.abc import Callable

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator, GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.evolve.recheck import Recheck
from bitneat.sim import bipedal
from bitneat.sim.environment import EnvironmentInfo

SIMULATORS = ("auto", "native", "gymnasium")


def choose(spec: EnvironmentSpec, wanted: str, warn: Callable[[str], None]) -> str:
    """What runs the episodes: "native", or as `GymnasiumEvaluator` takes it.

    Args:
        spec: the environment.
        wanted: one of `SIMULATORS`.
        warn: told in a line why the native walker, which is much faster, cannot serve an environment that it should.

    Raises:
        BitneatError: if the native simulator is wanted and does not serve the environment.
    """
    from bitneat.sim.walker.original import obstacle

    if wanted not in SIMULATORS:
        raise BitneatError(f"simulator {wanted!r:.40}: expected one of {', '.join(SIMULATORS)}")
    if wanted == "gymnasium":
        return wanted
    reason = obstacle(spec)
    if reason is None:
        return "native"
    if wanted == "native":
        raise BitneatError(f"--simulator native: {reason}")
    if bipedal.is_walker(spec):
        warn(f"the native simulator, which is much faster, cannot be used: {reason}")
    return "auto"


def evaluator_for(
    simulator: str, workers: int | None, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int
) -> tuple[Evaluator, Recheck | None]:
    """The evaluator on this machine, and, of the native simulator, what compares it with Gymnasium now and then.

    Args:
        simulator: as `choose` returns it.
        workers: processes or threads; None for one a core.
        spec: the environment, and ``info`` what is known of it.
        info: as `bitneat.sim.environment.inspect` returns it.
        max_steps: the time limit of an episode.
    """
    from bitneat.sim.walker.binding import default_threads

    workers = workers or default_threads()
    if simulator == "native":
        return NativeWalkerEvaluator(spec, max_steps, workers), recheck_for(simulator, spec, info, max_steps)
    return GymnasiumEvaluator(spec, info.action, max_steps, workers, simulator), None


def recheck_for(simulator: str, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int) -> Recheck | None:
    """What compares the native simulator with Gymnasium now and then, on this machine; None for any other simulator."""
    return Recheck(spec, info.action, max_steps) if simulator == "native" else None
