# SPDX-License-Identifier: MIT
"""Small champions, and C for them."""

from __future__ import annotations

import random
from pathlib import Path

from bitneat.champion import Champion, EnvironmentSpec
from bitneat.codegen import Style, generate
from bitneat.controller import Controller, Link, Node, Reference, Signal
from bitneat.sim.environment import default_inputs, inspect
from bitneat.verify.cfile import CFile
from tests.strategies import input_vectors, random_controller

ACTIVATIONS = ("clamped", "relu", "tanh")
"""Few enough that no compiler makes a jump table of them."""


def champion(environment_id: str = "Pendulum-v1", seed: int = 0, *, recurrent: bool = False) -> Champion:
    """A random controller for an environment, with outputs that all depend on its inputs."""
    spec = EnvironmentSpec(environment_id)
    info = inspect(spec)
    for attempt in range(100):
        drawn = random_controller(
            random.Random(1000 * seed + attempt),
            size="small",
            ternary=True,
            feed_forward=not recurrent,
            activations=ACTIVATIONS,
            frac_bits=8,
            num_inputs=info.num_inputs,
            num_nodes=8,
            num_outputs=info.action.num_outputs,
        )
        if drawn.canonical.is_recurrent == recurrent and _is_lively(drawn):
            controller = Controller(default_inputs(info, 8), drawn.nodes, drawn.outputs, 8)
            return Champion(controller, info.action, spec)
    raise AssertionError("no lively controller found")


def _is_lively(controller: Controller) -> bool:
    rows = Reference(controller).run(input_vectors(controller, random.Random(1), 200))
    return all(len(set(column)) > 20 for column in zip(*rows, strict=True))


def plain_champion(weight: int = 1) -> Champion:
    """A pendulum's, small enough to read: one node that adds the cosine and takes the sine away, twice as strong."""
    spec = EnvironmentSpec("Pendulum-v1")
    info = inspect(spec)
    node = Node((Link(0, sign=weight), Link(1, sign=-1), Link(2, sign=1)), 0, 1, "clamped")
    return Champion(Controller(default_inputs(info, 8), (node,), (Signal(3),), 8), info.action, spec)


def written(whose: Champion, folder: Path, style: Style = "unrolled", stem: str = "legs", **options: bool) -> CFile:
    """The C that ``codegen -o STEM.c`` writes."""
    assert whose.environment is not None
    code = generate(
        whose.controller,
        stem,
        style,
        action=whose.action,
        environment_id=whose.environment.id,
        **options,  # type: ignore[arg-type]
    )
    return CFile.write(code, folder)
