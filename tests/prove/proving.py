# SPDX-License-Identifier: MIT
"""Proofs of one function, and controllers with state to prove."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bitneat.champion import Champion
from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.prove.check import PROCESSORS
from bitneat.prove.equivalence import Lemmas
from bitneat.prove.proof import FunctionProof, prove_function
from bitneat.prove.subject import Subject
from bitneat.verify.cfile import CFile
from bitneat.verify.targets.chips import CHIPS
from bitneat.verify.targets.emulated import EmulatedC

CHAMPIONS = Path(__file__).parents[2] / "examples" / "champions"
CHIP = {chip.name: chip for chip in CHIPS}


@contextmanager
def compiled(code: CFile, target: str, level: str = "-Os", entry: str = "step") -> Iterator[EmulatedC]:
    chip = CHIP[target]
    toolchain = chip.toolchain()
    assert toolchain is not None
    emulated = chip.implementation(code, toolchain, entry, optimization=level)
    yield emulated
    emulated.close()


def proof_of(whose: Champion, emulated: EmulatedC, target: str, *, paranoid: bool = False) -> FunctionProof:
    subject = Subject(whose.controller, emulated, PROCESSORS[target], Lemmas(), paranoid=paranoid)
    return prove_function(subject, emulated.image.entry)


def controller_with_state() -> Controller:
    """A sum that grows, a twin of it, and what both were before: no two of them are ever apart."""
    return Controller(
        inputs=(Input(limit=300), Input(limit=32767)),
        nodes=(
            Node((Link(0), Link(2, delay=1)), 0, 0, "identity"),
            Node((Link(0), Link(2, delay=1)), 0, 0, "identity"),
            Node((Link(2, delay=1), Link(3, delay=1, sign=-1), Link(1)), 5, -2, "sin"),
            Node((Link(4, delay=1), Link(1, delay=1, shift=2)), 0, 1, "gauss"),
        ),
        outputs=(Signal(4), Signal(5), Signal(3)),
        frac_bits=8,
    )


def controller_with_rare_values() -> Controller:
    """What it keeps is 0, but for few of the 65,535 inputs or for all: no simulation tells one from the other."""
    return Controller(
        inputs=(Input(limit=32767),),
        nodes=(
            Node((Link(0),), -(1 << 30), 0, "gauss"),
            Node((Link(0), Link(2, delay=1), Link(3, delay=1)), -12345, 7, "gauss"),
            Node((Link(0), Link(3, delay=1)), 6789, 7, "gauss"),
            Node((Link(1, delay=1), Link(2, delay=1), Link(3, delay=1, sign=-1)), 0, 0, "identity"),
        ),
        outputs=(Signal(4),),
        frac_bits=8,
    )
