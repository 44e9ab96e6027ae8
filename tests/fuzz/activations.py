# SPDX-License-Identifier: MIT
"""Every activation at every argument and every precision, on every target: not random at all, so that nothing is left over."""

from __future__ import annotations

import tempfile
from itertools import product
from pathlib import Path

import numpy as np

from bitneat.codegen import generate
from bitneat.controller import ACTIVATION_NAMES, Controller, Input, Link, Node, Signal
from bitneat.controller.activation import table
from bitneat.controller.ir import FRAC_BITS_RANGE, SIGNAL_MAX
from bitneat.verify.cfile import CFile
from bitneat.verify.targets import TARGETS, select
from tests.fuzz.target import MEMORY, Batch, FindingError, Target

ARGUMENTS = np.arange(-SIGNAL_MAX, SIGNAL_MAX + 1, dtype=np.int16).reshape(-1, 1)
PLACES = tuple(product(TARGETS, range(FRAC_BITS_RANGE[0], FRAC_BITS_RANGE[1] + 1)))
"""A batch each: a target and an F."""


def all_of_them(frac_bits: int) -> Controller:
    """A controller that gives every activation of its one input."""
    nodes = tuple(Node((Link(0),), activation=name) for name in ACTIVATION_NAMES)
    return Controller((Input(),), nodes, tuple(Signal(1 + index) for index in range(len(nodes))), frac_bits)


def compare(name: str, frac_bits: int, arguments: np.ndarray = ARGUMENTS) -> int:
    """Evaluate all activations on a target, in each of its styles; gives how many evaluations that were.

    Raises:
        FindingError: where one differs from the reference.
    """
    (ready,) = select([name])
    evaluations = 0
    for style in ready.target.styles:
        with tempfile.TemporaryDirectory(prefix="bitneat-fuzz-", dir=MEMORY) as folder:
            code = CFile.write(generate(all_of_them(frac_bits), "all", style), Path(folder))
            implementations = ready.target.implementations(code, ready.toolchain)
            try:
                answers = implementations[0].run(arguments)
            finally:
                for implementation in implementations:
                    implementation.close()
        _judge(f"F={frac_bits} on {name} ({style})", answers, arguments[:, 0].astype(int), frac_bits)
        evaluations += answers.size
    return evaluations


def _judge(where: str, answers: np.ndarray, arguments: np.ndarray, frac_bits: int) -> None:
    for position, activation in enumerate(ACTIVATION_NAMES):
        expected = table(activation, frac_bits)[arguments + SIGNAL_MAX]
        wrong = np.flatnonzero(answers[:, position] != expected)
        if wrong.size:
            at = wrong[0]
            raise FindingError(
                f"activations: {activation}({arguments[at]}) at {where} is {answers[at, position]}, expected {expected[at]}"
            )


def _run(number: int) -> Batch:
    name, frac_bits = PLACES[number]
    return Batch(compare(name, frac_bits), {"targets": int(frac_bits == FRAC_BITS_RANGE[0])})


TARGET = Target(
    what="all activations at all 65,535 arguments for F = 4 to 12, on every target and in every style, against the reference",
    unit="evaluations",
    under="-",
    tools=lambda: ", ".join(TARGETS),
    run=_run,
)
TOTAL = sum(len(TARGETS[name].styles) for name, _ in PLACES) * ARGUMENTS.size * len(ACTIVATION_NAMES)
"""All there are."""
