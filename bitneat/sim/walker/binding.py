# SPDX-License-Identifier: MIT
"""The simulator's C, compiled on first use and loaded through cffi's ABI mode."""

from __future__ import annotations

import operator
import os
import threading
from functools import cache
from pathlib import Path
from typing import Any, SupportsIndex

import cffi
import numpy as np

from bitneat.errors import BitneatError
from bitneat.native.build import shared_library
from bitneat.native.data import runtime_dir

LANE_WIDTHS = (1, 4, 8, 16)
"""How many walkers the solver can take side by side."""

FLAGS = ("-std=gnu11", "-O3", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-pthread", "-lm")
"""A product and a sum must not be contracted: each of them rounds, in Box2D's build too."""

_SOURCES = (
    "collide",
    "impact",
    "model",
    "network",
    "observe",
    "simulator",
    "solver_1",
    "solver_4",
    "solver_8",
    "solver_16",
    "terrain",
    "trig",
    "walker",
)
_CDEF = """
struct pcg64 {
    uint64_t state[2], increment[2];
    uint32_t has_uint32, uinteger;
};
struct shaping {
    double fall_reward, fall_value, finish_bonus, stall_gain;
    int32_t max_steps, stall_steps;
};
struct network {
    const double *bias, *response, *weight;
    const int32_t *activation, *first_link, *source, *output;
    int32_t num_inputs, num_nodes, num_outputs;
};
struct policy {
    const void *controller;
    const struct network *network;
    const double *factor, *limit;
    const float *actions;
    int32_t one;
    uint32_t rays;
};
struct episode {
    int32_t policy, ground;
};
struct result {
    double reward, shaped;
    int32_t steps;
    uint8_t terminated, stalled, failed;
};
void network_step(const struct network *network, double *signals, double *outputs);
bool simulator_open(void);
int64_t simulator_environment_size(void);
int32_t simulator_widest(void);
void simulator_seed(void *environments, int32_t index, const struct pcg64 *rng, int32_t hardcore);
void simulator_random_state(const void *environments, int32_t index, struct pcg64 *rng);
bool simulator_reset(void *environments, const int32_t *which, int32_t count, float *observations, int32_t lanes,
                     int32_t threads);
bool simulator_step(void *environments, const int32_t *which, int32_t count, const float *actions, float *observations,
                    double *rewards, uint8_t *terminated, int32_t lanes, int32_t threads);
bool simulator_run(const struct policy *policies, const struct pcg64 *grounds, int32_t hardcore,
                   const struct episode *episodes, int64_t count, const struct shaping *shaping,
                   struct result *results, int32_t lanes, int32_t threads, const int32_t *stop);
uint64_t trig_probe(void);
"""


@cache
def ffi() -> Any:
    """The declarations of the C side."""
    declarations = cffi.FFI()
    declarations.cdef(_CDEF)
    return declarations


def sources() -> tuple[list[Path], list[Path]]:
    """The C files of the simulator, the controllers' runtime included, and the folders of their headers."""
    folder = Path(__file__).parent / "csrc"
    runtime = runtime_dir()
    files = [folder / f"{name}.c" for name in _SOURCES]
    files += [runtime / "src" / f"{name}.c" for name in ("interpreter", "open", "reader", "validate")]
    return files, [folder, runtime / "include", runtime / "src"]


_opening = threading.Lock()


def library() -> Any:
    """The simulator, compiled and opened.

    Raises:
        BitneatError: if there is no C compiler, or it refuses.
    """
    with _opening:  # a cache alone would let two threads open it, the one while the other's walkers walk
        return _open()


@cache
def _open() -> Any:
    files, folders = sources()
    path = shared_library(files, name="bitneat-walker", include_dirs=folders, flags=FLAGS)
    opened = ffi().dlopen(str(path))
    opened.simulator_open()
    return opened


MAX_THREADS = 256
"""More are not started in one call."""


def default_threads() -> int:
    """One for each core that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, MAX_THREADS)


def whole_number(name: str, value: SupportsIndex, most: int = 2**31 - 1) -> int:
    """The number, a NumPy one too, that the caller gave as ``name``.

    Raises:
        BitneatError: if it is not a whole number from 1 to ``most``.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if not 1 <= number <= most:
        raise BitneatError(f"{name}: expected a whole number from 1 to {most}, got {value!r}")
    return number


def lane_width(lanes: int | None) -> int:
    """The given number of lanes, or the widest that the machine has instructions for.

    Raises:
        BitneatError: if there is no such width.
    """
    if lanes is None:
        return int(library().simulator_widest())
    if lanes not in LANE_WIDTHS:
        raise BitneatError(f"lanes: expected one of {', '.join(map(str, LANE_WIDTHS))}, got {lanes!r}")
    return lanes


def random_state(generator: np.random.Generator) -> Any:
    """A ``struct pcg64`` with the state of a NumPy generator."""
    state = generator.bit_generator.state
    inner = state["state"]
    mask = 2**64 - 1
    return ffi().new(
        "struct pcg64 *",
        {
            "state": [inner["state"] >> 64, inner["state"] & mask],
            "increment": [inner["inc"] >> 64, inner["inc"] & mask],
            "has_uint32": state["has_uint32"],
            "uinteger": state["uinteger"],
        },
    )
