# SPDX-License-Identifier: MIT
"""Frama-C's Eva finds no undefined behaviour in generated C and runtime, for all inputs; and finds it where it is planted."""

from __future__ import annotations

from pathlib import Path

import pytest

from bitneat.champion import load
from bitneat.controller import Controller, Input, Link, Node, Signal
from tests.analysis.controllers import CHAMPIONS, STYLES, one_of_each, rich_controller
from tests.analysis.eva import MACHINES, MERGED, analyse, any_header_program, generated_program, runtime_program
from tests.compiled import encodings_of

pytestmark = pytest.mark.long
"""Frama-C is a large package; nothing but these tests needs it."""


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("name", CHAMPIONS)
def test_the_c_of_a_committed_champion_has_no_undefined_behaviour(tmp_path: Path, name: str, machine: str) -> None:
    controller = load(CHAMPIONS[name]).controller
    assert analyse(generated_program(tmp_path, [controller], styles=STYLES), machine).alarms == ()


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize(("first", "guard"), [(0, False), (5, True), (10, False), (15, True)])
def test_the_c_of_random_controllers_has_no_undefined_behaviour(
    tmp_path: Path, first: int, guard: bool, machine: str
) -> None:
    controllers = [rich_controller(seed) for seed in range(first, first + 5)]
    assert analyse(generated_program(tmp_path, controllers, styles=STYLES, guard=guard), machine).alarms == ()


@pytest.mark.parametrize("machine", MACHINES)
def test_the_activations_have_no_undefined_behaviour_at_any_precision(tmp_path: Path, machine: str) -> None:
    controllers = [one_of_each(frac_bits) for frac_bits in range(4, 13)]
    assert analyse(generated_program(tmp_path, controllers, styles=STYLES), machine).alarms == ()


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("encoding", ["bytes", "rice", "planes", "two_bits", "trits"])
def test_the_runtime_has_no_undefined_behaviour_on_a_champions_blob(
    tmp_path: Path, encoding: str, machine: str
) -> None:
    controller = load(CHAMPIONS["champions-tiny"]).controller
    assert analyse(runtime_program(tmp_path, controller, encoding), machine).alarms == ()


@pytest.mark.parametrize("seed", range(6))
def test_the_runtime_has_no_undefined_behaviour_on_random_blobs(tmp_path: Path, seed: int) -> None:
    controller = rich_controller(seed)
    for encoding in encodings_of(controller):
        assert analyse(runtime_program(tmp_path, controller, encoding), MACHINES[seed % 3]).alarms == ()


@pytest.mark.parametrize("frac_bits", range(4, 13))
def test_the_kernels_of_the_runtime_have_no_undefined_behaviour(tmp_path: Path, frac_bits: int) -> None:
    assert analyse(runtime_program(tmp_path, one_of_each(frac_bits), "bytes")).alarms == ()


@pytest.mark.parametrize("machine", MACHINES)
def test_a_header_of_any_bytes_is_read_without_undefined_behaviour(tmp_path: Path, machine: str) -> None:
    assert analyse(any_header_program(tmp_path), machine, MERGED).alarms == ()


def test_the_smallest_champion_has_no_undefined_behaviour(tmp_path: Path) -> None:
    controller = load(CHAMPIONS["champions-tiny"]).controller
    analysis = analyse(generated_program(tmp_path, [controller], styles=STYLES))
    assert analysis.alarms == ()
    assert analysis.functions >= 10


PLANTED = {
    "a read outside": ("observation[0]", "observation[1000]", "out of bounds"),
    "a signed sum that overflows": (
        "(int16_t)((int32_t)(uint16_t)(x + 32768U) - 32768)",
        "(int16_t)((int32_t)x + (int32_t)x)",
        "overflow",
    ),
    "a conversion left to the implementation": (
        "(int16_t)((int32_t)(uint16_t)(x + 32768U) - 32768)",
        "(int16_t)x",
        "downcast",
    ),
    "a shift too far": ("x >> 31", "x >> 32", "shift"),
    "an output that is not written": ("action[0] =", "action[1] =", "uninitialized"),
}


@pytest.mark.parametrize("what", PLANTED)
def test_planted_undefined_behaviour_is_found(tmp_path: Path, what: str) -> None:
    right, wrong, alarm = PLANTED[what]
    controller = Controller(
        (Input(0, 500), Input(0, 500)), (Node((Link(0), Link(1)), activation="relu"),), (Signal(2), Signal(0)), 8
    )
    main = generated_program(tmp_path, [controller], styles=("unrolled",))
    source = tmp_path / "unrolled0.c"
    assert right in source.read_text()
    source.write_text(source.read_text().replace(right, wrong))
    assert any(alarm in text for text in analyse(main).alarms)
