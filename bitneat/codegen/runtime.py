# SPDX-License-Identifier: MIT
"""Writes the runtime's general interpreter: ``python -m bitneat.codegen.runtime``."""

from __future__ import annotations

from bitneat.codegen.interpreter import general_view, small_view
from bitneat.codegen.templating import environment
from bitneat.files import write_atomic
from bitneat.native.data import runtime_dir


def render() -> str:
    """The text of ``runtime_c/src/interpreter.c``."""
    return environment().get_template("runtime_interpreter.c.j2").render(m=general_view(), small=small_view())


if __name__ == "__main__":
    write_atomic(runtime_dir() / "src" / "interpreter.c", render().encode("ascii"))
