# SPDX-License-Identifier: MIT
"""Writes the generated parts of ``runtime_c``: ``python -m bitneat.codegen.runtime``.

They are the general interpreter, printed from the templates of the table style, and the known answers of its test, given by
the reference.
"""

from __future__ import annotations

from collections.abc import Iterable

from bitneat.codegen.generate import selftest_inputs
from bitneat.codegen.interpreter import general_view, small_view
from bitneat.codegen.templating import environment
from bitneat.codegen.view import byte_lines
from bitneat.controller import ACTIVATION_NAMES, Constant, Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.packing import ENCODINGS, Layout, pack, shape_of
from bitneat.files import write_atomic
from bitneat.native.data import runtime_dir

_STEPS = 24


def interpreter() -> str:
    """The text of ``runtime_c/src/interpreter.c``."""
    return environment().get_template("runtime_interpreter.c.j2").render(m=general_view(), small=small_view())


def known_answers() -> str:
    """The text of ``runtime_c/tests/known_answers.h``: controllers with every feature, in every encoding that has it."""
    cases = []
    for name, controller in _EXAMPLES.items():
        canonical = controller.canonical
        inputs = selftest_inputs(canonical)[:_STEPS]
        shape = shape_of(Layout(canonical))
        cases.append(
            {
                "name": name,
                "num_inputs": len(canonical.inputs),
                "num_outputs": len(canonical.outputs),
                "inputs": _numbers(inputs),
                "outputs": _numbers(Reference(canonical).run(inputs)),
                "blobs": {
                    encoding: byte_lines(pack(canonical, encoding))
                    for encoding, description in ENCODINGS.items()
                    if description.applies(shape)
                },
            }
        )
    return environment().get_template("known_answers.h.j2").render(cases=cases, steps=_STEPS)


def _numbers(rows: Iterable[Iterable[int]]) -> list[str]:
    return [", ".join(map(str, row)) + "," for row in rows]


_EXAMPLES = {
    "every_activation": Controller(
        inputs=(Input(0, 2047), Input()),
        nodes=tuple(
            Node((Link(0), Link(index, sign=-1)), bias=256 * (index % 3 - 1), gain=index % 3 - 2, activation=name)
            for index, name in enumerate(ACTIVATION_NAMES, start=1)
        ),
        outputs=tuple(Signal(2 + index) for index in range(len(ACTIVATION_NAMES))),
    ),
    "memory": Controller(
        inputs=(Input(3, 500), Input(-2, 32767), Input(3, 500)),
        nodes=(
            Node(
                (Link(0, shift=3), Link(0, sign=-1), Link(4, delay=1, shift=1)),
                bias=-1234,
                gain=-1,
                activation="identity",
            ),
            Node((Link(3), Link(4, delay=1), Link(1, delay=1, sign=-1)), activation="clamped"),
            Node((), bias=77, activation="identity"),
            Node((Link(5, delay=1), Link(2)), gain=2, activation="abs"),
        ),
        outputs=(Signal(6), Constant(-300), Signal(1), Signal(4), Signal(6)),
        frac_bits=10,
    ),
    "sum": Controller((Input(), Input()), (Node((Link(0), Link(1)), activation="identity"),), (Signal(2),), 4),
}


if __name__ == "__main__":
    write_atomic(runtime_dir() / "src" / "interpreter.c", interpreter().encode("ascii"))
    write_atomic(runtime_dir() / "tests" / "known_answers.h", known_answers().encode("ascii"))
