# SPDX-License-Identifier: MIT
"""What computes a controller's steps on some target, and the one on this machine: the C file itself, compiled and run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

import bitneat
from bitneat.native.build import shared_library
from bitneat.native.compiler import Compiler
from bitneat.verify.binary import Interface
from bitneat.verify.cfile import CFile, CFileError
from bitneat.verify.child import DECISIONS, READY, REQUEST, RESET, STEPS

if TYPE_CHECKING:
    from bitneat.controller.coding import Int16Array

TIME_LIMIT = 20
"""Seconds that the C under test may take for one request, thousands of times what it needs."""

HOST_FLAGS = ("-std=c99", "-Os", "-ffreestanding", "-fno-stack-protector")
"""Those of the objects that are examined, as far as they decide what the C is."""


class ImplementationError(Exception):
    """The code under test crashed or did not come back; not an input error but a finding."""


class Implementation(Protocol):
    """Anything that claims to compute what the controller computes."""

    title: str
    """What it is, for messages: ``host-table (walker_run)``."""

    def reset(self) -> None:
        """Forget the past."""

    def step(self, inputs: Int16Array) -> Int16Array:
        """One control step: (inputs,) signals to (outputs,) signals."""

    def run(self, inputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
        """Successive steps: (steps, inputs) to (steps, outputs)."""

    def decide(self, outputs: Int16Array) -> int | None:
        """The chosen action for given outputs; None if this code does not choose."""

    def decisions(self, outputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int32]:
        """The chosen actions for many rows of outputs: (steps, outputs) to (steps, 1); only of code that chooses."""

    def restart(self) -> None:
        """Start afresh, after a crash."""

    def close(self) -> None:
        """Let go of processes and files."""


def entries(code: CFile) -> tuple[str, ...]:
    """The functions that compute a step: ``name_step`` and, in the table style, ``name_run``."""
    return ("step",) if code.num_signals is None else ("step", "run")


class HostC:
    """A generated C file, compiled for this machine and run in a process of its own.

    Args:
        code: the file that is handed out; it is compiled where it lies, with its own header.
        entry: ``step`` or, in the table style, ``run``.
        flags: of the compiler.
        compiler: the host's if None.

    Raises:
        CompilerError: if there is no compiler, or it refuses the file.
        CFileError: if the file lacks a function that its header promises.
    """

    def __init__(
        self,
        code: CFile,
        entry: str = "step",
        flags: Sequence[str] = HOST_FLAGS,
        compiler: Compiler | None = None,
        title: str | None = None,
    ) -> None:
        self.title = title or f"{code.path.name} ({code.name}_{entry})"
        self._code = code
        self.binary = shared_library([code.path], name=f"verify-{code.name}", flags=flags, compiler=compiler)
        self._interface = Interface(
            path=str(self.binary),
            name=code.name,
            entry=entry,
            num_inputs=code.num_inputs,
            num_outputs=code.num_outputs,
            num_signals=code.num_signals or 0,
            num_state=code.num_state,
            has_decide=code.has_decide,
        )
        self._start()

    def _start(self) -> None:
        # Not the folder that the user happens to work in, whose files could pass for modules.
        package = str(Path(bitneat.__file__).resolve().parent.parent)
        paths = [package, os.environ.get("PYTHONPATH", "")]
        arguments = [json.dumps(self._interface.to_data()), str(TIME_LIMIT)]
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "bitneat.verify.child", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)},
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, self._answers = self._process.stdin, self._process.stdout
        greeting = self._answers.readline()
        if greeting != READY:
            self.close()
            reason = greeting.decode(errors="replace").strip() or "the process that runs it ended at once"
            raise CFileError(f"{self._code.path}: does not load: {reason}")

    def __enter__(self) -> HostC:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def reset(self) -> None:
        """Forget the past."""
        self._ask(REQUEST.pack(RESET, 0), 0)

    def step(self, inputs: Int16Array) -> Int16Array:
        """One control step."""
        outputs: Int16Array = self.run(inputs.reshape(1, -1))[0]
        return outputs

    def run(self, inputs: npt.NDArray[np.int16]) -> Int16Array:
        """Successive steps in one request: (steps, inputs) to (steps, outputs)."""
        size = 2 * len(inputs) * self._interface.num_outputs
        answer = self._ask(REQUEST.pack(STEPS, len(inputs)) + np.ascontiguousarray(inputs).tobytes(), size)
        return np.frombuffer(answer, dtype=np.int16).reshape(len(inputs), -1)

    def decide(self, outputs: Int16Array) -> int | None:
        """The chosen action for given outputs, by ``name_decide`` where there is one."""
        return int(self.decisions(outputs.reshape(1, -1))[0, 0]) if self._interface.has_decide else None

    def decisions(self, outputs: npt.NDArray[np.int16]) -> npt.NDArray[np.int32]:
        """The chosen actions for many rows of outputs: (steps, outputs) to (steps, 1)."""
        request = REQUEST.pack(DECISIONS, len(outputs)) + np.ascontiguousarray(outputs).tobytes()
        return np.frombuffer(self._ask(request, 4 * len(outputs)), dtype=np.int32).reshape(-1, 1)

    def restart(self) -> None:
        """In a process anew."""
        self.close()
        self._start()

    def close(self) -> None:
        """End the process."""
        for pipe in (self._requests, self._answers):
            with suppress(OSError):  # what was still to be sent goes nowhere
                pipe.close()
        self._process.kill()
        self._process.wait()

    def _ask(self, request: bytes, size: int) -> bytes:
        try:
            self._requests.write(request)
            self._requests.flush()
            answer = self._answers.read(size)
        except BrokenPipeError:
            answer = b""
        if len(answer) != size or (not size and self._process.poll() is not None):
            raise ImplementationError(self._fate())
        return answer

    def _fate(self) -> str:
        status = self._process.wait()
        if status == -signal.SIGALRM:
            return f"did not come back within {TIME_LIMIT} s"
        if status < 0:
            return f"crashed ({signal.Signals(-status).name})"
        return f"its process ended with status {status}"
