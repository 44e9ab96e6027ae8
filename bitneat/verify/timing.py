# SPDX-License-Identifier: MIT
"""What tracing a target's code showed: whether its timing depends on data, its instructions, its cycles and its stack."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.verify.cfile import CFile
from bitneat.verify.targets.base import Target
from bitneat.verify.targets.image import Image
from bitneat.verify.targets.tracing import Trace, span


@dataclass(frozen=True, slots=True)
class EntryTiming:
    """One function. ``cycles`` is what every step takes, None where none are claimed or the trace depends on data."""

    instructions: tuple[int, int]
    cycles: int | None
    stack: int | None
    same_code: bool
    same_data: bool
    fingerprint: str
    cycles_source: str | None
    addresses: bool
    """Whether addresses were compared, and not only how many instructions there were."""

    @property
    def independent(self) -> bool:
        """Whether the same addresses were executed, and the same data addresses touched, in every step."""
        return self.same_code and self.same_data

    @property
    def claim(self) -> str:
        """What may be said of its timing."""
        if not self.independent:
            return "depends on data"
        if not self.addresses:
            return "the same number of instructions in every step"
        if self.cycles is None:
            return "data-independent trace"
        return f"WCET = BCET = {self.cycles} cycles ({self.cycles_source})"

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {
            "instructions_per_step": {"min": self.instructions[0], "max": self.instructions[1]},
            "cycles_per_step": self.cycles,
            "stack_bytes": self.stack,
            "same_addresses": self.same_code if self.addresses else None,
            "same_data_addresses": self.same_data if self.addresses else None,
            "fingerprint": self.fingerprint if self.addresses else None,
            "timing": self.claim,
        }


@dataclass(frozen=True, slots=True)
class Timing:
    """The functions of one file on one target, by ``step`` and ``run``, and how many inputs were traced."""

    entries: Mapping[str, EntryTiming]
    inputs: int

    @property
    def data_independent(self) -> bool | None:
        """Whether no trace depends on data; None where only counts were compared, and agree."""
        entries = self.entries.values()
        if not all(entry.independent for entry in entries):
            return False
        return True if all(entry.addresses for entry in entries) else None

    @property
    def step(self) -> EntryTiming:
        """That of ``name_step``."""
        return self.entries["step"]

    @property
    def cycles(self) -> int | None:
        """Of ``name_step``."""
        return self.step.cycles

    @property
    def stack(self) -> int | None:
        """Of ``name_step``."""
        return self.step.stack

    @property
    def instructions_per_step(self) -> dict[str, int]:
        """Of ``name_step``."""
        return {"min": self.step.instructions[0], "max": self.step.instructions[1]}

    def to_data(self) -> dict[str, Any]:
        """The entry ``trace`` of a target in the report."""
        return {
            "inputs": self.inputs,
            "data_independent": self.data_independent,
            "entries": {name: entry.to_data() for name, entry in self.entries.items()},
        }


def entry_timing(target: Target, image: Image, trace: Trace) -> EntryTiming:
    """What a trace says of the function that it is of."""
    cycles = None
    if trace.same_code and target.cycles_source is not None:
        if trace.cycles is None:
            cycles = target.cycles(image.controller, image.code_range.start, trace.path)
        else:
            least, most = span(trace.cycles)
            cycles = least if least == most else None
    return EntryTiming(
        instructions=span(trace.instructions),
        cycles=cycles,
        stack=trace.stack,
        same_code=trace.same_code,
        same_data=trace.same_data,
        fingerprint=trace.fingerprint,
        cycles_source=target.cycles_source,
        addresses=trace.addresses,
    )


def dependence(trace: Trace, vectors: npt.NDArray[np.int16]) -> list[str]:
    """How the timing depends on data, a sentence each."""
    step = trace.first_difference
    inputs = ", ".join(map(str, vectors[step].tolist() if step is not None else ()))
    where = f"with ({inputs}) it is otherwise than with the first"
    found = []
    if not trace.same_code:
        what = "the addresses executed depend" if trace.addresses else "the number of instructions executed depends"
        found.append(f"{what} on the inputs: {where}")
    if not trace.same_data:
        found.append(f"the addresses read and written depend on the inputs: {where}")
    if trace.same_code and trace.cycles is not None and len(set(trace.cycles.tolist())) > 1:
        found.append("the cycles depend on the inputs, although the addresses do not")
    return found


def excess(target: Target, code: CFile, flash: int, ram: int, stack: int | None) -> str | None:
    """What does not fit into a target's chip; None if all does, or it is no particular chip.

    The caller's arrays count, and the stack as far as it is known: the table style keeps its signals there.
    """
    if target.flash is not None and flash > target.flash:
        return f"needs {flash} bytes of flash, the {target.chip} has {target.flash}"
    arrays = 2 * (code.num_inputs + code.num_outputs)
    known = stack if stack is not None else 2 * (code.num_signals or 0)
    needed = ram + arrays + known
    if target.ram is not None and needed > target.ram:
        return (
            f"needs {needed} bytes of RAM (state {ram}, inputs and outputs {arrays}, stack {known}),"
            f" the {target.chip} has {target.ram}"
        )
    return None
