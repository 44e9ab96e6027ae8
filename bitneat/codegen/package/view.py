# SPDX-License-Identifier: MIT
"""What the templates of a package print: everything about meaning is decided here."""

from __future__ import annotations

from dataclasses import dataclass

from bitneat.codegen.comment import comment_text
from bitneat.codegen.generate import GeneratedC, code_bytes
from bitneat.codegen.sensor.emit import SensorFiles
from bitneat.controller import Action, Controller, DiscreteAction
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.native.compiler import CompilerError, zig_compiler
from bitneat.version import __version__


class PackageError(BitneatError):
    """No package can be made with these settings, or the folder is not one to write it to."""


def flash_bytes(code: GeneratedC) -> int:
    """Bytes of Cortex-M0 flash that a README states: ziglang's clang at -Os, so that every machine states the same.

    Raises:
        PackageError: if ziglang is missing.
    """
    if zig_compiler("thumb-freestanding-eabi") is None:
        raise PackageError(
            "codegen --package: its README states sizes, which needs ziglang's clang; pip install ziglang"
        )
    try:
        return code_bytes(code)
    except CompilerError as error:
        raise PackageError(f"codegen --package: cannot measure the code: {error}") from error


@dataclass(frozen=True)
class Package:
    """A library: generated code, its self-test, and what an ecosystem wants to know.

    ``environment_id`` and ``origin`` may be foreign text; the templates get them made safe. ``flash`` is that of
    `flash_bytes`.
    """

    kind: str
    code: GeneratedC
    selftest: str
    controller: Controller
    action: Action | None
    environment_id: str
    guard: bool
    flash: int
    sensors: SensorFiles | None = None

    @property
    def name(self) -> str:
        """The prefix of every C name, and the library's own."""
        return self.code.name

    @property
    def macro(self) -> str:
        """The prefix of macros."""
        return self.name.upper()

    @property
    def slug(self) -> str:
        """The name as PlatformIO wants it: lower case, digits and dashes."""
        return self.name.lower().replace("_", "-")

    @property
    def version(self) -> str:
        """The library's version: that of the bitneat that wrote it, three numbers."""
        return __version__

    @property
    def sha256(self) -> str:
        """The controller's fingerprint."""
        return self.controller.sha256

    @property
    def environment(self) -> str:
        """Where it was evolved, in characters that mean nothing in any of the formats; empty if unknown."""
        return comment_text(self.environment_id)

    @property
    def description(self) -> str:
        """One sentence for a catalogue."""
        where = f" evolved on {self.environment}" if self.environment else ""
        return (
            f"A controller{where}: {self.num_inputs} inputs, {self.num_outputs} outputs, integers only,"
            " no multiplication, no heap."
        )

    @property
    def num_inputs(self) -> int:
        """Inputs of a step."""
        return len(self.controller.inputs)

    @property
    def num_outputs(self) -> int:
        """Outputs of a step."""
        return len(self.controller.outputs)

    @property
    def num_nodes(self) -> int:
        """Nodes of the canonical controller."""
        return len(self.controller.canonical.nodes)

    @property
    def num_links(self) -> int:
        """Links of the canonical controller."""
        return self.controller.canonical.num_links

    @property
    def packed_bytes(self) -> int:
        """Length of the smallest blob."""
        return len(pack(self.controller))

    @property
    def has_state(self) -> bool:
        """Whether a step takes a state."""
        return self.controller.canonical.is_recurrent

    @property
    def decides(self) -> bool:
        """Whether the header offers a choice among discrete actions."""
        return isinstance(self.action, DiscreteAction)

    @property
    def state_argument(self) -> str:
        """The first argument of a step with state."""
        return "&state, " if self.has_state else ""

    @property
    def headers(self) -> tuple[str, ...]:
        """What an application includes."""
        return (f"{self.name}.h", *((f"{self.name}_sensors.h",) if self.sensors else ()))

    @property
    def sources(self) -> tuple[str, ...]:
        """What is compiled into the library."""
        return (f"{self.name}.c", *((f"{self.name}_sensors.c",) if self.sensors else ()))

    @property
    def selftests(self) -> tuple[str, ...]:
        """The known-answer tests, a source each, without the suffix."""
        return (f"{self.name}_selftest", *((f"{self.name}_sensors_selftest",) if self.sensors else ()))
