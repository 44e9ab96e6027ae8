# SPDX-License-Identifier: MIT
"""Random controllers, stepped by everything that can: generated C in both styles, the runtime in every encoding, the reference."""

from __future__ import annotations

import random
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from bitneat.controller import Constant
from bitneat.native.compiler import host_compiler
from tests.compiled import SANITIZERS, Case, reference_outputs, run_compiled
from tests.fuzz.target import Batch, FindingError, Target, workshop
from tests.strategies import input_vectors, random_controller

BATCH = 20
STEPS = 1000
SEQUENCE = 50
LEVELS = ("-O0", "-O1")
"""The quick ones to compile, which takes most of the time; the parity tests have the others."""
SIZES = ("small", "medium", "large"), (16, 3, 1)
FIRST_SEED = 100_000
"""The parity tests have the seeds below."""


def drawn_case(seed: int) -> Case:
    """Case number ``seed``: any controller with a path to an output, and 1000 steps.

    They start with the extremes. Where there is state they are 20 sequences of 50 steps, of which four say the same in every
    step (the limits, their negatives, 0, one random vector), and one alternates between the limits and their negatives.
    """
    rng = random.Random(seed)
    while True:
        controller = random_controller(rng, size=rng.choices(*SIZES)[0])
        if not all(isinstance(output, Constant) for output in controller.canonical.outputs):
            break
    if not controller.is_recurrent:
        inputs = np.array(input_vectors(controller, rng, STEPS), np.int16)
        return Case(controller, inputs[:, np.newaxis, :])
    limits = np.array([entry.limit for entry in controller.inputs], np.int16)
    held = [limits, -limits, 0 * limits, np.array(input_vectors(controller, rng, 30)[-1], np.int16)]
    sequences = [np.tile(vector, (SEQUENCE, 1)) for vector in held]
    sequences.append(np.array([limits, -limits] * (SEQUENCE // 2), np.int16))
    rest = input_vectors(controller, rng, STEPS - len(sequences) * SEQUENCE)
    varied = np.array(rest, np.int16).reshape(-1, SEQUENCE, len(limits))
    return Case(controller, np.concatenate([np.array(sequences, np.int16), varied]))


def compare(seeds: range, level: str) -> Batch:
    """Step the cases of these seeds by all implementations, compiled at an optimisation level under ASan and UBSan.

    Raises:
        FindingError: where an implementation differs from the reference, or a sanitizer objects.
    """
    cases = [drawn_case(seed) for seed in seeds]
    with tempfile.TemporaryDirectory(prefix="steps-", dir=workshop()) as folder:
        try:
            answers = run_compiled(Path(folder), cases, (level, *SANITIZERS))
        except AssertionError as error:
            raise FindingError(f"steps: seeds {seeds.start}..{seeds.stop - 1} at {level}: {error}") from None
    implementations = 0
    for seed, case, answer in zip(seeds, cases, answers, strict=True):
        expected = reference_outputs(case)
        implementations += len(answer)
        for implementation, outputs in answer.items():
            wrong = np.argwhere(outputs != expected)
            if wrong.size:
                at = tuple(wrong[0])
                raise FindingError(
                    f"steps: seed {seed}, {implementation} at {level}: sequence, step, output {wrong[0].tolist()}"
                    f" is {outputs[at]}, expected {expected[at]}"
                )
    steps = sum(case.inputs.shape[0] * case.inputs.shape[1] for case in cases)
    return Batch(steps, {"controllers": len(cases), "implementations": implementations})


def _run(number: int) -> Batch:
    first, middle, level = (
        FIRST_SEED + number * BATCH,
        FIRST_SEED + number * BATCH + BATCH // 2,
        LEVELS[number % len(LEVELS)],
    )
    # The C compiler takes most of the time, so two of them.
    with ThreadPoolExecutor(2) as pool:
        halves = list(pool.map(compare, (range(first, middle), range(middle, first + BATCH)), (level, level)))
    also = {unit: sum(half.also[unit] for half in halves) for unit in halves[0].also}
    return Batch(sum(half.count for half in halves), also)


TARGET = Target(
    what="random controllers: C of both styles, runtime in each encoding and by lanes, against the reference",
    unit="steps",
    under="ASan, UBSan",
    tools=lambda: host_compiler().title,
    run=_run,
)
