# SPDX-License-Identifier: MIT
"""Reference, runtime and generated C give the same bits: on random controllers, at every optimisation, under sanitizers."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from bitneat.controller import Constant, Controller, Reference
from tests.compiled import SANITIZERS, Case, reference_outputs, run_compiled
from tests.strategies import input_vectors, random_controller

BATCH = 10
VECTORS = 1000
STEPS = 100
LEVELS = ("-O0", "-O2", "-O3", "-Os")


def drawn_case(seed: int, vectors: int = VECTORS) -> Case:
    """Case number ``seed``: a controller that reads its inputs, and vectors in sequences where it has state."""
    rng = random.Random(seed)
    while True:
        controller = random_controller(rng)
        if not all(isinstance(output, Constant) for output in controller.canonical.outputs):
            break
    steps = STEPS if controller.is_recurrent else 1
    inputs = np.array(input_vectors(controller, rng, vectors), np.int16)
    return Case(controller, inputs.reshape(vectors // steps, steps, len(controller.inputs)))


def assert_parity(folder: Path, seeds: range, level: str) -> None:
    cases = [drawn_case(seed) for seed in seeds]
    answers = run_compiled(folder, cases, (level, *SANITIZERS))
    for seed, case, answer in zip(seeds, cases, answers, strict=True):
        expected = reference_outputs(case)
        for implementation, outputs in answer.items():
            wrong = np.argwhere(outputs != expected)
            assert wrong.size == 0, (
                f"drawn_case({seed}), {implementation} at {level}: sequence, step, output {wrong[0].tolist()} is"
                f" {outputs[tuple(wrong[0])]}, expected {expected[tuple(wrong[0])]} ({case.controller.sha256})"
            )


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("batch", range(2))
def test_every_implementation_agrees_with_the_reference(tmp_path: Path, batch: int, level: str) -> None:
    assert_parity(tmp_path, range(batch * BATCH, (batch + 1) * BATCH), level)


@pytest.mark.long
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("batch", range(100))
def test_a_thousand_controllers_agree_with_the_reference(tmp_path: Path, batch: int, level: str) -> None:
    assert_parity(tmp_path, range(1000 + batch * BATCH, 1000 + (batch + 1) * BATCH), level)


@pytest.mark.parametrize("seed", range(40))
def test_the_vectorized_oracle_is_the_reference(seed: int) -> None:
    case = drawn_case(seed, vectors=100)
    for sequence, expected in zip(case.inputs, reference_outputs(case), strict=True):
        assert Reference(case.controller).run(sequence.tolist()) == expected.tolist()


def test_a_planted_fault_in_the_code_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import tests.compiled as compiled

    original = compiled.generate

    def faulty(controller: Controller, name: str, style: str, **options: object) -> object:
        code = original(controller, name, style, **options)  # type: ignore[arg-type]
        if style != "unrolled":
            return code
        from dataclasses import replace

        assert "_weights[0] >> 0" in code.source
        return replace(code, source=code.source.replace("_weights[0] >> 0", "_weights[0] >> 1", 1))

    monkeypatch.setattr(compiled, "generate", faulty)
    with pytest.raises(AssertionError, match="unrolled at -O2"):
        assert_parity(tmp_path, range(3, 4), "-O2")
