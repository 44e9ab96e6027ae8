# SPDX-License-Identifier: MIT
"""Whether the native walker still agrees with Gymnasium, asked of every controller that takes the lead.

Tests hold the two together, but with the Box2D that they ran on. Another build of it, or another compiler, may differ in a last
bit, and a run that went on with that could not be reproduced.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import GymnasiumEvaluator
from bitneat.evolve.randomness import selection_seeds

if TYPE_CHECKING:
    from bitneat.evolve.search import Candidate


class SimulatorsDifferError(BitneatError):
    """The native walker and Gymnasium disagree about an episode; the run itself can go on with Gymnasium."""


class Recheck:
    """Runs a candidate's episode of the first selection seed again, whole and in Gymnasium itself.

    Args:
        spec: the environment.
        action: its action space.
        max_steps: the time limit of an episode.
    """

    def __init__(self, spec: EnvironmentSpec, action: Action, max_steps: int) -> None:
        self._gymnasium = GymnasiumEvaluator(spec, action, max_steps, 1, "gymnasium")
        self._agreed: tuple[str, float] | None = None

    def __call__(self, candidate: Candidate) -> None:
        """Compare; a candidate that was compared just before is not run again.

        Raises:
            SimulatorsDifferError: if the rewards differ in any bit.
        """
        reward = candidate.rewards[0]
        if self._agreed == (candidate.controller.sha256, reward):
            return
        seed = selection_seeds(1)[0]
        truth = self._gymnasium.evaluate([candidate.controller], [seed])[0][0]
        if truth.reward != reward:
            raise SimulatorsDifferError(
                f"seed {seed}: the native simulator's reward {reward!r} is not Gymnasium's {truth.reward!r}"
                f" (controller {candidate.controller.sha256[:12]}); is this another build of Box2D?"
                " use --simulator gymnasium, with --resume to go on with this run"
            )
        self._agreed = (candidate.controller.sha256, reward)
