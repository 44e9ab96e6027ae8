# SPDX-License-Identifier: MIT
"""Float networks: neat-python's own numbers, the C side's too, and files that hold what they should."""

from __future__ import annotations

import math
import random
from pathlib import Path

import numpy as np
import pytest
from neat.activations import ActivationFunctionSet
from neat.nn import FeedForwardNetwork

from bitneat.champion import EnvironmentSpec, FloatChampion, load, load_any, save_json, save_pickle
from bitneat.cli.main import main
from bitneat.controller import BoxAction, DiscreteAction
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.network import ACTIVATIONS, FloatNetwork, FloatNode, NetworkError, decode, network_from_data
from bitneat.sim.environment import Shaping, inspect
from bitneat.sim.walker.binding import ffi, library
from bitneat.sim.walker.episodes import network_struct

WALKER = EnvironmentSpec("BipedalWalker-v3")
BOX = BoxAction((-1.0,) * 4, (1.0,) * 4, (4,), "float32")


def some_network(seed: int, num_inputs: int = 24, num_outputs: int = 4, spread: float = 1.0) -> FloatNetwork:
    """A random network of every activation; weights of any size with ``spread``."""
    rng = random.Random(seed)
    nodes = []
    for index in range(rng.randint(num_outputs, 14)):
        sources = rng.sample(range(num_inputs + index), rng.randint(0, min(num_inputs + index, 12)))
        links = tuple((source, rng.gauss(0, spread)) for source in sources)
        nodes.append(FloatNode(links, rng.gauss(0, 1), rng.choice([1.0, 0.5, -3.0]), rng.choice(list(ACTIVATIONS))))
    last = num_inputs + len(nodes)
    return FloatNetwork(num_inputs, tuple(nodes), tuple(range(last - num_outputs, last)))


def in_neat_python(network: FloatNetwork) -> FeedForwardNetwork:
    """The same network behind neat-python's own evaluator."""
    functions = ActivationFunctionSet()
    known = {name: functions.get(name) for name in ACTIVATIONS if name != "step"}
    known["step"] = ACTIVATIONS["step"]  # the one that neat-python lacks
    evaluations = [
        (network.num_inputs + i, known[n.activation], sum, n.bias, n.response, list(n.links))
        for i, n in enumerate(network.nodes)
    ]
    return FeedForwardNetwork(list(range(network.num_inputs)), list(network.outputs), evaluations)


@pytest.mark.parametrize("seed", range(60))
def test_a_network_computes_what_neat_python_does(seed: int) -> None:
    network = some_network(seed, spread=4.0)
    theirs = in_neat_python(network)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        observation = rng.normal(0, 3, 24).tolist()
        # Python's own sum compensates from 3.12 on, which may move a last bit.
        assert network.step(observation) == pytest.approx(theirs.activate(observation), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_the_native_activations_are_pythons_to_the_bit(name: str) -> None:
    network = FloatNetwork(1, (FloatNode(((0, 1.0),), 0.0, 1.0, name),), (1,))
    struct = network_struct(network)
    signals, outputs = ffi().new("double[2]"), ffi().new("double[1]")
    rng = np.random.default_rng(3)
    values = [*rng.normal(0, 2, 3000), *rng.normal(0, 100, 500), 0.0, -0.0, 1e300, -1e300, 5e-324, math.inf, -math.inf]
    for value in map(float, values):
        signals[0] = value
        library().network_step(struct.pointer, signals, outputs)
        expected = network.step([value])[0]
        assert (outputs[0], math.copysign(1, outputs[0])) == (expected, math.copysign(1, expected)), value


def test_the_native_walker_gives_gymnasiums_episodes_for_networks() -> None:
    networks = [some_network(seed, spread=1.0) for seed in range(12)]
    shaping = Shaping(fall_reward=-100.0, fall_value=-7.0, max_steps=150, stall_steps=60, stall_gain=0.5)
    action = inspect(WALKER).action
    for spec in (WALKER, EnvironmentSpec("BipedalWalkerHardcore-v3")):
        native = NativeWalkerEvaluator(spec, 1600, 2).evaluate(networks, [5, 6], shaping)
        gymnasium = GymnasiumEvaluator(spec, action, 1600, 1, "gymnasium").evaluate(networks, [5, 6], shaping)
        assert native == gymnasium
        assert len({episode.reward for row in native for episode in row}) > 12  # they do different things


def test_a_whole_episode_of_a_network_that_stands_is_gymnasiums() -> None:
    still = FloatNetwork(24, tuple(FloatNode((), 0.0) for _ in range(4)), (24, 25, 26, 27))
    native = NativeWalkerEvaluator(WALKER, 1600, 1).evaluate([still], [3])
    assert native == GymnasiumEvaluator(WALKER, BOX, 1600, 1, "gymnasium").evaluate([still], [3])


def test_an_output_that_is_no_number_counts_as_one() -> None:
    assert decode(BOX, [math.nan, 0.5, math.inf, -math.inf]).tolist() == [1.0, 0.5, 1.0, -1.0]  # type: ignore[union-attr]


def test_discrete_actions_take_the_first_of_the_largest() -> None:
    assert decode(DiscreteAction(3, start=2), [0.5, 0.75, 0.75]) == 3


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (lambda: FloatNetwork(2, (FloatNode(((2, 1.0),)),), (2,)), r"nodes\[0\]\.links\[0\]: 2 is not an input"),
        (lambda: FloatNetwork(2, (FloatNode(((0, math.nan),)),), (2,)), r"nodes\[0\]\.links\[0\]: expected a finite"),
        (lambda: FloatNetwork(2, (FloatNode((), math.inf),), (2,)), r"nodes\[0\]\.bias"),
        (lambda: FloatNetwork(2, (FloatNode((), 0.0, 1e13),), (2,)), r"nodes\[0\]\.response"),
        (lambda: FloatNetwork(2, (FloatNode((), activation="elu"),), (2,)), r"nodes\[0\]\.activation: 'elu'"),
        (lambda: FloatNetwork(2, (), (2,)), r"outputs\[0\]: 2 is not an input or a node"),
        (lambda: FloatNetwork(2, (), ()), "outputs: expected at least one"),
        (lambda: FloatNetwork(0, (), (0,)), "num_inputs"),
    ],
)
def test_a_malformed_network_is_refused_by_field(network: object, message: str) -> None:
    with pytest.raises(NetworkError, match=message):
        network()  # type: ignore[operator]


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.pop("outputs"),
        lambda data: data.update(more=1),
        lambda data: data["nodes"][0].pop("bias"),
        lambda data: data["nodes"][0].update(links=[[0]]),
        lambda data: data["nodes"][0].update(activation=3),
        lambda data: data["nodes"][0].update(bias="1"),
        lambda data: data.update(nodes=7),
        lambda data: data.update(num_inputs=True),
    ],
)
def test_damaged_data_is_refused(change: object) -> None:
    data = some_network(1).to_data()
    change(data)  # type: ignore[operator]
    with pytest.raises(NetworkError):
        network_from_data(data)


@pytest.mark.parametrize("suffix", ["pkl", "json"])
def test_a_champion_of_a_network_comes_back_from_its_file(tmp_path: Path, suffix: str) -> None:
    champion = FloatChampion(some_network(4), BOX, WALKER, {"seed": 1})
    path = tmp_path / f"champion.{suffix}"
    (save_json if suffix == "json" else save_pickle)(champion, path)
    assert load_any(path) == champion
    with pytest.raises(BitneatError, match=r"holds a float network.*bitneat quantize"):
        load(path)


@pytest.mark.parametrize("command", ["codegen", "verify", "size"])
def test_commands_that_need_a_controller_point_to_quantize(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "float.pkl"
    save_pickle(FloatChampion(some_network(4), BOX, WALKER), path)
    arguments = [command, str(path), *(["-o", str(tmp_path / "w.c")] if command == "codegen" else [])]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "bitneat quantize" in error
    assert str(path) in error
