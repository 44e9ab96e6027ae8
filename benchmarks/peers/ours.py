# SPDX-License-Identifier: MIT
"""bitneat's own code as candidates."""

from __future__ import annotations

from benchmarks.peers.candidate import Candidate
from bitneat.codegen import Style, generate
from bitneat.controller import Controller


def bitneat_code(controller: Controller, style: Style) -> Candidate:
    """The generated C in one style, its encoding chosen as codegen does it."""
    code = generate(controller, "net", style)
    return Candidate(
        name=f"bitneat, {style}",
        note="integers, exact",
        sources={"net.c": code.source, "net.h": code.header},
        prologue='#include "net.h"',
        call="net_step(input, output);",
        element="int16_t",
        unit=controller.one,
    )
