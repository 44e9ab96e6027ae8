# SPDX-License-Identifier: MIT
"""The time of impact in C against the one of Box2D, bit for bit, and the quick test that rules impacts out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import Box2D
import cffi
import numpy as np
import numpy.typing as npt
import pytest

import bitneat.sim
from bitneat.native.build import shared_library

CSRC = Path(bitneat.sim.__file__).parent / "walker" / "csrc"
FLAGS = ("-std=gnu11", "-O3", "-march=native", "-ffp-contract=off")
STEP = 14 / 30
TOUCHING = 0.00625
CASES = 10_000
KINDS = ("resting", "grazing", "fast", "rotating", "overlapped", "threshold")

CDEF = """
struct vec { float x, y; };
struct rot { float s, c; };
struct pose { struct vec p; struct rot q; };
struct polygon { int32_t count; struct vec vertex[5]; struct vec normal[5]; struct vec centroid; };
struct edge { struct vec a, b, normal; };
struct sweep { struct vec local_center, c0, c; float a0, a, alpha0; };
bool time_of_impact(const struct vec *a, int32_t count, const struct polygon *b, const struct sweep *sweep, float *t);
bool impact_possible(const struct vec *a, int32_t count, const struct polygon *b, const struct pose *start,
                     const struct pose *end, float angle_change);
bool impact_possible_edge(const struct edge *a, const struct polygon *b, const struct pose *start,
                          const struct pose *end, float angle_change);
"""

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]

HULL = Box2D.b2PolygonShape(
    vertices=[(x / 30, y / 30) for x, y in ((-30, +9), (+6, +9), (+34, +1), (+34, -8), (-30, -8))]
)
UPPER_LEG = Box2D.b2PolygonShape(box=(4 / 30, 17 / 30))
LOWER_LEG = Box2D.b2PolygonShape(box=(0.8 * 4 / 30, 17 / 30))
MOVING = (HULL, UPPER_LEG, LOWER_LEG)


@cache
def _ffi() -> Any:
    ffi = cffi.FFI()
    ffi.cdef(CDEF)
    return ffi


@cache
def _library() -> Any:
    return _ffi().dlopen(str(shared_library([CSRC / "impact.c"], name="walker-impact", flags=FLAGS)))


@cache
def _polygon(index: int) -> Any:
    shape = MOVING[index]
    count = len(shape.vertices)
    pad = [(0, 0)] * (5 - count)
    return _ffi().new(
        "struct polygon *", [count, [*shape.vertices, *pad], [*shape.normals, *pad], tuple(shape.centroid)]
    )


@dataclass(frozen=True)
class Sweeps:
    """Shapes and motions; one row each. The fields of `sweep` are those of the C's struct."""

    ground: Floats  # (cases, 2 or 4, 2): vertices in counter-clockwise order
    edges: Floats  # (cases, 6): the side that was aimed at, as a struct edge
    moving: npt.NDArray[np.int64]
    sweep: Floats  # (cases, 9)

    def poses(self, time: float) -> Floats:
        """The body's poses, (cases, 4), as a struct pose."""
        center, angle = _at(self.sweep.astype(np.float64), time)
        local = self.sweep[:, 0:2].astype(np.float64)
        position = center - _rotate(angle, local)
        return np.column_stack([position, np.sin(angle), np.cos(angle)]).astype(np.float32)


def _at(sweep: Doubles, time: float) -> tuple[Doubles, Doubles]:
    center = (1 - time) * sweep[:, 2:4] + time * sweep[:, 4:6]
    return center, (1 - time) * sweep[:, 6] + time * sweep[:, 7]


def _rotate(angle: Doubles, v: Doubles) -> Doubles:
    s, c = np.sin(angle), np.cos(angle)
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1]], axis=-1)


def _grounds(rng: np.random.Generator, box: bool, cases: int) -> tuple[Floats, Floats]:
    """Terrain, and one side of each as a struct edge: its normal points into the ground's edge, out of a box."""
    start = np.stack([rng.uniform(0, 93, cases), rng.uniform(2, 9, cases)], axis=1).astype(np.float32)
    rows = np.arange(cases)
    if box:
        size = (STEP * rng.integers(1, 5, (cases, 2))).astype(np.float32)
        x0, y0, x1, y1 = start[:, 0], start[:, 1], start[:, 0] + size[:, 0], start[:, 1] + size[:, 1]
        corners = [np.stack(corner, axis=1) for corner in ((x1, y0), (x1, y1), (x0, y1), (x0, y0))]
        ground = np.stack(corners, axis=1)
        side = rng.integers(0, 4, cases)
        a, b = ground[rows, side], ground[rows, (side + 1) % 4]
    else:
        rise = np.where(rng.random(cases) < 0.2, 0.0, rng.normal(0, 0.15, cases))
        end = start + np.stack([np.full(cases, STEP), rise], axis=1).astype(np.float32)
        ground = np.stack([start, end], axis=1)
        a, b = start, end
    along = b - a
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(along[:, 0], along[:, 1])[:, None]
    return ground, np.concatenate([a, b, normal.astype(np.float32)], axis=1)


@cache
def _sweeps(kind: str, box: bool, cases: int = CASES) -> Sweeps:
    """A vertex of the moving body comes `height` near to a side's line at some `moment` of a random motion."""
    rng = np.random.default_rng([KINDS.index(kind), box])
    ground, edges = _grounds(rng, box, cases)
    a, b = edges[:, 0:2].astype(np.float64), edges[:, 2:4].astype(np.float64)
    out = edges[:, 4:6].astype(np.float64) * (1 if box else -1)
    moving = rng.integers(0, 3, cases)
    corners = np.array(
        [list(MOVING[i].vertices) + [MOVING[i].vertices[0]] * (5 - len(MOVING[i].vertices)) for i in moving]
    )
    local = np.array([tuple(MOVING[i].centroid) for i in moving])

    slope = np.arctan2(out[:, 1], out[:, 0]) - np.pi / 2
    flat = slope + rng.normal(0, 0.002, cases) + rng.integers(0, 4, cases) * np.pi / 2
    angle = np.where(rng.random(cases) < 0.5, flat, rng.uniform(-np.pi, np.pi, cases))
    moment = rng.choice([0.0, 1.0], cases)
    velocity = rng.normal(0, 0.05, (cases, 2))
    turn = rng.normal(0, 0.05, cases)
    if kind == "resting":
        height = rng.uniform(0.005, 0.03, cases)
        velocity = rng.normal(0, 0.002, (cases, 2))
        turn = rng.normal(0, 0.004, cases)
    elif kind == "grazing":
        height = rng.uniform(-0.01, 0.03, cases)
        moment = rng.random(cases)
    elif kind == "fast":
        height = rng.uniform(-0.5, 0.02, cases)
        moment = rng.uniform(0.3, 1.0, cases)
        velocity = rng.uniform(-1.4, 1.4, (cases, 2))
    elif kind == "rotating":
        height = rng.uniform(-0.02, 0.03, cases)
        moment = rng.random(cases)
        turn = rng.uniform(-np.pi / 2, np.pi / 2, cases)
    elif kind == "overlapped":
        height = rng.uniform(-0.2, 0.0, cases)
        moment = np.zeros(cases)
    else:
        height = TOUCHING + rng.normal(0, 1, cases) * 10.0 ** rng.uniform(-7, -2.5, cases)
        turn *= 10.0 ** rng.uniform(-2, 1, cases)

    arms = _rotate(angle[:, None], corners - local[:, None])
    lowest = arms[np.arange(cases), np.argmin((arms * out[:, None]).sum(axis=2), axis=1)]
    place = rng.uniform(-0.2, 1.2, cases)[:, None]
    center = a + place * (b - a) + height[:, None] * out - lowest
    if kind in ("grazing", "rotating"):
        # The vertex moves along the side at that moment: it is nearest then, or farthest.
        rising = turn * (lowest[:, 0] * out[:, 1] - lowest[:, 1] * out[:, 0])
        velocity -= ((velocity * out).sum(axis=1) + rising)[:, None] * out
    angle = angle + 2 * np.pi * rng.integers(-3, 4, cases)
    sweep = np.concatenate(
        [
            local,
            center - moment[:, None] * velocity,
            center + (1 - moment)[:, None] * velocity,
            (angle - moment * turn)[:, None],
            (angle + (1 - moment) * turn)[:, None],
            rng.random((cases, 1)),
        ],
        axis=1,
    )
    return Sweeps(ground, edges, moving, sweep.astype(np.float32))


@cache
def _box2d(kind: str, box: bool) -> tuple[npt.NDArray[np.bool_], Floats]:
    """Which of the sweeps touch, and when, says Box2D; 0 for those that do not."""
    sweeps = _sweeps(kind, box)
    still, sweep = Box2D.b2Sweep(), Box2D.b2Sweep()
    still.localCenter = still.c0 = still.c = (0, 0)
    still.a0 = still.a = still.alpha0 = 0
    touches, times = np.zeros(CASES, np.bool_), np.zeros(CASES, np.float32)
    for i, (vertices, row) in enumerate(zip(sweeps.ground.tolist(), sweeps.sweep.tolist(), strict=True)):
        shape = Box2D.b2PolygonShape(vertices=vertices) if box else Box2D.b2EdgeShape(vertices=vertices)
        sweep.localCenter, sweep.c0, sweep.c = row[0:2], row[2:4], row[4:6]
        sweep.a0, sweep.a, sweep.alpha0 = row[6:9]
        state, time = Box2D.b2TimeOfImpact(
            shapeA=shape, idxA=0, shapeB=MOVING[sweeps.moving[i]], idxB=0, sweepA=still, sweepB=sweep, tMax=1.0
        )
        if state == Box2D.b2TOIOutput.e_touching:
            touches[i], times[i] = True, time
    return touches, times


def _native(sweeps: Sweeps) -> tuple[npt.NDArray[np.bool_], Floats]:
    ffi, library = _ffi(), _library()
    count = sweeps.ground.shape[1]
    ground = ffi.from_buffer("struct vec[]", sweeps.ground)
    motions = ffi.from_buffer("struct sweep[]", sweeps.sweep)
    times = np.zeros(len(sweeps.moving), np.float32)
    time = ffi.from_buffer("float[]", times)
    touches = [
        library.time_of_impact(ground + count * i, count, _polygon(index), motions + i, time + i)
        for i, index in enumerate(sweeps.moving.tolist())
    ]
    return np.array(touches), times


def _possible(sweeps: Sweeps, edges: bool) -> npt.NDArray[np.bool_]:
    """What the quick test says of the whole ground, or of the side that was aimed at as an edge."""
    ffi, library = _ffi(), _library()
    count = sweeps.ground.shape[1]
    start, end = sweeps.poses(0.0), sweeps.poses(1.0)
    ground = ffi.from_buffer("struct vec[]", sweeps.ground)
    sides = ffi.from_buffer("struct edge[]", sweeps.edges)
    starts, ends = ffi.from_buffer("struct pose[]", start), ffi.from_buffer("struct pose[]", end)
    turns = (sweeps.sweep[:, 7] - sweeps.sweep[:, 6]).tolist()
    result = []
    for i, (index, turn) in enumerate(zip(sweeps.moving.tolist(), turns, strict=True)):
        if edges:
            answer = library.impact_possible_edge(sides + i, _polygon(index), starts + i, ends + i, turn)
        else:
            answer = library.impact_possible(ground + count * i, count, _polygon(index), starts + i, ends + i, turn)
        result.append(answer)
    return np.array(result)


def _gaps(points: Doubles, sides: Doubles) -> Doubles:
    """Least distances, (cases), of points (cases, n, 2) from the sides of polygons or segments (cases, m, 2)."""
    a = sides[:, None]
    along = np.roll(sides, -1, axis=1)[:, None] - a
    from_a = points[:, :, None] - a
    share = np.clip((from_a * along).sum(axis=3) / (along * along).sum(axis=3), 0, 1)
    away = from_a - share[..., None] * along
    gaps: Doubles = np.sqrt((away * away).sum(axis=3)).min(axis=(1, 2))
    return gaps


def _nearest(sweeps: Sweeps, ground: Floats, index: int) -> Doubles:
    """The least distance during each sweep of one moving shape, in double precision, where the shapes do not cross."""
    vertices = np.array(MOVING[index].vertices, np.float64)
    motion = sweeps.sweep.astype(np.float64)
    still = ground.astype(np.float64)
    nearest = np.full(len(motion), np.inf)
    for time in np.linspace(0, 1, 33):
        center, angle = _at(motion, time)
        body = _rotate(angle[:, None], vertices - motion[:, None, 0:2]) + center[:, None]
        nearest = np.minimum(nearest, np.minimum(_gaps(still, body), _gaps(body, still)))
    return nearest


@pytest.mark.parametrize("box", [False, True], ids=["edge", "box"])
@pytest.mark.parametrize("kind", KINDS)
def test_touching_and_its_time_are_box2ds_to_the_bit(kind: str, box: bool) -> None:
    touches, times = _native(_sweeps(kind, box))
    expected_touches, expected_times = _box2d(kind, box)
    assert np.array_equal(touches, expected_touches)
    assert np.array_equal(times.view(np.uint32), expected_times.view(np.uint32))
    assert 50 < touches.sum() < CASES - 500


def test_a_time_that_is_not_found_is_not_written() -> None:
    ffi = _ffi()
    vertices = ffi.new("struct vec[]", [(0, 0), (1, 0)])
    sweep = ffi.new("struct sweep *", [(0, 0), (0, 9), (1, 8), 0, 1, 0])
    time = ffi.new("float *", 7)
    assert not _library().time_of_impact(vertices, 2, _polygon(0), sweep, time)
    assert time[0] == 7


@pytest.mark.parametrize("box", [False, True], ids=["edge", "box"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_impact_is_ruled_out(kind: str, box: bool) -> None:
    touches, _ = _box2d(kind, box)
    sweeps = _sweeps(kind, box)
    assert _possible(sweeps, edges=False)[touches].all()
    if not box:
        assert _possible(sweeps, edges=True)[touches].all()


@pytest.mark.parametrize("edges", [False, True], ids=["polygon", "edge"])
@pytest.mark.parametrize("box", [False, True], ids=["edge", "box"])
@pytest.mark.parametrize("kind", ["resting", "grazing", "rotating", "threshold"])
def test_what_is_ruled_out_keeps_its_distance(kind: str, box: bool, edges: bool) -> None:
    """Stronger than the agreement with Box2D, which may look past a near miss in the middle of a sweep."""
    sweeps = _sweeps(kind, box)
    ground = sweeps.edges[:, :4].reshape(-1, 2, 2) if edges else sweeps.ground
    out = ~_possible(sweeps, edges)
    ruled_out = 0
    for index in range(len(MOVING)):
        rows = out & (sweeps.moving == index)
        chosen = Sweeps(sweeps.ground[rows], sweeps.edges[rows], sweeps.moving[rows], sweeps.sweep[rows])
        nearest = _nearest(chosen, ground[rows], index)
        assert nearest.min() > TOUCHING + 0.0015
        ruled_out += len(nearest)
    assert ruled_out > 250


@pytest.mark.parametrize("box", [False, True], ids=["edge", "box"])
def test_nearly_all_bodies_at_rest_are_ruled_out(box: bool) -> None:
    """Box2D leaves what rests some 0.015 away from the ground."""
    sweeps = _sweeps("resting", box)
    for index in range(len(MOVING)):
        rows = sweeps.moving == index
        chosen = Sweeps(sweeps.ground[rows], sweeps.edges[rows], sweeps.moving[rows], sweeps.sweep[rows])
        nearest = _nearest(chosen, chosen.ground, index)
        resting = (nearest > 0.012) & (nearest < 0.018)
        assert resting.sum() > 250
        assert _possible(chosen, edges=not box)[resting].mean() < 0.02
