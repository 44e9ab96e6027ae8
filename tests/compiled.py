# SPDX-License-Identifier: MIT
"""Runs controllers as compiled C in a program of their own, so that sanitizers and crashes are seen.

`run_compiled` puts the generated C of many controllers in both styles, and their blobs in every encoding with the runtime,
into one executable, feeds it input sequences, and returns what each implementation answered.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bitneat.codegen import STYLES, generate
from bitneat.controller import Controller
from bitneat.controller.activation import PROGRAMS
from bitneat.controller.packing import ENCODINGS, Layout, pack, shape_of
from bitneat.native.compiler import host_compiler
from bitneat.native.data import runtime_dir
from bitneat.runtime import MAX_LANES

Signals = npt.NDArray[np.int16]

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0")
RUNTIME_SOURCES = ("interpreter", "open", "population", "reader", "validate")


@dataclass(frozen=True)
class Case:
    """A controller and its inputs: an int16 array (sequences, steps, inputs); every sequence starts from reset."""

    controller: Controller
    inputs: Signals


def reference_outputs(case: Case) -> npt.NDArray[np.int64]:
    """What the semantics say, an array (sequences, steps, outputs): the reference, for all sequences at once."""
    controller, frac_bits = case.controller, case.controller.frac_bits
    sequences, steps, _ = case.inputs.shape
    previous = np.zeros((controller.num_signals, sequences), np.int64)
    results = np.zeros((steps, len(controller.outputs), sequences), np.int64)
    for step in range(steps):
        signals = np.zeros_like(previous)
        signals[: len(controller.inputs)] = case.inputs[:, step, :].T
        for index, node in enumerate(controller.nodes, start=len(controller.inputs)):
            total = np.full(sequences, node.bias, np.int64)
            for link in node.links:
                total += link.sign * ((previous if link.delay else signals)[link.source] << link.shift)
            total = total << node.gain if node.gain >= 0 else total >> -node.gain
            signals[index] = PROGRAMS[node.activation](np.clip(total, -32767, 32767), frac_bits)
        for position, output in enumerate(controller.outputs):
            results[step, position] = output.value if hasattr(output, "value") else signals[output.index]
        previous = signals
    return results.transpose(2, 0, 1)


def run_compiled(
    folder: Path, cases: Sequence[Case], flags: Sequence[str], *, styles: Sequence[str] = STYLES
) -> list[dict[str, Signals]]:
    """Compile and run; for each case what each implementation answered, arrays (sequences, steps, outputs).

    Raises:
        AssertionError: if it does not compile, or a sanitizer or the runtime's validation objects.
    """
    lines = ["#include <stdio.h>", '#include "bitneat/runtime.h"']
    bodies: list[str] = []
    names: list[list[str]] = []
    for number, case in enumerate(cases):
        names.append([])
        for style in styles:
            name = f"{style}{number}"
            # All decoders in turn, not just the one that is smallest.
            encodings = encodings_of(case.controller)
            code = generate(case.controller, name, style, encoding=encodings[number % len(encodings)])  # type: ignore[arg-type]
            (folder / f"{name}.h").write_text(code.header)
            (folder / f"{name}.c").write_text(code.source)
            lines.append(f'#include "{name}.c"')
            bodies.append(_generated_body(name, case, "state" in code.header and f"struct {name}_state" in code.header))
            names[-1].append(style)
        for encoding in encodings_of(case.controller):
            blob = pack(case.controller, encoding)
            lines.append(f"static const uint8_t blob_{encoding}{number}[] = {{{','.join(map(str, blob))}}};")
            bodies.append(_runtime_body(f"blob_{encoding}{number}", case))
            names[-1].append(encoding)
        bodies.append(_population_body(f"blob_bytes{number}", case))
        names[-1].append("population")
    lines += _arrays(cases)
    lines += ["int main(void)", "{", *bodies, "    return 0;", "}", ""]
    (folder / "main.c").write_text("\n".join(lines))
    compile_program(folder / "main.c", folder / "main", flags)
    data = b"".join(case.inputs.astype("<i2").tobytes() for case in cases)
    done = subprocess.run([folder / "main"], input=data, capture_output=True, check=False)
    assert done.returncode == 0, f"exit {done.returncode}: {done.stderr.decode(errors='replace')[:2000]}"
    return _split(done.stdout, cases, names)


def encodings_of(controller: Controller) -> list[str]:
    """The encodings that can express a controller."""
    shape = shape_of(Layout(controller.canonical))
    return [name for name, encoding in ENCODINGS.items() if encoding.applies(shape)]


def compile_program(main: Path, program: Path, flags: Sequence[str]) -> None:
    """Compile a source with the runtime into a program."""
    _compile(
        [*flags, f"-I{main.parent}", str(main), *_runtime_objects(tuple(flags), main.parent.parent), "-o", str(program)]
    )


@cache
def _runtime_objects(flags: tuple[str, ...], base: Path) -> tuple[str, ...]:
    """The runtime's objects for these flags, compiled once a process, in pytest's temporary folder, which clears itself."""
    folder = Path(tempfile.mkdtemp(prefix="runtime-", dir=base))
    for name in RUNTIME_SOURCES:
        _compile([*flags, "-c", str(runtime_dir() / "src" / f"{name}.c"), "-o", str(folder / f"{name}.o")])
    return tuple(str(folder / f"{name}.o") for name in RUNTIME_SOURCES)


def _compile(arguments: Sequence[str]) -> None:
    include = f"-I{runtime_dir() / 'include'}"
    command = [*host_compiler().command, "-std=c99", *WARNINGS, include, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]


def _arrays(cases: Sequence[Case]) -> list[str]:
    """Every implementation of a case gets the same inputs: they are read once per case into one array."""
    longest = max(case.inputs.size for case in cases)
    wide = max(case.inputs.shape[0] * case.inputs.shape[1] * len(case.controller.outputs) for case in cases)
    lanes = MAX_LANES * max(Layout(case.controller.canonical).workspace_length for case in cases)
    return [
        f"static int16_t inputs[{longest}];",
        f"static int16_t outputs[{max(wide, 4096)}];",
        f"static int16_t workspaces[{lanes}];",
    ]


def _generated_body(name: str, case: Case, has_state: bool) -> str:
    sequences, steps, width = case.inputs.shape
    outputs = len(case.controller.outputs)
    first = name.startswith("unrolled")
    read = f"if (fread(inputs, 2, {case.inputs.size}, stdin) != {case.inputs.size}) return 3;" if first else ""
    state = f"struct {name}_state state; {name}_reset(&state);" if has_state else ""
    argument = "&state, " if has_state else ""
    return (
        f"    {read}\n    for (long s = 0; s < {sequences}; s++) {{ {state}\n"
        f"        for (long t = 0; t < {steps}; t++) {{\n"
        f"            {name}_step({argument}inputs + (s * {steps} + t) * {width}, outputs);\n"
        f"            fwrite(outputs, 2, {outputs}, stdout);\n        }}\n    }}"
    )


def _runtime_body(blob: str, case: Case) -> str:
    sequences, steps, width = case.inputs.shape
    outputs = len(case.controller.outputs)
    return (
        f"    {{ struct bn_controller c; static int16_t state[40000], workspace[40000];\n"
        f"      if (bn_open(&c, {blob}, sizeof {blob}) != BN_OK || bn_validate(&c, workspace) != BN_OK) return 4;\n"
        f"      for (long s = 0; s < {sequences}; s++) {{ bn_reset(&c, state);\n"
        f"        for (long t = 0; t < {steps}; t++) {{\n"
        f"            bn_step(&c, state, workspace, inputs + (s * {steps} + t) * {width}, outputs);\n"
        f"            fwrite(outputs, 2, {outputs}, stdout);\n        }}\n    }} }}"
    )


def _population_body(blob: str, case: Case) -> str:
    """Whole sequences in one call each, which takes many steps at a time where there is no state."""
    sequences, steps, width = case.inputs.shape
    outputs = len(case.controller.outputs)
    if not case.controller.is_recurrent:  # or sequences of one step would never fill the lanes
        sequences, steps = 1, sequences * steps
    return (
        f"    {{ struct bn_controller c; static int16_t state[40000]; if (bn_open(&c, {blob}, sizeof {blob}) != BN_OK) return 4;\n"
        f"      for (long s = 0; s < {sequences}; s++) {{\n"
        f"        const struct bn_job job = {{&c, state, inputs + s * {steps * width}, outputs, {steps}}};\n"
        f"        bn_reset(&c, state); bn_population_step(&job, 1, workspaces);\n"
        f"        fwrite(outputs, 2, {steps * outputs}, stdout);\n    }} }}"
    )


def _split(answer: bytes, cases: Sequence[Case], names: Sequence[Sequence[str]]) -> list[dict[str, Signals]]:
    values = np.frombuffer(answer, "<i2")
    results = []
    at = 0
    for case, implementations in zip(cases, names, strict=True):
        sequences, steps, _ = case.inputs.shape
        shape = (sequences, steps, len(case.controller.outputs))
        size = sequences * steps * shape[2]
        results.append({})
        for implementation in implementations:
            results[-1][implementation] = values[at : at + size].reshape(shape)
            at += size
    assert at == values.size
    return results
