# SPDX-License-Identifier: MIT
"""The walker's sine and cosine are the C library's to the bit, and a library that computes otherwise is told."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt
import pytest

import bitneat
from bitneat.native import shared_library

Floats = npt.NDArray[np.float32]

CSRC = Path(bitneat.__file__).parent / "sim" / "walker" / "csrc"
FLAGS = (
    "-std=gnu11",
    "-O3",
    "-march=native",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Werror",
    "-lm",
)
WIDTHS = (1, 4, 8, 16)
BITS_OF_100 = 0x42C80000
BITS_OF_SMALL = 0x39000000
"""Of 2^-13: the sines of smaller angles are the angles."""

CDEF = """
void walker_set_trig(bool formula);
int64_t trig_mismatches(uint32_t first, uint32_t last, uint32_t stride);
bool trig_self_test(void);
uint64_t trig_probe(void);
void by_lanes(const float *angle, float *s, float *c, size_t count);
void by_library(const float *angle, float *s, float *c, size_t count);
"""
CALLERS = """
#include "trig.h"
#include <stddef.h>
#include <string.h>
void by_lanes(const float *angle, float *s, float *c, size_t count);
void by_library(const float *angle, float *s, float *c, size_t count);

void by_lanes(const float *angle, float *s, float *c, size_t count)
{
    _Alignas(64) float a[LANES], sines[LANES], cosines[LANES];
    for (size_t i = 0; i < count; i += LANES) {
        memcpy(a, &angle[i], sizeof a);
        lanes_sincos(a, sines, cosines);
        memcpy(&s[i], sines, sizeof a);
        memcpy(&c[i], cosines, sizeof a);
    }
}

void by_library(const float *angle, float *s, float *c, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        struct rot q = rot_from_angle(angle[i]);
        s[i] = q.s;
        c[i] = q.c;
    }
}
"""
PLANTED = {
    "sinf": "float sinf(float x) { return (float)sin((double)x); }",
    "cosf": "float cosf(float x) { return (float)cos((double)x); }",
    "atan2f": "float atan2f(float y, float x) { return (float)atan2((double)y, (double)x); }",
}
"""The library's functions as they would be if they rounded correctly."""


@cache
def ffi() -> Any:
    declared = cffi.FFI()
    declared.cdef(CDEF)
    return declared


def build(folder: Path, lanes: int, planted: str = "") -> Path:
    callers = folder / "callers.c"
    callers.write_text(f"{CALLERS}\n#include <math.h>\n{planted}\n")
    # The library's own calls, too, go to what is planted.
    flags = (*FLAGS, "-fno-builtin", "-Wl,-Bsymbolic") if planted else FLAGS
    return shared_library(
        [CSRC / "trig.c", callers], name="walker-trig", include_dirs=[CSRC], flags=flags, defines={"LANES": str(lanes)}
    )


@pytest.fixture
def library(tmp_path: Path) -> Any:
    return ffi().dlopen(str(build(tmp_path, 16)))


@pytest.fixture
def exact(library: Any) -> Any:
    if not library.trig_self_test():
        pytest.skip("this C library, or its choice for this processor, does not compute by the formula")
    return library


def pointer(array: Floats) -> Any:
    return ffi().from_buffer("float[]", array)


def results(function: Any, angles: Floats) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
    """The bits of all sines and cosines; those of every NaN are the same."""
    s, c = np.empty_like(angles), np.empty_like(angles)
    function(pointer(angles), pointer(s), pointer(c), angles.size)
    for array in (s, c):
        array[np.isnan(array)] = np.nan
    return s.view(np.uint32), c.view(np.uint32)


def special_angles() -> Floats:
    """What is special on its own or as a neighbour of it, in several mixtures of lanes, with both signs."""
    quarters = (np.arange(1, 130) * (np.pi / 4)).astype(np.float32)
    powers = np.ldexp(np.float32(1), np.arange(-149, 128)).astype(np.float32)
    named = np.array([0, 0.75, 100, 120, 1e10, np.inf, np.nan, 3.4028235e38], np.float32)
    exact = np.concatenate([named, quarters, powers])
    with np.errstate(over="ignore", invalid="ignore"):
        near = [np.nextafter(exact, np.float32(way)) for way in (-np.inf, np.inf)]
    ordered = np.concatenate([exact, *near])
    ordered = np.concatenate([ordered, -ordered])
    shuffled = np.random.default_rng(1).permutation(ordered)
    alone = np.zeros((named.size, 16), np.float32)
    alone[np.arange(named.size), np.arange(named.size)] = named
    every = np.concatenate([ordered, shuffled, alone.ravel()])
    return np.concatenate([every, np.zeros(-every.size % 16, np.float32)])


@pytest.mark.parametrize("lanes", WIDTHS)
def test_lanes_give_what_the_library_gives(tmp_path: Path, lanes: int) -> None:
    library = ffi().dlopen(str(build(tmp_path, lanes)))
    rng = np.random.default_rng(lanes)
    angles = np.concatenate(
        [special_angles(), rng.uniform(-7, 7, 400_000), rng.normal(0, 60, 400_000)], dtype=np.float32
    )
    expected = results(library.by_library, angles)
    for formula in (False, bool(library.trig_self_test()), False):
        library.walker_set_trig(formula)
        for found, wanted in zip(results(library.by_lanes, angles), expected, strict=True):
            np.testing.assert_array_equal(found, wanted)


def test_every_width_is_exact_in_a_sample_of_angles(exact: Any) -> None:
    assert exact.trig_mismatches(BITS_OF_SMALL, BITS_OF_100, 13) == 0  # 25 million with their negatives
    assert exact.trig_mismatches(0, BITS_OF_SMALL, 997) == 0
    assert exact.trig_mismatches(BITS_OF_100, 0x7FFFFFFF, 10007) == 0


@pytest.mark.long
def test_every_width_is_exact_for_every_angle_up_to_100(exact: Any) -> None:
    assert exact.trig_mismatches(0, BITS_OF_100, 1) == 0


@pytest.mark.parametrize("name", PLANTED)
def test_another_library_is_told(tmp_path: Path, library: Any, name: str) -> None:
    (tmp_path / name).mkdir()
    other = ffi().dlopen(str(build(tmp_path / name, 16, PLANTED[name])))
    assert library.trig_probe() == library.trig_probe()
    assert other.trig_probe() == other.trig_probe()
    assert other.trig_probe() != library.trig_probe()
    if library.trig_self_test() and name != "atan2f":
        assert not other.trig_self_test()
        assert other.trig_mismatches(0x3F800000, 0x40000000, 1009) > 0


def test_mismatches_are_counted_where_they_are(tmp_path: Path, exact: Any) -> None:
    planted = "float cosf(float x) { return x == 3.5f ? 0.0f : (float)cos((double)x); }"
    other = ffi().dlopen(str(build(tmp_path, 16, planted)))
    # One cosine, which sincosf and four widths have otherwise; that of -3.5 and the sines are right.
    assert other.trig_mismatches(0x40600000, 0x40600000, 1) == 5
    assert exact.trig_mismatches(0x40600000, 0x40600000, 1) == 0


def test_the_library_s_choice_for_another_processor_is_told(tmp_path: Path, exact: Any) -> None:
    """glibc's builds with and without fused multiply-adds differ for 28 angles up to 100: both checks know them."""
    code = "import ctypes, sys; c = ctypes.CDLL(sys.argv[1]); c.trig_probe.restype = ctypes.c_uint64;"
    code += "print(c.trig_probe(), c.trig_self_test() & 255)"
    environment = {**os.environ, "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
    command = [sys.executable, "-c", code, str(build(tmp_path, 16))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    probe, passed = map(int, done.stdout.split())
    assert (probe == exact.trig_probe()) == bool(passed)  # equal where the C library knows no such tunable
