# SPDX-License-Identifier: MIT
"""The parts of the page: recordings, the drawing, charts, highlighting, the module for the browser."""

from __future__ import annotations

import base64
import html
import itertools
import json
import random
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bitneat.champion import EnvironmentSpec, load
from bitneat.cli.main import main
from bitneat.codegen import generate
from bitneat.controller import Constant, Controller, Signal
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.report.page.charts import Point, Series, front, lines, number, scatter, tick_step
from bitneat.report.page.graph import layout, spread
from bitneat.report.page.highlight import highlighted
from bitneat.report.page.history import MAX_DRAWN, History, history_charts, read_history
from bitneat.report.page.recording import ANGLE_STEPS, LENGTH_STEPS, encoded, record
from bitneat.report.page.tables import verify_facts
from bitneat.report.page.webassembly import compile_module, without_custom_sections
from bitneat.sim.environment import make
from bitneat.verify.wasm import MAGIC, read_wasm
from tests.report.page.pages import TINY, truth
from tests.strategies import random_controller
from tests.verify.champions import champion as random_champion

SEED = 127  # the walker falls after 284 steps


def test_a_recorded_episode_is_the_one_that_verify_sees() -> None:
    champion = load(TINY)
    assert champion.environment is not None
    (episode,) = record(champion.controller.canonical, champion.action, champion.environment, [SEED])
    expected = truth(champion, SEED)
    assert np.array_equal(episode.inputs, expected.inputs)
    assert np.array_equal(episode.outputs, expected.outputs)
    assert episode.reward == expected.reward
    assert episode.rewards[-1] == np.float32(expected.reward)


def test_recorded_poses_put_every_corner_where_box2d_has_it() -> None:
    champion = load(TINY)
    assert champion.environment is not None
    controller = champion.controller.canonical
    (episode,) = record(controller, champion.action, champion.environment, [SEED])
    assert episode.scene is not None
    assert episode.poses is not None
    environment = make(champion.environment)
    environment.reset(seed=SEED)
    world = environment.unwrapped
    worst = 0.0
    for step in range(episode.steps):
        if step % 40 == 0:
            for body, shape, (x, y, angle) in zip(
                [world.hull, *world.legs],  # type: ignore[attr-defined]
                episode.scene.shapes,
                episode.poses[step].reshape(-1, 3).tolist(),
                strict=True,
            ):
                turn = np.exp(1j * angle / ANGLE_STEPS)
                drawn = (x + 1j * y) / LENGTH_STEPS + turn * np.array([complex(*corner) for corner in shape])
                real = [complex(*(body.transform * corner)) for corner in body.fixtures[0].shape.vertices]
                worst = max(worst, float(np.abs(drawn - real).max()))
        environment.step(champion.action.decode(episode.outputs[step], controller.frac_bits))
    ground = [tuple(point) for point in episode.scene.ground]
    heights = zip(world.terrain_x, world.terrain_y, strict=True)  # type: ignore[attr-defined]
    assert ground == [(pytest.approx(x, abs=1e-4), pytest.approx(y, abs=1e-4)) for x, y in heights]
    assert 0 < worst < 0.004
    environment.close()


def test_obstacles_are_recorded_where_there_are_some() -> None:
    champion = load(TINY)
    for name, some in (("BipedalWalker-v3", False), ("BipedalWalkerHardcore-v3", True)):
        spec = EnvironmentSpec(name)
        (episode,) = record(champion.controller.canonical, champion.action, spec, [1], max_steps=2)
        assert episode.scene is not None
        assert bool(episode.scene.obstacles) == some
        assert episode.steps == 2


def test_arrays_are_little_endian_whatever_the_machine_is() -> None:
    assert base64.b64decode(encoded(np.array([1, -2], dtype=">i2"), "<i2")) == b"\x01\x00\xfe\xff"


@given(
    st.lists(st.floats(-50, 150), min_size=1, max_size=6).map(sorted),
    st.lists(st.floats(1, 8), min_size=6, max_size=6),
)
def test_boxes_are_spread_without_overlap_and_no_other_way_is_nearer(wanted: list[float], sizes: list[float]) -> None:
    sizes = sizes[: len(wanted)]
    places = spread(wanted, sizes, 0.0, 60.0)

    def fits(candidate: list[float]) -> bool:
        edges = [(y - size / 2, y + size / 2) for y, size in zip(candidate, sizes, strict=True)]
        inside = edges[0][0] >= -1e-6 and edges[-1][1] <= 60 + 1e-6
        return inside and all(below[1] <= above[0] + 1e-6 for below, above in itertools.pairwise(edges))

    def cost(candidate: list[float]) -> float:
        return sum((y - want) ** 2 for y, want in zip(candidate, wanted, strict=True))

    assert fits(places)
    rng = random.Random(1)
    for _ in range(60):
        other = [y + rng.gauss(0, 1) * rng.choice((0, 0, 0.1, 3)) for y in places]
        assert not fits(other) or cost(other) >= cost(places) - 1e-6


@pytest.mark.parametrize("seed", range(25))
def test_the_drawing_has_each_link_once_and_no_box_on_another(seed: int) -> None:
    controller = random_controller(random.Random(seed)).canonical
    names = [f"in {i}" for i in range(len(controller.inputs))]
    graph = layout(controller, names, [f"out {i}" for i in range(len(controller.outputs))])
    boxes = [*graph.inputs, *graph.nodes, *graph.outputs]
    for one, other in itertools.combinations(boxes, 2):
        apart_x = one.x + one.width <= other.x or other.x + other.width <= one.x
        assert apart_x or abs(one.y - other.y) >= (one.height + other.height) / 2 - 0.11
    assert all(box.y - box.height / 2 >= 0 and box.y + box.height / 2 <= graph.height for box in boxes)
    drawn = [(c.source, c.target, c.sign, c.shift, c.delay) for c in graph.curves if c.sign]
    expected = [
        (link.source, f"n{index}", link.sign, link.shift, link.delay)
        for index, node in enumerate(controller.nodes)
        for link in node.links
    ]
    assert sorted(drawn) == sorted(expected)
    wires = {(c.source, c.target) for c in graph.curves if not c.sign}
    assert wires == {(o.index, f"y{i}") for i, o in enumerate(controller.outputs) if isinstance(o, Signal)}
    places = {box.signal: box.x for box in [*graph.inputs, *graph.nodes]}
    by_key = {box.key: box for box in boxes}
    assert all(c.delay or places[c.source] < by_key[c.target].x for c in graph.curves)
    assert set(graph.unread) == {name for i, name in enumerate(names) if f"x{i}" not in by_key}


def test_an_input_is_as_wide_as_its_name_needs() -> None:
    controller = load(TINY).controller.canonical
    names = [f"input {i}" for i in range(24)]
    pins = ["a", "b", "c", "d"]
    usual = layout(controller, names, pins)
    unread = [*names[:1], "the first unread one, of many letters", *names[2:]]
    assert layout(controller, unread, pins).inputs == usual.inputs
    wide = layout(controller, ["right leg contact, and more", *names[1:]], pins)
    grown = wide.inputs[0].width - usual.inputs[0].width
    assert grown > 60
    assert wide.width == usual.width + grown
    assert {box.x - grown for box in wide.nodes} == {box.x for box in usual.nodes}


def test_a_controller_of_constants_is_drawn_too() -> None:
    graph = layout(Controller(load(TINY).controller.inputs, (), (Constant(3), Signal(2))), ["x"] * 24, ["a", "b"])
    assert [box.signal for box in graph.outputs] == [None, 2]


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=2, max_size=12))
def test_the_front_is_what_nothing_else_beats(pairs: list[tuple[int, int]]) -> None:
    points = [Point(f"{i}", x, y) for i, (x, y) in enumerate(pairs)]
    beaten = {(a.x, a.y) for a in points for b in points if (b.x <= a.x and b.y >= a.y) and (b.x, b.y) != (a.x, a.y)}
    assert {(p.x, p.y) for p in front(points)} == {(p.x, p.y) for p in points} - beaten
    chart = scatter("k", "t", ("x", "y"), points)
    assert chart is not None
    assert all(chart.left <= dot.x <= chart.right and chart.top <= dot.y <= chart.bottom for dot in chart.dots)


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=30))
def test_lines_stay_inside_the_chart(values: list[float]) -> None:
    chart = lines("k", "t", ("x", "y"), range(len(values)), [Series("s", tuple(values), 1)])
    if all(value != value for value in values):
        assert chart is None
        return
    assert chart is not None
    places = re.findall(r"(-?[\d.e+-]+) (-?[\d.e+-]+)", chart.lines[0].path)
    assert len(places) == sum(value == value for value in values)
    for x, y in places:
        assert chart.left <= float(x) <= chart.right
        assert chart.top - 0.01 <= float(y) <= chart.bottom + 0.01
    assert len(chart.rows) == len(values)


@given(st.floats(1e-6, 1e9))
def test_an_axis_has_a_few_round_ticks(span: float) -> None:
    step = tick_step(span)
    assert 2 <= span / step <= 5.01
    assert float(f"{step:.0e}") == pytest.approx(step)


def test_numbers_are_short_and_have_a_real_minus() -> None:
    texts = [number(value) for value in (0.0, -3.0, 1234567.0, 312.756, 0.004567, float("nan"))]
    assert texts == ["0", "−3", "1,234,567", "312.8", "0.00457", "–"]


@pytest.mark.parametrize("style", ["unrolled", "table"])
def test_highlighting_changes_no_letter(style: str) -> None:
    source = generate(load(TINY).controller, "legs", style).source + '// <b> "a\\"b" &amp; </script>\n'  # type: ignore[arg-type]
    marked = str(highlighted(source))
    assert html.unescape(re.sub(r"</?span[^>]*>", "", marked)) == source
    assert "<b>" not in marked
    assert "</script>" not in marked
    for kind in ("comment", "number", "type", "directive", "string"):
        assert f'<span class="c-{kind}">' in marked


@pytest.mark.parametrize(("recurrent", "entry"), [(False, "step"), (True, "step"), (True, "run")])
def test_the_module_has_no_imports_and_nothing_but_code_and_data(recurrent: bool, entry: str) -> None:
    champion = random_champion("Pendulum-v1", seed=4, recurrent=recurrent)
    style = "table" if entry == "run" else "unrolled"
    code = generate(champion.controller, "legs", style, action=champion.action)  # type: ignore[arg-type]
    module = compile_module(code, entry)
    wasm = read_wasm(module.content)
    assert wasm.imports == ()
    assert {module.function, "bitneat_reset"} <= set(wasm.exports)
    assert module.stateful == recurrent
    assert b"/tmp" not in module.content
    assert b"producers" not in module.content
    assert compile_module(code, entry).content == module.content


def test_only_custom_sections_are_taken_out() -> None:
    custom = bytes([0, 5, 4]) + b"name"
    code = bytes([10, 0x81, 0x01]) + bytes(129)  # its length takes two bytes
    assert without_custom_sections(MAGIC + custom + code + custom) == MAGIC + code


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("history.csv", "a,b\n1\n", "line 2: expected 2 columns, got 1"),
        ("history.csv", "", "expected a table with a line of names"),
        ("history.csv", f"a\n{'1' * 200_000}\n", "damaged: field larger than field limit"),
        (
            "checkpoints/generation-000001.json",
            '{"search": {"candidates": [{"controller": CONTROLLER, "generation": Infinity, "rewards": [1]}]}}',
            "damaged: OverflowError",
        ),
        ("checkpoints/generation-000001.json", "{}", "damaged: KeyError"),
        ("checkpoints/generation-000001.json", "[", "damaged: not JSON"),
    ],
)
def test_a_damaged_run_is_an_error_in_one_line(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "checkpoints").mkdir()
    controller = json.dumps(load(TINY).controller.to_data())
    (tmp_path / name).write_text(content.replace("CONTROLLER", controller))
    with pytest.raises(BitneatError, match=re.escape(f"{tmp_path / name}: {message}")):
        read_history(tmp_path)


def test_the_front_of_a_polishing_run_is_read(tmp_path: Path) -> None:
    (tmp_path / "front.csv").write_text("packed_bytes,links,nodes,mean,worst\n33,26,6,312.5,200\n40,30,7,320,x\n")
    assert [(p.x, p.y) for p in read_history(tmp_path).points] == [(33, 312.5), (40, 320)]


def test_the_course_and_the_candidates_of_an_evolving_run_are_read(tmp_path: Path) -> None:
    evolve = ["evolve", "--env", "CartPole-v1", "--pop", "10", "--generations", "2", "--seed", "3", "--workers", "1"]
    assert main([*evolve, "-o", str(tmp_path / "run")]) == 0
    history = read_history(tmp_path / "run")
    assert history.columns["generation"] == (0.0, 1.0)
    assert [chart.key for chart in history_charts(history)] == ["fitness", "size"]
    champion = load(tmp_path / "run" / "champion.pkl")
    assert len(pack(champion.controller.canonical)) in {point.x for point in history.points}
    assert all(0 < point.y <= 500 for point in history.points)


@pytest.mark.parametrize("rewards", ["0,-1e20\n1,-1e20", "0,1e308\n1,-1e308", "x,1\n1,2", "0,1e14\n1,100000000000001"])
def test_numbers_that_no_axis_can_count_are_left_out(rewards: str, tmp_path: Path) -> None:
    (tmp_path / "history.csv").write_text(f"generation,best\n{rewards}\n")
    for chart in history_charts(read_history(tmp_path)):
        assert len(chart.y_ticks) < 20


def test_a_verdict_on_another_file_says_so() -> None:
    verdict = {"episodes": 1, "steps": 5, "environment": "CartPole-v1", "c_sha256": "ab" * 32}
    assert "another C file than the one below (SHA-256 abababababab)" in verify_facts(verdict, "cd" * 32)
    assert "another" not in verify_facts(verdict, "ab" * 32)


def test_a_long_history_is_drawn_with_fewer_points() -> None:
    values = tuple(float(value) for value in range(10_000))
    (chart,) = history_charts(History({"generation": values, "best": values}))
    assert 1000 <= len(chart.rows) <= MAX_DRAWN
