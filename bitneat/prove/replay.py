# SPDX-License-Identifier: MIT
"""Counterexamples: steps for which the binary, run in the emulator, is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bitneat.controller import Controller, Reference
from bitneat.controller.reference import evaluate_signals, outputs_of
from bitneat.prove.semantics import IntArray
from bitneat.prove.subject import Subject
from bitneat.verify.implementation import ImplementationError

_TRIES = 512
_STEPS = 12
_SEED = 3


@dataclass(frozen=True, slots=True)
class Counterexample:
    """Steps of which the last one comes out wrong in the emulated binary."""

    sequence: tuple[tuple[int, ...], ...]
    """Inputs of successive steps."""
    state: tuple[int, ...] | None
    """What the C's state is set to before the first of them; None where they start from a reset, or there is no state."""
    expected: tuple[int, ...]
    found: tuple[int, ...] | None
    """None if it crashed or did not come back."""

    def to_data(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "sequence": [list(inputs) for inputs in self.sequence],
            "state": None if self.state is None else list(self.state),
            "expected": list(self.expected),
            "found": None if self.found is None else list(self.found),
        }


def search(
    subject: Subject, meaning: Sequence[int | None], attempt: tuple[Sequence[int], Sequence[int]] | None
) -> Counterexample | None:
    """Steps for which the emulated binary is wrong: what a solver suggests, else random ones."""
    if attempt is not None:
        inputs, previous = ([int(value) for value in part] for part in attempt)
        found = _try(subject, meaning, inputs, previous)
        if found is not None:
            return found
    steps = _STEPS if subject.image.code.num_state else 1
    vectors = subject.inputs(_TRIES * steps, _SEED).reshape(_TRIES, steps, -1)
    for sequence in vectors:
        found = _replayed(subject, sequence)
        if found is not None:
            return found
    return None


def _limited(controller: Controller, inputs: Sequence[int]) -> list[int]:
    """Inputs as the controller gets them where the C is to clip them; the same where they are within their limits."""
    return [max(-entry.limit, min(entry.limit, x)) for x, entry in zip(inputs, controller.inputs, strict=True)]


def _try(
    subject: Subject, meaning: Sequence[int | None], inputs: Sequence[int], previous: Sequence[int]
) -> Counterexample | None:
    """One step from a given state."""
    controller = subject.controller
    signals = evaluate_signals(controller, _limited(controller, inputs), previous)
    expected = tuple(outputs_of(controller, signals))
    state = [0 if signal is None else previous[signal] for signal in meaning]
    found: tuple[int, ...] | None
    try:
        answer = subject.emulated.step_from(np.array(state, dtype=np.int16), np.array(inputs, dtype=np.int16))
        found = tuple(answer.tolist())
    except ImplementationError:
        subject.emulated.restart()
        found = None
    if found == expected:
        return None
    return Counterexample((tuple(inputs),), tuple(state) if state else None, expected, found)


def _replayed(subject: Subject, sequence: IntArray) -> Counterexample | None:
    """Steps from reset."""
    controller = subject.controller
    expected = Reference(controller).run([_limited(controller, inputs) for inputs in sequence.tolist()])
    try:
        subject.emulated.reset()
        found = subject.emulated.run(sequence.astype(np.int16)).tolist()
    except ImplementationError:
        subject.emulated.restart()
        return Counterexample(_rows(sequence), None, tuple(expected[-1]), None)
    for step, (wanted, got) in enumerate(zip(expected, found, strict=True)):
        if wanted != got:
            return Counterexample(_rows(sequence[: step + 1]), None, tuple(wanted), tuple(got))
    return None


def _rows(sequence: IntArray) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(inputs) for inputs in sequence.tolist())
