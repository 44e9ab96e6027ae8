# SPDX-License-Identifier: MIT
"""The C runtime in this process, through cffi's ABI mode: controllers run from their packed blobs.

`RuntimeController` is one controller behind the two methods that every implementation has, ``reset`` and ``step``; `Population`
steps many controllers in one call. Neither checks that an input is within its limit: that is the contract of the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import cffi
import numpy as np
import numpy.typing as npt

from bitneat.controller import Controller
from bitneat.controller.packing import PackedFormatError, pack
from bitneat.errors import BitneatError
from bitneat.native.build import shared_library
from bitneat.native.data import runtime_dir

if TYPE_CHECKING:
    from bitneat.controller.coding import Int16Array

RUNTIME_ENCODING = "bytes"
"""The encoding that the interpreter reads fastest; how a blob is encoded changes no output."""

MAX_LANES = 64
"""BN_MAX_LANES of the C: how many steps of a controller without state are taken at once."""

_FLAGS = ("-std=c99", "-O3", "-march=native")
_ERRORS = {
    -1: "ends too early or has bytes left over",
    -2: "has a version, encoding or feature that the runtime does not have",
    -3: "has a count, index or value out of range",
    -4: "has a node whose sum could leave 32 bits",
    -5: "has lists out of order or padding that is not zero",
}
_CDEF = """
size_t bn_controller_size(void);
int bn_open(void *c, const uint8_t *blob, size_t size);
int bn_validate(const void *c, int16_t *workspace);
void bn_reset(const void *c, int16_t *state);
void bn_step(const void *c, int16_t *state, int16_t *workspace, const int16_t *observation, int16_t *action);
struct bn_job {
    const void *controller;
    int16_t *state;
    const int16_t *observations;
    int16_t *actions;
    size_t steps;
};
void bn_population_step(const struct bn_job *jobs, size_t num_jobs, int16_t *workspace);
struct bn_shape {
    uint16_t num_inputs;
    uint16_t num_outputs;
    uint16_t num_state;
    uint16_t workspace_length;
    uint8_t frac_bits;
};
"""


@cache
def _ffi() -> Any:
    ffi = cffi.FFI()
    ffi.cdef(_CDEF)
    return ffi


@cache
def _library() -> Any:
    """The runtime, compiled on first use."""
    folder = runtime_dir()
    sources = [folder / "src" / name for name in ("interpreter.c", "open.c", "population.c", "reader.c", "validate.c")]
    path = shared_library(
        sources, name="bitneat-runtime", include_dirs=[folder / "include", folder / "src"], flags=_FLAGS
    )
    return _ffi().dlopen(str(path))


def pack_for_runtime(controller: Controller) -> bytes:
    """The blob that the interpreter reads fastest."""
    return pack(controller, RUNTIME_ENCODING)


class OpenBlob:
    """A blob opened by the C runtime; it keeps the bytes alive for as long as they are in use.

    Raises:
        PackedFormatError: if the runtime refuses the blob: `validate` checks all of it, opening alone only its header.
    """

    def __init__(self, data: bytes, *, validate: bool = True) -> None:
        ffi, library = _ffi(), _library()
        self._data = ffi.from_buffer("uint8_t[]", data)
        self._memory = ffi.new("uint64_t[]", library.bn_controller_size() // 8 + 1)
        self.pointer = ffi.cast("void *", self._memory)
        _check(library.bn_open(self.pointer, self._data, len(data)))
        shape = ffi.cast("struct bn_shape *", self._memory)
        self.num_inputs: int = shape.num_inputs
        self.num_outputs: int = shape.num_outputs
        self.num_state: int = shape.num_state
        self.workspace_length: int = shape.workspace_length
        if validate:
            _check(library.bn_validate(self.pointer, ffi.new("int16_t[]", self.workspace_length)))


def _check(status: int) -> None:
    if status:
        raise PackedFormatError(f"blob: {_ERRORS[status]}")


class RuntimeController:
    """One controller, run by the C interpreter.

    Args:
        controller: any valid controller.
        encoding: one of the packed form's encodings; the outputs do not depend on it.
    """

    def __init__(self, controller: Controller, encoding: str = RUNTIME_ENCODING) -> None:
        ffi = _ffi()
        self.blob = OpenBlob(pack(controller, encoding))
        self._state = ffi.new("int16_t[]", max(self.blob.num_state, 1))
        self._workspace = ffi.new("int16_t[]", self.blob.workspace_length)
        self._observation = np.zeros(self.blob.num_inputs, np.int16)
        self._action = np.zeros(self.blob.num_outputs, np.int16)
        self._step = _library().bn_step
        self._arguments = (
            self.blob.pointer,
            self._state,
            self._workspace,
            ffi.from_buffer("int16_t[]", self._observation),
            ffi.from_buffer("int16_t[]", self._action),
        )

    def reset(self) -> None:
        """Forget the past: every delayed link reads 0 next."""
        _library().bn_reset(self.blob.pointer, self._state)

    def step(self, inputs: npt.ArrayLike) -> Int16Array:
        """One control step: input signals of shape (inputs,), each within its limit, to a new array of output signals."""
        self._observation[:] = inputs
        self._step(*self._arguments)
        return self._action.copy()


class Population:
    """Many controllers, stepped in one call into C, each with its own state.

    Args:
        controllers: at least one; they may differ in everything.
        encoding: one of the packed form's encodings.
    """

    def __init__(self, controllers: Sequence[Controller], encoding: str = RUNTIME_ENCODING) -> None:
        if not controllers:
            raise BitneatError("population: expected at least one controller")
        ffi = _ffi()
        self._blobs = [OpenBlob(pack(controller, encoding)) for controller in controllers]
        self._states = [ffi.new("int16_t[]", max(blob.num_state, 1)) for blob in self._blobs]
        self._workspace = ffi.new("int16_t[]", MAX_LANES * max(blob.workspace_length for blob in self._blobs))
        self._jobs = ffi.new("struct bn_job[]", len(self._blobs))
        for job, blob, state in zip(self._jobs, self._blobs, self._states, strict=True):
            job.controller = blob.pointer
            job.state = state

    def reset(self) -> None:
        """Forget the past of every controller."""
        for blob, state in zip(self._blobs, self._states, strict=True):
            _library().bn_reset(blob.pointer, state)

    def run(self, observations: Sequence[npt.NDArray[np.int16]]) -> list[Int16Array]:
        """Successive steps of each controller, in one call.

        Args:
            observations: for each controller an array (steps, inputs) of input signals, each within its limit; the number of
                steps may differ.

        Returns:
            For each controller an array (steps, outputs).
        """
        ffi = _ffi()
        if len(observations) != len(self._blobs):
            raise BitneatError(f"population: expected {len(self._blobs)} arrays of inputs, got {len(observations)}")
        inputs = [np.ascontiguousarray(array, np.int16) for array in observations]
        outputs = []
        for job, blob, array in zip(self._jobs, self._blobs, inputs, strict=True):
            if array.ndim != 2 or array.shape[1] != blob.num_inputs:
                raise BitneatError(
                    f"population: expected inputs of shape (steps, {blob.num_inputs}), got {array.shape}"
                )
            out = np.zeros((array.shape[0], blob.num_outputs), np.int16)
            outputs.append(out)
            job.observations = ffi.from_buffer("int16_t[]", array)
            job.actions = ffi.from_buffer("int16_t[]", out)
            job.steps = array.shape[0]
        _library().bn_population_step(self._jobs, len(self._blobs), self._workspace)
        return outputs
