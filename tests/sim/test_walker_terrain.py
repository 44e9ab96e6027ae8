# SPDX-License-Identifier: MIT
"""The walker's ground in C against the world that Gymnasium builds, bit for bit, and the random numbers left behind."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import Box2D
import cffi
import gymnasium
import numpy as np
import numpy.typing as npt
import pytest
from gymnasium.utils import seeding

import bitneat.sim
from bitneat.native.build import shared_library

CSRC = Path(bitneat.sim.__file__).parent / "walker" / "csrc"
FLAGS = ("-std=gnu11", "-O3", "-march=native", "-ffp-contract=off")
SEEDS = 150
LENGTH = 200
WORD = 1 << 64

CDEF = """
struct vec { float x, y; };
struct rot { float s, c; };
struct pose { struct vec p; struct rot q; };
struct polygon { int32_t count; struct vec vertex[5]; struct vec normal[5]; struct vec centroid; };
struct edge { struct vec a, b, normal; };
struct pcg64 { uint64_t state[2], increment[2]; uint32_t has_uint32, uinteger; };
struct box { struct vec low, high; };
struct terrain {
    struct edge edge[199];
    struct box edge_fat[199];
    int32_t num_polygons;
    struct polygon polygon[64];
    struct box polygon_fat[64];
    float start_force;
};
void terrain_generate(struct terrain *ground, struct pcg64 *rng, bool hardcore);
void polygon_set(struct polygon *shape, const struct vec *points, int32_t count);
struct box polygon_bounds(const struct polygon *shape, const struct pose *pose);
"""

Bits = npt.NDArray[np.uint32]
State = Mapping[str, Any]


@cache
def _ffi() -> Any:
    ffi = cffi.FFI()
    ffi.cdef(CDEF)
    return ffi


@cache
def _library() -> Any:
    path = shared_library([CSRC / "terrain.c"], name="walker-terrain", flags=FLAGS)
    return _ffi().dlopen(str(path))


class _Boxes(Box2D.b2Draw):  # type: ignore[misc]
    """Collects the boxes of the broad phase, which nothing but the debugging view shows."""

    def __init__(self) -> None:
        super().__init__()
        self.boxes: list[Any] = []
        self.flags = {"drawAABBs": True}

    def DrawPolygon(self, vertices: Any, color: Any) -> None:  # noqa: N802 - Box2D calls it
        self.boxes.append((vertices[0], vertices[2]))


class _Original:
    """Gymnasium's environment, opened for inspection."""

    def __init__(self, hardcore: bool) -> None:
        unwrapped: Any = gymnasium.make("BipedalWalker-v3", hardcore=hardcore).unwrapped
        self.env = unwrapped
        self.draw = _Boxes()
        self.env.world.renderer = self.draw
        self.forces: list[float] = []

    def boxes(self) -> list[Any]:
        """The static bodies' boxes, in the order of the bodies' creation; the walker's five bodies are the newest."""
        self.draw.boxes.clear()
        self.env.world.DrawDebugData()
        return self.draw.boxes[:4:-1]

    def shapes(self) -> list[Any]:
        return [body.fixtures[0].shape for body in reversed(self.env.terrain)]


@pytest.fixture(scope="module", params=[False, True], ids=["normal", "hardcore"])
def original(request: pytest.FixtureRequest) -> Iterator[_Original]:
    result = _Original(request.param)
    with pytest.MonkeyPatch.context() as patch:
        apply = Box2D.b2Body.ApplyForceToCenter

        def recorded(body: Any, force: Any, wake: bool) -> None:
            assert force[1] == 0
            result.forces.append(force[0])
            apply(body, force, wake)

        patch.setattr(Box2D.b2Body, "ApplyForceToCenter", recorded)
        yield result
    result.env.close()


def _generate(state: State, hardcore: bool) -> tuple[Any, State]:
    """The C's ground for a bit generator's state, and the state after it."""
    ffi = _ffi()
    numbers = state["state"]
    rng = ffi.new(
        "struct pcg64 *",
        {
            "state": divmod(numbers["state"], WORD),
            "increment": divmod(numbers["inc"], WORD),
            "has_uint32": state["has_uint32"],
            "uinteger": state["uinteger"],
        },
    )
    ground = ffi.new("struct terrain *")
    ffi.memmove(ground, b"\xa5" * ffi.sizeof(ground[0]), ffi.sizeof(ground[0]))  # nothing may rest on zeros
    _library().terrain_generate(ground, rng, hardcore)
    after = {
        "bit_generator": "PCG64",
        "state": {
            "state": rng.state[0] * WORD + rng.state[1],
            "inc": rng.increment[0] * WORD + rng.increment[1],
        },
        "has_uint32": rng.has_uint32,
        "uinteger": rng.uinteger,
    }
    return ground, after


def _bits(values: Any) -> Bits:
    """A nest of numbers that came from float32, as the bits: minus zero is not zero here."""
    return np.array(values, np.float64).astype(np.float32).view(np.uint32)


def _same(ours: Any, theirs: Any) -> None:
    np.testing.assert_array_equal(_bits(ours), _bits(theirs))


def _points(vectors: Any, count: int) -> list[tuple[float, float]]:
    return [(v.x, v.y) for v in itertools.islice(vectors, count)]


def _box(box: Any) -> list[tuple[float, float]]:
    return _points([box.low, box.high], 2)


def _check_polygon(ours: Any, theirs: Any) -> None:
    assert ours.count == theirs.vertexCount
    _same(_points(ours.vertex, ours.count), theirs.vertices)
    _same(_points(ours.normal, ours.count), theirs.normals)
    _same((ours.centroid.x, ours.centroid.y), tuple(theirs.centroid))


def _edge_normals(ends: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    along = ends[:, 1] - ends[:, 0]
    length = np.sqrt(along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1])
    assert length.dtype == np.float32
    along *= (np.float32(1) / length)[:, None]
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _check_ground(state: State, original: _Original) -> int:
    """Compare the C with the episode that has just begun from ``state``; return the number of polygons."""
    ground, after = _generate(state, original.env.hardcore)
    assert after == original.env.np_random.bit_generator.state
    shapes, boxes = original.shapes(), original.boxes()
    polygons = shapes[: len(shapes) - LENGTH + 1]
    count: int = ground.num_polygons
    assert count == len(polygons)
    for index, shape in enumerate(polygons):
        assert isinstance(shape, Box2D.b2PolygonShape)
        _check_polygon(ground.polygon[index], shape)
    ends = [shape.vertices for shape in shapes[count:]]
    edges = ground.edge
    _same([_points([edge.a, edge.b], 2) for edge in edges], ends)
    _same(_points([edge.normal for edge in edges], LENGTH), _edge_normals(np.array(ends, np.float32)))
    fat = [*itertools.islice(ground.polygon_fat, count), *ground.edge_fat]
    _same([_box(box) for box in fat], boxes)
    _same(ground.start_force, original.forces[-1])
    return count


def test_ground_of_seeds_is_gymnasiums(original: _Original) -> None:
    original.forces.clear()
    counts = []
    for seed in range(SEEDS):
        state = seeding.np_random(seed)[0].bit_generator.state
        original.env.reset(seed=seed)
        counts.append(_check_ground(state, original))
    assert len(set(original.forces)) == len(original.forces) == SEEDS
    if original.env.hardcore:
        assert min(counts) > 8
        assert max(counts) > 24
    else:
        assert set(counts) == {0}


def test_ground_of_episodes_that_follow_each_other_is_gymnasiums(original: _Original) -> None:
    """Later episodes go on with the generator of the one before, half a number kept included."""
    original.env.reset(seed=2**40 + 7)
    kept = set()
    for _ in range(25):
        state = original.env.np_random.bit_generator.state
        kept.add(state["has_uint32"])
        original.env.reset()
        _check_ground(state, original)
    assert kept == {0, 1}


@pytest.mark.parametrize("half", [0, 1, 0x33333334, 2**32 - 1])
def test_integers_that_would_favour_some_results_are_drawn_again(original: _Original, half: int) -> None:
    """The first of them is one of five, which 2**32 is not a multiple of: a kept half of zero must be thrown away."""
    for seed in range(5):
        original.env.reset(seed=seed)
        state = original.env.np_random.bit_generator.state
        state["has_uint32"], state["uinteger"] = 1, half
        original.env.np_random.bit_generator.state = state
        original.env.reset()
        _check_ground(state, original)


def _make_polygon(points: list[tuple[float, float]]) -> Any:
    shape = _ffi().new("struct polygon *")
    _library().polygon_set(shape, _ffi().new("struct vec[]", points), len(points))
    return shape


def _random_points(rng: random.Random) -> list[tuple[float, float]]:
    """Three to five points that span an area, with right angles, points on a side and points inside among them."""
    while True:
        count = rng.randint(3, 5)
        if rng.random() < 0.5:
            points = [(rng.randint(-2, 2) / 2, rng.randint(-2, 2) / 2) for _ in range(count)]
        else:
            points = [(rng.uniform(-90, 90), rng.uniform(-9, 9)) for _ in range(count)]
        (x0, y0), *rest = points
        turns = [
            (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0) for (x1, y1), (x2, y2) in itertools.combinations(rest, 2)
        ]
        if len(set(points)) == count and max(map(abs, turns)) > 0.01:
            return points


def test_polygons_and_their_bounds_are_box2ds() -> None:
    ffi, rng = _ffi(), random.Random(5)
    hull = [(x / 30.0, y / 30.0) for x, y in [(-30, 9), (6, 9), (34, 1), (34, -8), (-30, -8)]]
    for points in [hull, *(_random_points(rng) for _ in range(2000))]:
        ours, theirs = _make_polygon(points), Box2D.b2PolygonShape(vertices=points)
        _check_polygon(ours, theirs)
        transform = Box2D.b2Transform()
        transform.position = (rng.uniform(-90, 90), rng.uniform(-9, 9))
        transform.angle = rng.uniform(-math.pi, math.pi)
        place = {"p": tuple(transform.position), "q": (transform.q.s, transform.q.c)}
        for pose in (ffi.new("struct pose *", place), ffi.NULL):
            if pose == ffi.NULL:
                transform.SetIdentity()
            box = theirs.getAABB(transform, 0)
            _same(_box(_library().polygon_bounds(ours, pose)), [tuple(box.lowerBound), tuple(box.upperBound)])
