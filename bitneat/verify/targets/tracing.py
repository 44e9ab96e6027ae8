# SPDX-License-Identifier: MIT
"""What the processor did in each step: the addresses that it executed and touched, as fingerprints, and the counts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt

from bitneat.native.build import shared_library

SOURCES = Path(__file__).parent / "csrc"

TRACE_DECLARATIONS = """
struct bitneat_step { uint64_t code, data, instructions, cycles; };
struct bitneat_trace {
    uint64_t code_begin, code_end, entry, blocks_left, block_limit;
    uint32_t active, runaway;
    struct bitneat_step now;
    struct bitneat_step *steps;
    uint64_t num_steps, max_steps;
    uint64_t *path;
    uint64_t path_length, path_capacity, stack_begin, stack_end, entry_sp, lowest;
    int (*stop)(void *);
    int (*read_register)(void *, int, void *);
    int sp_register;
};
"""
"""The struct of csrc/trace.h, for cffi."""

_PATH_CAPACITY = 1 << 20


@dataclass(frozen=True, slots=True)
class Trace:
    """What tracing many steps showed.

    ``path`` has the addresses executed in the first step; ``stack`` is the deepest the stack was in it, in bytes, with the
    return address where the call puts one there. Both hold for every step if `same_code` does. ``addresses`` is False where
    the emulator sees none, and steps are compared by how many instructions they execute.
    """

    code: npt.NDArray[np.uint64]
    data: npt.NDArray[np.uint64]
    instructions: npt.NDArray[np.uint64]
    cycles: npt.NDArray[np.uint64] | None
    path: tuple[int, ...]
    stack: int | None
    addresses: bool = True

    @property
    def steps(self) -> int:
        """How many steps were traced."""
        return len(self.code)

    @property
    def same_code(self) -> bool:
        """Whether all steps executed the same addresses in the same order."""
        return self._first_other(self.code) is None

    @property
    def same_data(self) -> bool:
        """Whether all steps touched the same data addresses in the same order."""
        return self._first_other(self.data) is None

    @property
    def first_difference(self) -> int | None:
        """The first step that differs from step 0 in either."""
        found = [step for step in (self._first_other(self.code), self._first_other(self.data)) if step is not None]
        return min(found, default=None)

    @property
    def fingerprint(self) -> str:
        """That of the first step, in hexadecimal: code, then data."""
        return f"{int(self.code[0]):016x}{int(self.data[0]):016x}"

    @staticmethod
    def _first_other(values: npt.NDArray[np.uint64]) -> int | None:
        others = np.flatnonzero(values != values[0])
        return int(others[0]) if len(others) else None


def span(values: npt.NDArray[np.uint64]) -> tuple[int, int]:
    """The smallest and the largest."""
    return int(values.min()), int(values.max())


@cache
def trace_library() -> Path:
    """The compiled hooks."""
    return shared_library([SOURCES / "trace.c"], name="trace", flags=("-std=c99", "-O2"))


class Recorder:
    """A `struct bitneat_trace` with the arrays that it points to.

    Args:
        ffi: that has `TRACE_DECLARATIONS`.
        code: where the code under test lies.
        stack: where its stack lies.
        max_steps: how many steps there will be.
    """

    def __init__(self, ffi: cffi.FFI, code: range, stack: range, max_steps: int) -> None:
        self._steps = ffi.new("struct bitneat_step[]", max(max_steps, 1))
        self._path = ffi.new("uint64_t[]", _PATH_CAPACITY if max_steps else 1)
        self._ffi = ffi
        self.struct: Any = ffi.new("struct bitneat_trace *")
        self.struct.code_begin, self.struct.code_end = code.start, code.stop
        self.struct.stack_begin, self.struct.stack_end = stack.start, stack.stop
        self.struct.steps, self.struct.max_steps = self._steps, max_steps
        self.struct.path, self.struct.path_capacity = self._path, _PATH_CAPACITY if max_steps else 0

    def result(self, *, return_bytes: int, has_cycles: bool) -> Trace:
        """What was recorded; ``return_bytes`` is what a call pushes."""
        struct = self.struct
        count = min(struct.num_steps, struct.max_steps)
        words = np.frombuffer(self._ffi.buffer(self._steps, 32 * count), dtype=np.uint64).reshape(count, 4).copy()
        length = min(struct.path_length, struct.path_capacity)
        return Trace(
            code=words[:, 0],
            data=words[:, 1],
            instructions=words[:, 2],
            cycles=words[:, 3] if has_cycles else None,
            path=tuple(self._ffi.unpack(self._path, length)),
            stack=int(struct.entry_sp - struct.lowest) + return_bytes,
        )
