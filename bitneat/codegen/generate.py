# SPDX-License-Identifier: MIT
"""From a controller to the text of its C files. Nothing here writes a file that stays; choosing by size compiles, in passing."""

from __future__ import annotations

import random
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from bitneat.codegen.comment import comment_text
from bitneat.codegen.names import check_file_stem, check_name
from bitneat.codegen.templating import environment
from bitneat.codegen.view import Interface, table_view, unrolled_view
from bitneat.controller import Action, BoxAction, Constant, Controller, Reference
from bitneat.controller.packing import ENCODINGS, PackedFormatError, pack_blob
from bitneat.controller.passes import optimize, order_depth_first
from bitneat.errors import BitneatError
from bitneat.files import write_atomic
from bitneat.native.build import compile_object
from bitneat.native.compiler import Compiler, CompilerError, zig_compiler
from bitneat.native.elf import measure
from bitneat.version import __version__

Style = Literal["unrolled", "table"]
STYLES: tuple[Style, ...] = ("unrolled", "table")

SELFTEST_STEPS = 64
SELFTEST_SEED = 1


class CodegenError(BitneatError):
    """No C can be generated for this controller and these settings."""


@dataclass(frozen=True, slots=True)
class GeneratedC:
    """The text of a controller's files; ``header_name`` is what ``source`` includes."""

    name: str
    style: Style
    header_name: str
    header: str
    source: str
    encoding: str | None
    """The blob's encoding in the table style."""
    table_bytes: int
    """Bytes of the packed weight table (unrolled) or of the blob's body (table)."""

    def write(self, folder: str | Path) -> tuple[Path, Path]:
        """Write ``name.c`` and its header into a folder that is there, each whole or not at all.

        Returns:
            The paths of source and header.

        Raises:
            BitneatError: if a file cannot be written.
        """
        source, header = Path(folder, f"{self.name}.c"), Path(folder, self.header_name)
        write_atomic(header, self.header.encode("ascii"))
        write_atomic(source, self.source.encode("ascii"))
        return source, header


def generate(
    controller: Controller,
    name: str,
    style: Style | Literal["auto"] = "auto",
    *,
    guard: bool = False,
    action: Action | None = None,
    environment_id: str = "",
    header_name: str | None = None,
    encoding: str | None = None,
) -> GeneratedC:
    """The header and source of a controller.

    Args:
        controller: any valid controller; its canonical form is what is generated.
        name: the prefix of every name in the code.
        style: ``unrolled``, ``table``, or ``auto`` for the one that compiles to fewer bytes on a Cortex-M0.
        guard: clamp the observations to their limits on entry, so that any int16 is allowed.
        action: the environment's action space, for the header's formulas and for ``name_decide``.
        environment_id: for the header.
        header_name: what the source includes; ``name.h`` if None.
        encoding: of the table style's blob; None for the one that, with its decoder, compiles smallest.

    Raises:
        CodegenError: if no input reaches an output, or the action space does not fit the outputs.
        CNameError: if ``name`` cannot prefix C names, or ``header_name`` cannot stand in an ``#include``.
        CompilerError: if there is a choice between styles or encodings, and no compiler to measure with.
    """
    check_name(name)
    header_name = header_name or f"{name}.h"
    check_file_stem(header_name.removesuffix(".h"), "header name")
    canonical = controller.canonical
    if all(isinstance(output, Constant) for output in canonical.outputs):
        raise CodegenError("controller: no path from any input to an output, nothing to generate")
    _check_action(canonical, action)
    interface = Interface(
        name=name,
        controller=canonical,
        action=action,
        environment=comment_text(environment_id),
        packed_bytes=len(pack_blob(canonical).data),
        guard=guard,
        version=__version__,
    )
    candidates = []
    if style != "table":
        candidates.append(_unrolled(interface, header_name))
    if style != "unrolled":
        encodings = [encoding] if encoding else table_encodings(canonical)
        candidates += [_table(interface, header_name, one) for one in encodings]
    return _smallest(candidates)


def _unrolled(interface: Interface, header_name: str) -> GeneratedC:
    view = unrolled_view(interface, order_depth_first(optimize(interface.controller)))
    source = environment().get_template("unrolled.c.j2").render(v=interface, u=view, header=header_name)
    header = environment().get_template("header.h.j2").render(v=interface, num_state=view.num_state, table=None)
    return GeneratedC(interface.name, "unrolled", header_name, header, source, None, view.num_weight_bytes)


def _table(interface: Interface, header_name: str, encoding: str) -> GeneratedC:
    blob = pack_blob(interface.controller, encoding)
    table = table_view(interface, blob)
    source = environment().get_template("table.c.j2").render(v=interface, table=table, header=header_name)
    header = environment().get_template("header.h.j2").render(v=interface, num_state=table.num_state, table=table)
    return GeneratedC(interface.name, "table", header_name, header, source, encoding, table.num_bytes)


def _smallest(candidates: list[GeneratedC]) -> GeneratedC:
    """The one that compiles to the fewest bytes, the first of equals; what stands alone is not compiled."""
    if len(candidates) == 1:
        return candidates[0]
    with ThreadPoolExecutor() as pool:
        sizes = list(pool.map(code_bytes, candidates))
    return candidates[sizes.index(min(sizes))]


DECODER_BYTES = {"bytes": 0, "planes": 90, "two_bits": 60, "trits": 60, "rice": 130}
"""About how much more code an encoding's decoder takes than that of ``bytes``, on a Cortex-M0."""


def table_encodings(canonical: Controller) -> list[str]:
    """The encodings worth compiling: ``bytes``, and each whose blob saves about what its decoder costs, or more."""
    sizes = {}
    for encoding in ENCODINGS:
        try:
            sizes[encoding] = len(pack_blob(canonical, encoding).data)
        except PackedFormatError:
            continue  # dense encodings have no shifts
    return [name for name, size in sizes.items() if size + DECODER_BYTES[name] <= sizes["bytes"] + 20]


def code_bytes(code: GeneratedC) -> int:
    """Bytes of flash that the code takes on a Cortex-M0 at -Os, tables included, as compiled by ziglang's clang.

    Raises:
        CompilerError: if ziglang is missing. Another compiler could rank the candidates differently, and the same controller
            would give other files on other machines.
    """
    zig = zig_compiler("thumb-freestanding-eabi")
    if zig is None:
        raise CompilerError(
            "codegen: choosing by size needs ziglang's clang, which is missing; pip install ziglang, or take --style unrolled"
        )
    return _code_bytes(code, zig)


@cache
def _code_bytes(code: GeneratedC, compiler: Compiler) -> int:
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        source = Path(folder, f"{code.name}.c")
        Path(folder, code.header_name).write_text(code.header, encoding="ascii")
        source.write_text(code.source, encoding="ascii")
        compile_object(source, compiler, ["-mcpu=cortex_m0", "-std=c99", "-Os", f"-I{folder}"], Path(folder, "code.o"))
        return measure(Path(folder, "code.o")).flash


def _check_action(controller: Controller, action: Action | None) -> None:
    if action is None:
        return
    if action.num_outputs != len(controller.outputs):
        raise CodegenError(
            f"controller: {len(controller.outputs)} outputs, but its action space takes {action.num_outputs}"
        )
    if not isinstance(action, BoxAction) and not -(2**31) < action.start < 2**31 - action.n:
        raise CodegenError(f"action space: start {action.start} does not fit 32 bits")


def selftest(code: GeneratedC, controller: Controller) -> str:
    """The text of ``name_selftest.c``: known answers of the reference, extremes of the domain among the inputs."""
    canonical = controller.canonical
    inputs = selftest_inputs(canonical)
    outputs = Reference(canonical).run(inputs)
    interface = Interface(code.name, canonical, None, "", 0, guard=False, version=__version__)
    return (
        environment()
        .get_template("selftest.c.j2")
        .render(
            v=interface,
            header=code.header_name,
            steps=len(inputs),
            inputs=[", ".join(map(str, row)) for row in inputs],
            outputs=[", ".join(map(str, row)) for row in outputs],
        )
    )


def selftest_inputs(controller: Controller) -> list[list[int]]:
    """Input vectors of the self-test: both extremes, zero, and random ones of every magnitude; the same every time."""
    rng = random.Random(SELFTEST_SEED)
    limits = [entry.limit for entry in controller.inputs]
    rows = [limits, [-limit for limit in limits], [0] * len(limits)]
    rows.append([rng.choice((-limit, limit)) for limit in limits])
    while len(rows) < SELFTEST_STEPS:
        bits = rng.randint(1, 15)
        rows.append([max(-limit, min(limit, rng.randint(-(1 << bits), 1 << bits))) for limit in limits])
    return rows
