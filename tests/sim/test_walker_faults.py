# SPDX-License-Identifier: MIT
"""The comparison with Gymnasium notices mistakes: each of these is planted in a copy of the C, and must show.

The texts are looked for in the sources, so that one that has gone is noticed too: plant the fault anew then.
"""

from __future__ import annotations

from functools import cache

import pytest

from tests.sim.walker_builds import Fault, FaultyBuilds
from tests.sim.walkers import Episode, Record, compare, record

EPISODES = (
    Episode("random", 17, 60),
    Episode("bang", 16, 800),
    Episode("bang", 33, 60, hardcore=True),
    Episode("held", 5, 150, hardcore=True),
    Episode("held-bang", 7, 150),
    Episode("huge", 3, 150, hardcore=True),
    Episode("zero", 4, 150),
    Episode("full", 2, 80),
    Episode("full", 8, 250),
    Episode("slow-sine", 9, 150, hardcore=True),
    Episode("fast-sine", 10, 150),
    Episode("jump", 13, 150, hardcore=True),
    Episode("runner", 3, 1100),
    Episode("runner", 30, 150),
    Episode("champion", 6, 300, hardcore=True),
)
"""Together they do what the faults are in: they finish, leave to the left, fall asleep, hit the ground hard, and so on."""

FAULTS = (
    Fault("slop", "geometry.h", "#define LINEAR_SLOP 0.005f", "#define LINEAR_SLOP 0.00501f"),
    Fault("gravity", "walker.c", "#define GRAVITY (-10.0f)", "#define GRAVITY (-9.81f)"),
    Fault("friction of legs", "model.c", "mix_friction(2.5f, 0.2f)", "mix_friction(2.5f, 0.2001f)"),
    Fault("friction of hull", "model.c", "mix_friction(2.5f, 0.1f)", "mix_friction(2.5f, 0.11f)"),
    Fault(
        "order of joints",
        "solver.c",
        "prepare_joint(&b, HIP_2);\n    prepare_joint(&b, HIP_1);",
        "prepare_joint(&b, HIP_1);\n    prepare_joint(&b, HIP_2);",
    ),
    Fault(
        "order of contacts",
        "solver.c",
        "for (int32_t k = body->num_contacts; k-- > 0;)",
        "for (int32_t k = 0; k < body->num_contacts; ++k)",
    ),
    Fault("warm start", "walker.c", "m->point[i].normal_impulse = old[j].normal_impulse;", ""),
    Fault("velocity iterations", "walker.h", " VELOCITY_ITERATIONS = 180", " VELOCITY_ITERATIONS = 179"),
    Fault("position iterations", "walker.h", " POSITION_ITERATIONS = 60", " POSITION_ITERATIONS = 59"),
    Fault("block solver", "solver.c", "#define MAX_CONDITION_NUMBER 1000.0f", "#define MAX_CONDITION_NUMBER 100.0f"),
    Fault("speed limit", "solver.c", "#define MAX_TRANSLATION 2.0f", "#define MAX_TRANSLATION 0.3f"),
    Fault("end of contact", "walker.c", "w->leg_contact[index == LOWER_2] = false;", ""),
    Fault("preference of face", "collide.c", "#define RELATIVE_TOLERANCE 0.98f", "#define RELATIVE_TOLERANCE 1.0f"),
    Fault("broad phase", "walker.c", "#define FAT_MARGIN 0.1f", "#define FAT_MARGIN 0.05f"),
    Fault("prediction", "walker.c", "#define FAT_PREDICTION 2.0f", "#define FAT_PREDICTION 1.0f"),
    Fault(
        "no impacts",
        "walker.c",
        "if (body->num_contacts > 0) {\n            handle",
        "if (false) {\n            handle",
    ),
    Fault("impacts of a contact", "walker.c", "MAX_IMPACTS = 8", "MAX_IMPACTS = 0"),
    Fault("contacts of an impact", "walker.h", "MAX_ISLAND_CONTACTS = 32", "MAX_ISLAND_CONTACTS = 1"),
    Fault("first of equal impacts", "walker.c", "(contact->impact < earliest)", "(contact->impact <= earliest)"),
    Fault("impacts ruled out", "impact.c", "#define CLEARANCE 0.00825f", "#define CLEARANCE 0.004f"),
    Fault("tolerance of impact", "impact.c", "(0.25f * LINEAR_SLOP)", "(0.3f * LINEAR_SLOP)"),
    Fault("contact stays disabled", "walker.c", "    contact->enabled = true;\n    for", "    for"),
    Fault("no sleep", "walker.c", "if (shortest < TIME_TO_SLEEP || !w->positions_solved) {", "if (true) {"),
    Fault("restless sleep", "walker.c", "shortest < TIME_TO_SLEEP || !w->positions_solved", "shortest < TIME_TO_SLEEP"),
    Fault("rays", "model.c", "1.5 * i / 10.0", "1.5 * i / 9.0"),
    Fault("starting force", "walker.c", "w->force = ground->start_force;", ""),
    Fault("torque limit", "walker.c", "80.0f * (size < 1.0f ? size : 1.0f)", "80.0f * size"),
    Fault("price of torque", "model.c", "(float)(0.00035 * 80)", "0.02800001f"),
    Fault("left end", "observe.c", "w->fallen || x < 0.0;", "w->fallen;"),
    Fault("finish", "model.c", "(TERRAIN_LENGTH - 10) * terrain_step", "(TERRAIN_LENGTH - 9) * terrain_step"),
)


@cache
def _records() -> list[Record]:
    return [record(episode) for episode in EPISODES]


@pytest.fixture(scope="session")
def builds(tmp_path_factory: pytest.TempPathFactory) -> FaultyBuilds:
    return FaultyBuilds(tmp_path_factory.mktemp("faulty"))


@pytest.mark.parametrize("lanes", [1, 16])
def test_the_sound_build_shows_no_difference(builds: FaultyBuilds, lanes: int) -> None:
    assert not compare(_records(), library=builds.sound(), lanes=lanes)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_is_noticed(builds: FaultyBuilds, fault: Fault) -> None:
    library = builds.faulty(fault)
    for lanes in (1, 16):
        assert compare(_records(), library=library, lanes=lanes), f"{fault.name} went unnoticed in {lanes} lanes"
