# SPDX-License-Identifier: MIT
"""A compiled C file in this process, called through cffi. It is foreign code: only `bitneat.verify.child` loads one.

This module and the child import neither numpy nor anything else that takes long to start.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import cffi

POISON = b"\x00\x80"
"""-32768 in the byte order of every machine that verify runs C on: no signal, so a value that was never written shows."""

_MARGIN = 64
"""Spare elements behind each array, so that a step that writes a little too far spoils nothing but itself."""


@dataclass(frozen=True)
class Interface:
    """What a caller must know of a compiled controller."""

    path: str
    name: str
    entry: str
    """``step``, or ``run`` for the one in place."""
    num_inputs: int
    num_outputs: int
    num_signals: int
    num_state: int | None
    has_decide: bool

    def to_data(self) -> dict[str, Any]:
        """Plain data for the constructor."""
        return asdict(self)


class Binary:
    """One compiled controller and its state; values go in and out as bytes of native int16.

    Raises:
        OSError: if the library cannot be loaded.
        AttributeError: if it lacks a function.
    """

    def __init__(self, interface: Interface) -> None:
        self.interface = interface
        name = interface.name
        state = f"struct {name}_state *state, " if interface.num_state is not None else ""
        ffi = cffi.FFI()
        ffi.cdef(
            f"struct {name}_state;"
            f"void {name}_reset(struct {name}_state *state);"
            f"void {name}_step({state}const int16_t *observation, int16_t *action);"
            f"void {name}_run({state}int16_t *signals);"
            f"int32_t {name}_decide(const int16_t *action);"
        )
        self._ffi = ffi
        self._library = ffi.dlopen(interface.path)
        self._entry = getattr(self._library, f"{name}_{interface.entry}")
        self._reset = getattr(self._library, f"{name}_reset") if interface.num_state is not None else None
        self._decide = getattr(self._library, f"{name}_decide") if interface.has_decide else None
        self._observation = ffi.new("int16_t[]", interface.num_inputs + _MARGIN)
        self._action = ffi.new("int16_t[]", interface.num_outputs + _MARGIN)
        self._signals = ffi.new("int16_t[]", interface.num_signals + _MARGIN)
        self._state = ffi.new("int16_t[]", (interface.num_state or 0) + _MARGIN)
        self._state_argument = () if interface.num_state is None else (ffi.cast(f"struct {name}_state *", self._state),)

    def reset(self) -> None:
        """Forget the past."""
        if self._reset is not None:
            self._poison(self._state)
            self._reset(*self._state_argument)

    def step(self, inputs: bytes) -> bytes:
        """One step: the bytes of the inputs to those of the outputs."""
        size = 2 * self.interface.num_outputs
        if self.interface.entry == "run":
            self._poison(self._signals)
            self._ffi.memmove(self._signals, inputs, len(inputs))
            self._entry(*self._state_argument, self._signals)
            first = self.interface.num_signals - self.interface.num_outputs
            return bytes(self._ffi.buffer(self._signals + first, size))
        self._poison(self._action)
        self._ffi.memmove(self._observation, inputs, len(inputs))
        self._entry(*self._state_argument, self._observation, self._action)
        return bytes(self._ffi.buffer(self._action, size))

    def decide(self, outputs: bytes) -> int:
        """The chosen action for the bytes of the outputs."""
        assert self._decide is not None
        self._ffi.memmove(self._action, outputs, len(outputs))
        return int(self._decide(self._action))

    def _poison(self, array: Any) -> None:
        size = self._ffi.sizeof(array)
        self._ffi.memmove(array, POISON * (size // 2), size)
