# SPDX-License-Identifier: MIT
"""Contacts of the walker's polygons with the ground in C against Box2D's own functions, bit for bit.

Only the sign of a zero may differ: the ground's pose, which the C leaves out, makes some of Box2D's zeros positive.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import Box2D
import cffi
import gymnasium
import numpy as np
import pytest
from gymnasium.envs.box2d import bipedal_walker

import bitneat.sim
from bitneat.native.build import shared_library

CSRC = Path(bitneat.sim.__file__).parent / "walker" / "csrc"
FLAGS = ("-std=gnu11", "-O3", "-march=native", "-ffp-contract=off")
STEP = bipedal_walker.TERRAIN_STEP
LEVEL = bipedal_walker.TERRAIN_LENGTH - 1
"""How many bodies of the ground, the first in Gymnasium's list, are edges; the others are the obstacles' polygons."""
SHAPES = 300
POSES = 250

CDEF = """
struct vec { float x, y; };
struct rot { float s, c; };
struct pose { struct vec p; struct rot q; };
struct polygon { int32_t count; struct vec vertex[5]; struct vec normal[5]; struct vec centroid; };
struct edge { struct vec a, b, normal; };
struct manifold_point { struct vec local; float normal_impulse, tangent_impulse; uint32_t id; };
struct manifold {
    int kind; /* enum manifold_kind */
    int32_t count;
    struct vec local_normal, local_point;
    struct manifold_point point[2];
};
void collide_edge(struct manifold *m, const struct edge *a, const struct polygon *b, const struct pose *pose);
void collide_polygon(struct manifold *m, const struct polygon *a, const struct polygon *b, const struct pose *pose);
"""

Contact = tuple[Any, ...]
"""A manifold's values: the number of points and, unless that is 0, whose face, its normal, its point, and the points."""


@cache
def _ffi() -> Any:
    ffi = cffi.FFI()
    ffi.cdef(CDEF)
    return ffi


@cache
def _library() -> Any:
    path = shared_library([CSRC / "collide.c"], name="walker-collide", flags=FLAGS)
    return _ffi().dlopen(str(path))


def _is_edge(shape: Any) -> bool:
    return isinstance(shape, Box2D.b2EdgeShape)


def _shape(shape: Any) -> Any:
    """The C's form of a shape."""
    if _is_edge(shape):
        a, b = (np.array(vertex, np.float32) for vertex in shape.vertices)
        side = b - a
        side *= np.float32(1) / np.sqrt(side[0] * side[0] + side[1] * side[1])
        normal = (float(side[1]), -float(side[0]))
        return _ffi().new("struct edge *", (tuple(map(float, a)), tuple(map(float, b)), normal))
    vertices = [tuple(vertex) for vertex in shape.vertices]
    normals = [tuple(normal) for normal in shape.normals]
    return _ffi().new("struct polygon *", (len(vertices), vertices, normals, tuple(shape.centroid)))


def _pose(transform: Any) -> Any:
    position, rotation = transform.position, transform.q
    return _ffi().new("struct pose *", ((position.x, position.y), (rotation.s, rotation.c)))


def _ours(a: Any, b: Any, pose: Any, *, edge: bool) -> Contact:
    m = _ffi().new("struct manifold *")
    _ffi().buffer(m)[:] = b"\xa5" * _ffi().sizeof("struct manifold")
    (_library().collide_edge if edge else _library().collide_polygon)(m, a, b, pose)
    if m.count == 0:
        return (0,)
    normal, point = m.local_normal, m.local_point
    return (
        m.count,
        "AB"[m.kind],
        (normal.x, normal.y),
        (point.x, point.y),
        *((p.local.x, p.local.y, p.id) for p in m.point[0 : m.count]),
    )


def _theirs(m: Any) -> Contact:
    if m.pointCount == 0:
        return (0,)
    normal, point = m.localNormal, m.localPoint
    points = []
    for p in m.points:
        feature = p.id.cf
        number = feature.indexA | feature.indexB << 8 | feature.typeA << 16 | feature.typeB << 24
        points.append((p.localPoint.x, p.localPoint.y, number))
    kind = {Box2D.b2Manifold.e_faceA: "A", Box2D.b2Manifold.e_faceB: "B"}[m.type_]
    return (m.pointCount, kind, (normal.x, normal.y), (point.x, point.y), *points)


def _asked(a: Any, at_a: Any, b: Any, at_b: Any) -> Contact:
    """What Box2D's function computes for two shapes, whatever a world would do with them."""
    m = Box2D.b2Manifold()
    (Box2D.b2CollideEdgeAndPolygon if _is_edge(a) else Box2D.b2CollidePolygons)(m, a, at_a, b, at_b)
    return _theirs(m)


def _walker() -> list[Any]:
    return [definition.shape for definition in (bipedal_walker.HULL_FD, bipedal_walker.LEG_FD, bipedal_walker.LOWER_FD)]


@cache
def _ground() -> list[Any]:
    """The shapes of some hardcore courses, copied out of their worlds."""
    shapes = []
    env = gymnasium.make("BipedalWalker-v3", hardcore=True)
    for seed in range(4):
        env.reset(seed=seed)
        unwrapped: Any = env.unwrapped
        for body in unwrapped.terrain:
            shape = body.fixtures[0].shape
            shapes.append(type(shape)(vertices=shape.vertices))
    env.close()
    return shapes


def _edges(rng: random.Random) -> Iterator[Any]:
    """Half from courses, half made up: level, gentle, steep, backwards, upright and very short ones."""
    courses = [shape for shape in _ground() if _is_edge(shape)]
    for _ in range(SHAPES // 2):
        yield rng.choice(courses)
        x, y = rng.uniform(0, 90), rng.uniform(0, 12)
        run, rise = rng.choice(
            [
                (STEP, 0),
                (STEP, rng.gauss(0, 0.1)),
                (STEP, rng.gauss(0, 2)),
                (-STEP, rng.gauss(0, 1)),
                (0, 2),
                (0.01, 0.02),
            ]
        )
        yield Box2D.b2EdgeShape(vertices=[(x, y), (x + run, y + rise)])


def _boxes(rng: random.Random) -> Iterator[Any]:
    courses = [shape for shape in _ground() if not _is_edge(shape)]
    for _ in range(SHAPES):
        yield rng.choice(courses)


def _on_outline(rng: random.Random, vertices: list[tuple[float, float]]) -> tuple[float, float]:
    """A corner or a point of a side."""
    i = rng.randrange(len(vertices))
    t = rng.choice([0, rng.random()])
    (x0, y0), (x1, y1) = vertices[i], vertices[(i + 1) % len(vertices)]
    return x0 + t * (x1 - x0), y0 + t * (y1 - y0)


def _placements(rng: random.Random, ground: Any, part: Any) -> Iterator[Any]:
    """Transforms that put a point of the part on the ground's outline, more or less: contacts, grazes, and near misses.

    Turned in any way, often by a multiple of half a right angle, where ties are; with some, one is deep in the other.
    """
    transform = Box2D.b2Transform()
    for _ in range(POSES):
        eighth = math.pi / 4 * rng.randint(-8, 8)
        angle = rng.choice([eighth, rng.gauss(eighth, 1e-3), rng.uniform(-1, 1), rng.uniform(-7, 7)])
        target = _on_outline(rng, list(ground.vertices))
        own = (0.0, 0.0) if rng.random() < 0.1 else _on_outline(rng, list(part.vertices))
        transform.Set((0, 0), angle)
        s, c = transform.q.s, transform.q.c
        spread = rng.choice([0, 1e-4, 0.03, 0.03, 0.3])
        x = target[0] - (c * own[0] - s * own[1]) + rng.uniform(-spread, spread)
        y = target[1] - (s * own[0] + c * own[1]) + rng.uniform(-spread, spread)
        transform.Set((x, y), angle)
        yield transform


def _check_placements(rng: random.Random, grounds: Iterable[Any]) -> Counter[Contact]:
    """Compare many placements; how often each kind of contact was seen."""
    seen: Counter[Contact] = Counter()
    origin = Box2D.b2Transform()
    origin.SetIdentity()
    parts = [(part, _shape(part)) for part in _walker()]
    for ground in grounds:
        a = _shape(ground)
        part, b = rng.choice(parts)
        for transform in _placements(rng, ground, part):
            expected = _asked(ground, origin, part, transform)
            assert _ours(a, b, _pose(transform), edge=_is_edge(ground)) == expected, (ground, part, transform)
            seen[expected[:2]] += 1
    return seen


@pytest.mark.parametrize("grounds", [_edges, _boxes])
def test_shapes_anyhow_placed(grounds: Any) -> None:
    rng = random.Random(1)
    seen = _check_placements(rng, grounds(rng))
    assert seen.total() == SHAPES * POSES
    assert set(seen) == {(0,), (1, "A"), (2, "A"), (1, "B"), (2, "B")}
    assert min(seen.values()) > 2000


class _Recorder(bipedal_walker.ContactDetector):
    """Compares a world's manifolds as they arise: at a step's start, and at impacts within it."""

    seen: Counter[Contact]
    wrong: list[Any]

    def PreSolve(self, contact: Any, old: Any) -> None:  # noqa: N802 - Box2D calls it
        # An exception would not get past Box2D: the test asks for what was wrong.
        a, b = contact.fixtureA, contact.fixtureB
        expected = _theirs(contact.manifold)
        ours = _ours(_shape(a.shape), _shape(b.shape), _pose(b.body.transform), edge=_is_edge(a.shape))
        self.seen[(type(a.shape).__name__, *expected[:2])] += 1
        if ours != expected:
            self.wrong.append((ours, expected))


def _play(hardcore: bool, seed: int) -> Iterator[Any]:
    """An episode's states; on a hard course, with leaps from obstacle to obstacle, which no random walker would reach.

    The environment is a new one: after a reset, a part of the walker may be the first of a pair of polygons.
    """
    env = gymnasium.make("BipedalWalker-v3", hardcore=hardcore)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    unwrapped: Any = env.unwrapped
    corners = [max(map(tuple, body.fixtures[0].shape.vertices), key=lambda v: v[1]) for body in unwrapped.terrain]
    rng = random.Random(seed)
    for i in range(160):
        if hardcore and i % 20 == 0:
            x, y = rng.choice(corners[LEVEL:])
            x, y = x - unwrapped.hull.position.x + rng.uniform(-1, 1), y - unwrapped.hull.position.y + 1.9
            for body in [unwrapped.hull, *unwrapped.legs]:
                body.position = (body.position.x + x, body.position.y + y)
        if env.step(env.action_space.sample())[2] and not hardcore:
            break
        yield unwrapped
    env.close()


@pytest.mark.filterwarnings("ignore:.*already returned terminated")
@pytest.mark.parametrize(("hardcore", "shape"), [(False, "b2EdgeShape"), (True, "b2PolygonShape")])
def test_contacts_of_episodes(hardcore: bool, shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Recorder, "seen", Counter(), raising=False)
    monkeypatch.setattr(_Recorder, "wrong", [], raising=False)
    monkeypatch.setattr(bipedal_walker, "ContactDetector", _Recorder)
    apart = 0
    for seed in range(12):
        for env in _play(hardcore, seed):
            for contact in env.world.contacts:
                a, b = contact.fixtureA, contact.fixtureB
                expected = _asked(a.shape, a.body.transform, b.shape, b.body.transform)
                pose = _pose(b.body.transform)
                assert _ours(_shape(a.shape), _shape(b.shape), pose, edge=_is_edge(a.shape)) == expected
                apart += expected == (0,)
    assert not _Recorder.wrong
    assert apart > 1000
    assert _Recorder.seen[shape, 1, "A"] > 20
    assert _Recorder.seen[shape, 2, "A"] + _Recorder.seen[shape, 2, "B"] > 5
