# SPDX-License-Identifier: MIT
"""What a proof is about: a binary, and the controller that it should compute."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bitneat.controller import Controller
from bitneat.prove.equivalence import Lemmas
from bitneat.prove.execute import Processor
from bitneat.prove.semantics import IntArray
from bitneat.verify.targets.emulated import EmulatedC
from bitneat.verify.targets.image import Image
from bitneat.verify.vectors import random_vectors


@dataclass(frozen=True)
class Subject:
    """A binary and what it should compute."""

    controller: Controller
    emulated: EmulatedC
    processor: Processor
    lemmas: Lemmas
    start: int = 0
    """What is added to the index of the largest output, where the C chooses among actions."""
    paranoid: bool = False

    @property
    def image(self) -> Image:
        """The linked program."""
        return self.emulated.image

    @property
    def guard(self) -> bool:
        """Whether inputs may be any int16: ``name_run`` gets them as they are."""
        return self.image.code.guard and self.image.entry == "step"

    def inputs(self, count: int, seed: int) -> IntArray:
        """(count, inputs) of the domain, which is all of int16 where inputs are guarded."""
        inputs = random_vectors(self.controller, seed, count).astype(np.int64)
        if self.guard:
            wide = np.random.default_rng(seed).integers(-32768, 32767, size=inputs.shape, endpoint=True)
            inputs[::2] = wide[::2]
        return inputs
