# SPDX-License-Identifier: MIT
"""The controller's C as a WebAssembly module that a browser runs as it is."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bitneat.codegen import GeneratedC
from bitneat.errors import BitneatError
from bitneat.verify.cfile import CFile
from bitneat.verify.targets import TARGETS
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.image import build_image, driver_data
from bitneat.verify.wasm import MAGIC

_CUSTOM = 0


@dataclass(frozen=True)
class Module:
    """A module without imports that exports ``function``, the driver's ``bitneat_reset``, its arrays and ``memory``.

    ``entry`` is ``step``, which reads ``bitneat_observation`` and writes ``bitneat_action``, or ``run``, which works in
    ``bitneat_signals``. ``stateful`` says whether ``bitneat_state`` is the first argument.
    """

    content: bytes
    compiler: str
    style: str
    function: str
    entry: str
    stateful: bool

    def to_data(self) -> dict[str, Any]:
        """As the page reads it."""
        return {
            "wasm": base64.b64encode(self.content).decode("ascii"),
            "function": self.function,
            "entry": self.entry,
            "stateful": self.stateful,
        }


def compile_module(code: GeneratedC, entry: str) -> Module:
    """Compile generated C as the target ``wasm32`` of verify does, by ziglang's clang, and link it.

    Raises:
        BitneatError: if ziglang is missing or refuses the code.
    """
    target = TARGETS["wasm32"]
    assert isinstance(target, Chip)
    toolchain = target.toolchain()
    if toolchain is None:
        raise BitneatError(f"report: compiling for the browser needs {target.needs}")
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        file = CFile.write(code, Path(folder))
        names = (f"{code.name}_{entry}", *driver_data(file, entry))
        # A batch of one: the page calls the function itself, a step at a time.
        image = build_image(file, toolchain, entry, batch=1, link_flags=target.emulator.link_flags(names))
        return Module(
            content=without_custom_sections(image.content),
            compiler=toolchain.compiler.title,
            style=code.style,
            function=image.function,
            entry=entry,
            stateful=bool(file.num_state),
        )


def without_custom_sections(content: bytes) -> bytes:
    """The module without names and notes of its producers, which say where and by what it was built and change nothing."""
    return MAGIC + b"".join(section for kind, section in _sections(content) if kind != _CUSTOM)


def _sections(content: bytes) -> Iterator[tuple[int, bytes]]:
    at = len(MAGIC)
    while at < len(content):
        start, kind = at, content[at]
        at, size, shift = at + 1, 0, 0
        while True:
            byte = content[at]
            size |= (byte & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if byte < 0x80:
                break
        at += size
        yield kind, content[start:at]
