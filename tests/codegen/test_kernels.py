# SPDX-License-Identifier: MIT
"""Every activation, at every argument and every F: the C equals the reference, in both styles and in the runtime."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bitneat.codegen.kernels import _sums_of_shifts, kernel
from bitneat.controller import ACTIVATION_NAMES, Controller, Input, Link, Node, Signal
from bitneat.controller.activation import Op, Program, Step, evaluate, table
from tests.compiled import Case, run_compiled

ARGUMENTS = np.arange(-32767, 32768, dtype=np.int16)


def one_node(activation: str, frac_bits: int) -> Controller:
    """A controller whose output is the activation of its input."""
    return Controller((Input(),), (Node((Link(0),), activation=activation),), (Signal(1),), frac_bits)


@pytest.mark.parametrize("frac_bits", range(4, 13))
def test_compiled_activations_equal_the_reference_everywhere(tmp_path: Path, frac_bits: int) -> None:
    cases = [Case(one_node(name, frac_bits), ARGUMENTS.reshape(-1, 1, 1)) for name in ACTIVATION_NAMES]
    for name, answer in zip(ACTIVATION_NAMES, run_compiled(tmp_path, cases, ("-O1",)), strict=True):
        assert {"unrolled", "table", "bytes", "rice", "planes"} <= set(answer)
        for implementation, outputs in answer.items():
            wrong = np.flatnonzero(outputs.ravel() != table(name, frac_bits))
            assert wrong.size == 0, f"{implementation}: {name}({ARGUMENTS[wrong[0]]}) at F={frac_bits}"


@pytest.mark.parametrize("name", ACTIVATION_NAMES)
@pytest.mark.parametrize("frac_bits", [4, 8, 12])
def test_the_table_is_what_the_scalar_reference_says(name: str, frac_bits: int) -> None:
    values = table(name, frac_bits)
    for u in [*range(-32767, 32768, 251), -1, 0, 1, 32767]:
        assert values[u + 32767] == evaluate(name, u, frac_bits)


def test_no_kernel_compares_branches_multiplies_or_divides() -> None:
    for name in ACTIVATION_NAMES:
        for frac_bits in (None, 8):
            text = " ".join((*kernel(name, "p", frac_bits).statements, kernel(name, "p", frac_bits).result))
            assert not set("*/%?") & set(text), text
            assert not any(word in text for word in ("if", "for", " > ", " == ", "&&", "||")), text


def test_shifts_of_one_value_are_hidden_from_the_compiler_where_they_are_summed() -> None:
    assert "opaque" in kernel("sin", "p", 8).helpers
    assert "opaque" not in kernel("tanh", "p", 8).helpers


def test_a_constant_has_no_more_bits_than_the_smallest_f_leaves_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def program(extra_bits: int) -> dict[str, Program]:
        return {"one": Program("one", "1", (Step(Op.CONST, value=1 << 12, k=extra_bits),))}

    monkeypatch.setattr("bitneat.codegen.kernels.PROGRAMS", program(8))
    assert kernel("one", "p", None).result == "(UINT32_C(4096) << (f - 4U))"
    assert kernel("one", "p", 4).result == "UINT32_C(4096)"
    monkeypatch.setattr("bitneat.codegen.kernels.PROGRAMS", program(9))
    with pytest.raises(ValueError, match=r"^a constant with more bits than F = 4 leaves room for$"):
        kernel("one", "p", None)


def test_two_shifts_of_one_value_are_hidden_and_one_is_not() -> None:
    steps = (
        Step(Op.SHL, 0, k=1),
        Step(Op.SHL, 0, k=2),
        Step(Op.SHL, 1, k=3),
        Step(Op.SHL, 2, k=1),
        Step(Op.SHL, 2, k=1),
    )
    assert _sums_of_shifts(Program("some", "x", steps)) == {steps[0], steps[1]}
