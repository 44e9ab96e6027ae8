# SPDX-License-Identifier: MIT
"""What the figure of a network shows of it."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings

from bitneat.champion import Champion, EnvironmentSpec, FloatChampion, load
from bitneat.controller import BoxAction, Constant, Controller, DiscreteAction, Input, Link, Node, Signal
from bitneat.errors import BitneatError
from bitneat.network import FloatNetwork, FloatNode
from bitneat.report.figure import BLUE, VERMILION
from bitneat.report.wiring import MAX_LINKS, network_figure, wiring
from bitneat.sim.environment import inspect
from bitneat.sim.names import input_names, output_names
from tests.strategies import controllers

BOX = BoxAction((-1.0,) * 3, (1.0,) * 3, (3,), "float32")
CONTROLLER = Controller(
    (Input(), Input(), Input()),
    (
        Node((Link(0), Link(1, 0, 0, -1), Link(4, 1)), 256, -3, "hat"),
        Node((Link(3), Link(4, 1)), -256, 2, "clamped"),
    ),
    (Signal(4), Constant(128), Signal(0)),
)


def texts(svg: bytes) -> str:
    """Matplotlib leaves each text as a comment beside its outlines."""
    return "\n".join(re.findall(r"<!-- (.*?) -->", svg.decode()))


def test_the_figure_names_inputs_activations_gains_biases_and_outputs() -> None:
    shown = texts(network_figure(Champion(CONTROLLER, BOX), "small", "svg"))
    for text in ("hat +1 ÷8", "clamped", "input 0", "input 1", "output 0", "output 1 = 0.5", "output 2"):
        assert text in shown
    assert "input 2" not in shown
    assert "inputs that are not read: 1" in shown
    assert "2 nodes, 5 links" in shown
    assert "value of the step before" in shown


def test_delayed_links_are_dashed_and_others_are_not() -> None:
    def dashes(controller: Controller) -> int:
        return network_figure(Champion(controller, BOX), "x", "svg").decode().count("stroke-dasharray")

    still = Controller(CONTROLLER.inputs, (Node((Link(0),)), Node((Link(3),))), CONTROLLER.outputs)
    assert dashes(still) == 0
    assert dashes(CONTROLLER) >= 2 + 1  # two links and the legend


def test_links_that_add_are_blue_and_those_that_subtract_vermilion() -> None:
    nodes = (Node((Link(0), Link(1), Link(2, 0, 0, -1))),)
    svg = network_figure(Champion(Controller(CONTROLLER.inputs, nodes, (Signal(3),) * 3), BOX), "x", "svg").decode()
    legend = 1
    assert svg.count(f"stroke: {BLUE.lower()}") == 2 + legend
    assert svg.count(f"stroke: {VERMILION.lower()}") == 1 + legend


@given(controllers(max_inputs=4, max_nodes=6))
def test_every_link_and_output_is_a_wire(controller: Controller) -> None:
    form = controller.canonical
    action = BoxAction((-1.0,) * len(form.outputs), (1.0,) * len(form.outputs), (len(form.outputs),), "float32")
    picture = wiring(Champion(controller, action))
    weights = sorted(wire.weight for wire in picture.wires if wire.weight is not None)
    assert weights == sorted(float(link.sign * 2**link.shift) for node in form.nodes for link in node.links)
    assert sum(wire.weight is None for wire in picture.wires) == sum(isinstance(o, Signal) for o in form.outputs)
    assert picture.num_nodes == len(form.nodes)
    for wire in picture.wires:
        assert wire.delayed or picture.is_forward(wire)
    last = max(picture.columns)
    assert all(column == last for column in picture.columns[picture.num_inputs + picture.num_nodes :])


@settings(max_examples=20)
@given(controllers(max_inputs=4, max_nodes=6))
def test_any_controller_can_be_drawn(controller: Controller) -> None:
    count = len(controller.outputs)
    action = BoxAction((-1.0,) * count, (1.0,) * count, (count,), "float32")
    assert network_figure(Champion(controller, action), "any", "svg").startswith(b"<?xml")


def test_a_float_network_is_drawn_with_the_width_of_its_weights() -> None:
    nodes = (FloatNode(((0, 2.0), (1, -0.5), (0, 0.0)), 0.25, 1.5, "tanh"),)
    champion = FloatChampion(FloatNetwork(2, nodes, (2,)), DiscreteAction(1), EnvironmentSpec("Pendulum-v1"))
    svg = network_figure(champion, "float", "svg")
    assert "tanh +0.25 \u00d71.5" in texts(svg)
    widths = {float(w) for w in re.findall(r"stroke-width: ([\d.]+)", svg.decode())}
    assert {2.3, 0.8} <= widths


def test_too_many_links_are_refused() -> None:
    row = tuple((i % 100, 1.0) for i in range(MAX_LINKS + 1))
    champion = FloatChampion(FloatNetwork(100, (FloatNode(row),), (100,)), DiscreteAction(1))
    with pytest.raises(BitneatError, match="5001 links are too many to draw"):
        network_figure(champion, "large", "svg")


@pytest.mark.parametrize(
    "name",
    [
        "BipedalWalker-v3", "BipedalWalkerHardcore-v3", "LunarLander-v3", "LunarLanderContinuous-v3", "CartPole-v1",
        "CartPole-v0", "Acrobot-v1", "Pendulum-v1", "MountainCar-v0", "MountainCarContinuous-v0",
    ],
)  # fmt: skip
def test_names_fit_the_environments(name: str) -> None:
    spec = EnvironmentSpec(name)
    info = inspect(spec)
    inputs, outputs = input_names(spec, info.num_inputs), output_names(spec, info.action.num_outputs)
    assert (len(inputs), len(outputs)) == (info.num_inputs, info.action.num_outputs)
    for names in (inputs, outputs):
        assert len(set(names)) == len(names)
        assert not any(text.startswith(("input ", "output ")) for text in names)


def test_the_walkers_contacts_are_where_the_names_say() -> None:
    names = input_names(EnvironmentSpec("BipedalWalker-v3"), 24)
    environment = gymnasium.make("BipedalWalker-v3")
    observation, _ = environment.reset(seed=1)
    seen = np.array([observation] + [environment.step(np.zeros(4))[0] for _ in range(60)])
    environment.close()
    two_valued = {names[i] for i in range(24) if set(seen[:, i]) == {0.0, 1.0}}
    assert two_valued == {"leg 1 contact", "leg 2 contact"}


def test_the_documents_figure_is_of_the_committed_champion() -> None:
    """If not: ``bitneat plot network examples/champions/tiny.pkl -o docs/network.svg``. Its bytes also depend on Matplotlib."""
    root = Path(__file__).resolve().parents[2]
    digest = load(root / "examples" / "champions" / "tiny.pkl").controller.sha256
    assert f"<dc:description>sha256 {digest}</dc:description>" in (root / "docs" / "network.svg").read_text()
