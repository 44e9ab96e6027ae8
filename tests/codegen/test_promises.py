# SPDX-License-Identifier: MIT
"""What compilers make of the generated C keeps its promises: no branch on data, no multiplication, no library, no data in RAM."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from bitneat.codegen import STYLES, generate
from bitneat.controller import Constant, Controller, DiscreteAction
from bitneat.controller.packing import ENCODINGS
from bitneat.native.compiler import host_compiler, identify, zig_compiler
from bitneat.verify.cfile import CFile
from bitneat.verify.instructions import THUMB
from bitneat.verify.machine import Toolchain, examine
from tests.strategies import random_controller


def toolchains() -> dict[str, Toolchain]:
    """The host's compiler, and for a Cortex-M0 ziglang's clang and, where it is installed, gcc."""
    found = {"host": Toolchain(host_compiler())}
    zig, gcc = zig_compiler("thumb-freestanding-eabi"), identify(["arm-none-eabi-gcc"])
    assert zig is not None, "ziglang is a dependency"
    found["zig-m0"] = Toolchain(zig, ("-mcpu=cortex_m0",), THUMB)
    if gcc is not None:
        found["gcc-m0"] = Toolchain(gcc, ("-mcpu=cortex-m0", "-mthumb"), THUMB)
    return found


def variants(controller: Controller) -> list[tuple[str, str | None]]:
    shifts = any(link.shift for node in controller.canonical.nodes for link in node.links)
    encodings = ["bytes", "rice"] if shifts else list(ENCODINGS)
    return [(style, one) for style in STYLES for one in (encodings if style == "table" else [None])]


@pytest.mark.parametrize("seed", range(300, 308))
def test_random_controllers_keep_every_promise(tmp_path: Path, seed: int) -> None:
    controller = random_controller(random.Random(seed))
    if all(isinstance(output, Constant) for output in controller.canonical.outputs):
        controller = random_controller(random.Random(seed + 1000), ternary=True, size="medium")
    action = DiscreteAction(len(controller.outputs))
    for style, encoding in variants(controller):
        code = generate(controller, "w", style, encoding=encoding, action=action)  # type: ignore[arg-type]
        for name, toolchain in toolchains().items():
            examination = examine(CFile.write(code, tmp_path), toolchain)
            assert examination.violations == (), f"seed {seed}, {style}, {encoding}, {name}: {examination.violations}"
            assert examination.flash
