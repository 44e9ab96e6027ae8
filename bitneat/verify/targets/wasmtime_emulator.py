# SPDX-License-Identifier: MIT
"""WebAssembly in wasmtime. It has no addresses of instructions to compare, so steps are compared by how many they execute."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from bitneat.verify.implementation import ImplementationError
from bitneat.verify.targets.emulated import BLOCK_LIMIT, ByteOrder
from bitneat.verify.targets.image import Image, driver_data
from bitneat.verify.targets.tracing import Trace
from bitneat.verify.wasm import I32_ADD, I32_SUB, read_wasm


@dataclass(frozen=True, slots=True)
class WasmtimeEmulator:
    """wasmtime, with fuel as the limit and the count of instructions."""

    batch: int = 512

    @property
    def byte_order(self) -> ByteOrder:
        """As the specification has it."""
        return "little"

    def link_flags(self, image_names: tuple[str, ...]) -> tuple[str, ...]:
        """Everything that is called or written has to be exported."""
        exports = [f"-Wl,--export={name}" for name in image_names]
        return ("-Wl,--no-entry", *exports)

    def missing(self) -> str | None:
        """The package."""
        return None if find_spec("wasmtime") is not None else "the emulator wasmtime (pip install wasmtime)"

    def load(self, image: Image, *, traced_steps: int = 0) -> WasmtimeMachine:
        """A machine of its own."""
        return WasmtimeMachine(image, traced=traced_steps > 0)

    def faults(self, image: Image, trace: Trace) -> list[tuple[str, Image]]:
        """Additions turned into subtractions, in the functions up to the one that computes a step."""
        del trace
        wasm = read_wasm(image.content)
        last = wasm.exports[image.function] - wasm.first_function
        return [
            (f"i32.sub for i32.add at {one.offset:#x}", image.overwritten(one.offset, bytes([I32_SUB])))
            for opcodes in wasm.functions[: last + 1]
            for one in opcodes
            if one.code == I32_ADD
        ]


class WasmtimeMachine:
    """A module in wasmtime.

    To be traced, the function that computes a step is called by itself for each, so that nothing else is counted.
    """

    def __init__(self, image: Image, *, traced: bool) -> None:
        self._wasmtime: Any = import_module("wasmtime")
        self._image, self._traced = image, traced
        config = self._wasmtime.Config()
        config.consume_fuel = True
        # Bounds are checked by instructions: a handler of SIGSEGV that something else in the process replaces would let a
        # stray access kill the process.
        config.signals_based_traps = False
        engine = self._wasmtime.Engine(config)
        self._store: Any = self._wasmtime.Store(engine)
        self._instance = self._wasmtime.Instance(self._store, self._wasmtime.Module(engine, image.content), [])
        self._exports: Any = self._instance.exports(self._store)
        self._memory = self._exports["memory"]
        self._counts: list[int] = []

    def call(self, function: str) -> None:
        """Run one of the driver's functions."""
        if self._traced and function == "bitneat_steps":
            self._steps_one_by_one()
        else:
            self._call(function, ())

    def _call(self, function: str, arguments: tuple[int, ...]) -> int:
        """The instructions that it took."""
        limit = BLOCK_LIMIT * self._image.batch
        self._store.set_fuel(limit)
        try:
            self._exports[function](self._store, *arguments)
        except (self._wasmtime.Trap, self._wasmtime.WasmtimeError) as error:
            if "fuel" in str(error):
                raise ImplementationError(f"did not come back within {limit} instructions") from error
            raise ImplementationError(f"crashed ({str(error).strip().splitlines()[-1].strip()})") from error
        return limit - int(self._store.get_fuel())

    def _steps_one_by_one(self) -> None:
        code = self._image.code
        count = int.from_bytes(self.read("bitneat_count", 2), "little")
        state = (self._address("bitneat_state"),) if code.num_state else ()
        names = ("bitneat_signals",) if self._image.entry == "run" else ("bitneat_observation", "bitneat_action")
        arguments = (*state, *(self._address(name) for name in names))
        for step in range(count):
            row = self._read(self._address("bitneat_inputs") + 2 * step * code.num_inputs, 2 * code.num_inputs)
            self.write(names[0], row)
            self._counts.append(self._call(self._image.function, arguments))

    def write(self, symbol: str, content: bytes) -> None:
        """To the linear memory."""
        self._memory.write(self._store, content, self._address(symbol))

    def read(self, symbol: str, size: int) -> bytes:
        """From the linear memory."""
        return self._read(self._address(symbol), size)

    def trace(self) -> Trace:
        """The counts of all steps."""
        counts = np.array(self._counts, dtype=np.uint64)
        return Trace(
            code=counts,
            data=np.zeros_like(counts),
            instructions=counts,
            cycles=None,
            path=(),
            stack=None,
            addresses=False,
        )

    def close(self) -> None:
        """Let go of it."""
        del self._instance, self._exports, self._memory
        self._store.close()

    def _read(self, address: int, size: int) -> bytes:
        return bytes(self._memory.read(self._store, address, address + size))

    def _address(self, symbol: str) -> int:
        return int(self._addresses[symbol])

    @cached_property
    def _addresses(self) -> dict[str, int]:
        found = {}
        for name in driver_data(self._image.code, self._image.entry):
            found[name] = self._exports[name].value(self._store)
        return found
