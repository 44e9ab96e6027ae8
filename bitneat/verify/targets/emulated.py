# SPDX-License-Identifier: MIT
"""A controller's C on an emulated processor: what every emulator has to offer, and the implementation that verify compares."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
import numpy.typing as npt

from bitneat.verify.targets.image import Image
from bitneat.verify.targets.tracing import Trace

if TYPE_CHECKING:
    from bitneat.controller.coding import Int16Array

ByteOrder = Literal["little", "big"]

BLOCK_LIMIT = 5_000_000
"""Basic blocks, or instructions where those are counted, that one step may execute: a thousand times what a large one needs."""


class Machine(Protocol):
    """An emulated processor with an image in its memory."""

    def call(self, function: str) -> None:
        """Run one of the driver's functions until it has reached ``bitneat_halt``.

        Raises:
            ImplementationError: if it does not get there.
        """

    def write(self, symbol: str, content: bytes) -> None:
        """Put bytes where a name of the driver stands for."""

    def read(self, symbol: str, size: int) -> bytes:
        """Get bytes from where a name of the driver stands for."""

    def trace(self) -> Trace:
        """What was recorded since it was loaded; only of a machine that was loaded to be traced."""

    def close(self) -> None:
        """Let go of it."""


class Emulator(Protocol):
    """A way to run images of some kind."""

    @property
    def batch(self) -> int:
        """How many steps an image is to hold."""

    @property
    def byte_order(self) -> ByteOrder:
        """Of the processor."""

    def link_flags(self, image_names: tuple[str, ...]) -> tuple[str, ...]:
        """How images are linked for it, so that functions and data of these names can be found."""

    def missing(self) -> str | None:
        """What to install for it; None if it is there."""

    def load(self, image: Image, *, traced_steps: int = 0) -> Machine:
        """A fresh machine with an image; ``traced_steps`` is how many steps it can record, none unless asked for."""

    def faults(self, image: Image, trace: Trace) -> list[tuple[str, Image]]:
        """Copies of an image with one executed addition or subtraction taken out, each with what was changed."""


class EmulatedC:
    """A generated C file as an image in an emulator.

    Args:
        image: what is run.
        emulator: where.
        title: for messages.
    """

    def __init__(self, image: Image, emulator: Emulator, title: str) -> None:
        self.title = title
        self.image = image
        self._emulator = emulator
        self._type = np.dtype("<i2" if emulator.byte_order == "little" else ">i2")
        self._choice_type = np.dtype("<i4" if emulator.byte_order == "little" else ">i4")
        self._machine = emulator.load(image)

    def restart(self) -> None:
        """Start afresh, after a crash."""
        self._machine.close()
        self._machine = self._emulator.load(self.image)

    def reset(self) -> None:
        """Forget the past."""
        if self.image.code.num_state:
            self._machine.call("bitneat_reset")

    def step(self, inputs: Int16Array) -> Int16Array:
        """One control step."""
        outputs: Int16Array = self.run(inputs.reshape(1, -1))[0]
        return outputs

    def step_from(self, state: Int16Array, inputs: Int16Array) -> Int16Array:
        """One control step from a given content of the C's state, which is empty where it has none."""
        if self.image.code.num_state:
            self._machine.write("bitneat_state", state.astype(self._type).tobytes())
        return self.step(inputs)

    def run(self, inputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
        """Successive steps: (steps, inputs) to (steps, outputs)."""
        return self._run(self._machine, inputs)

    def _run(self, machine: Machine, inputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
        width, answers = self.image.code.num_outputs, []
        for start in range(0, len(inputs), self.image.batch):
            rows = inputs[start : start + self.image.batch]
            machine.write("bitneat_inputs", rows.astype(self._type).tobytes())
            self._write_count(machine, len(rows))
            machine.call("bitneat_steps")
            answer = machine.read("bitneat_outputs", 2 * width * len(rows))
            answers.append(np.frombuffer(answer, self._type).reshape(len(rows), width))
        return np.concatenate(answers).astype(np.int16)

    def decide(self, outputs: Int16Array) -> int | None:
        """The chosen action for given outputs, by ``name_decide`` where there is one."""
        return int(self.decisions(outputs.reshape(1, -1))[0, 0]) if self.image.code.has_decide else None

    def decisions(self, outputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int32]:
        """The chosen actions for many rows of outputs: (steps, outputs) to (steps, 1)."""
        answers = []
        for start in range(0, len(outputs), self.image.batch):
            rows = outputs[start : start + self.image.batch]
            self._machine.write("bitneat_outputs", rows.astype(self._type).tobytes())
            self._write_count(self._machine, len(rows))
            self._machine.call("bitneat_decisions")
            answer = self._machine.read("bitneat_choices", 4 * len(rows))
            answers.append(np.frombuffer(answer, self._choice_type))
        return np.concatenate(answers).astype(np.int32).reshape(-1, 1)

    def trace(self, inputs: npt.NDArray[np.int16], sequence: int) -> Trace:
        """Take steps on a machine of their own, watched instruction by instruction.

        Args:
            inputs: (steps, inputs).
            sequence: how many of them follow each other from reset.

        Raises:
            ImplementationError: if the code crashes or does not come back.
        """
        machine = self._emulator.load(self.image, traced_steps=len(inputs))
        try:
            for start in range(0, len(inputs), sequence):
                if self.image.code.num_state:
                    machine.call("bitneat_reset")
                self._run(machine, inputs[start : start + sequence])
            return machine.trace()
        finally:
            machine.close()

    def faults(self, inputs: npt.NDArray[np.int16]) -> list[tuple[str, EmulatedC]]:
        """This implementation with one instruction changed, as a wrong compiler might have, in all the ways known here.

        Args:
            inputs: (steps, inputs), whose first step says which instructions are executed.
        """
        trace = self.trace(inputs[:1], 1)
        return [
            (what, EmulatedC(image, self._emulator, f"{self.title}, {what}"))
            for what, image in self._emulator.faults(self.image, trace)
        ]

    def close(self) -> None:
        """Let go of the machine."""
        self._machine.close()

    def _write_count(self, machine: Machine, count: int) -> None:
        machine.write("bitneat_count", count.to_bytes(2, self._emulator.byte_order))
