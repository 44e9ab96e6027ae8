# SPDX-License-Identifier: MIT
"""Genomes of plain neat-python: what can be expressed computes the same, what cannot is refused by name."""

from __future__ import annotations

import functools
import operator
import os
import pickle
import random
import sys
from pathlib import Path
from typing import Any

import neat
import pytest

from bitneat import champion as champions
from bitneat.cli.main import main
from bitneat.controller import Input, Reference
from bitneat.errors import BitneatError
from bitneat.evolve.importing import NeatShape, convert, convert_float, is_whole, read_genome, read_shape

CONFIG = """
[NEAT]
fitness_criterion = max
fitness_threshold = 1
pop_size = 2
reset_on_extinction = False
no_fitness_termination = False
[DefaultGenome]
num_inputs = 3
num_outputs = 2
num_hidden = 2
feed_forward = True
initial_connection = full_direct
conn_add_prob = 0.5
conn_delete_prob = 0.2
node_add_prob = 0.5
node_delete_prob = 0.1
compatibility_disjoint_coefficient = 1.0
compatibility_weight_coefficient = 1.0
bias_init_mean = 0.0
bias_init_stdev = 1.0
bias_max_value = 3
bias_min_value = -3
bias_mutate_power = 1
bias_mutate_rate = 0.5
bias_replace_rate = 0.1
response_init_mean = 1.0
response_init_stdev = 0.0
response_max_value = 1
response_min_value = 1
response_mutate_power = 0
response_mutate_rate = 0
response_replace_rate = 0
weight_init_mean = 0.0
weight_init_stdev = 1.0
weight_max_value = 30
weight_min_value = -30
weight_mutate_power = 1
weight_mutate_rate = 0.5
weight_replace_rate = 0.1
enabled_default = True
enabled_mutate_rate = 0.05
activation_default = clamped
activation_options = clamped
activation_mutate_rate = 0
aggregation_default = sum
aggregation_options = sum
aggregation_mutate_rate = 0
[DefaultSpeciesSet]
compatibility_threshold = 3
[DefaultStagnation]
species_fitness_func = max
max_stagnation = 5
species_elitism = 1
[DefaultReproduction]
elitism = 1
survival_threshold = 0.2
min_species_size = 1
"""
SHAPE = NeatShape(3, 2)
LARGEST = 32767 / 4096
INPUTS = (Input(), Input(), Input())


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "neat.ini"
    path.write_text(CONFIG)
    return path


def make(config_file: Path, seed: int):  # type: ignore[no-untyped-def]
    """A genome with structure from neat-python's own mutations, and integer weights and biases."""
    config = neat.Config(
        neat.DefaultGenome, neat.DefaultReproduction, neat.DefaultSpeciesSet, neat.DefaultStagnation, str(config_file)
    )
    random.seed(seed)
    config.genome_config.innovation_tracker = neat.InnovationTracker()
    genome = neat.DefaultGenome(1)
    genome.configure_new(config.genome_config)
    for _ in range(6):
        genome.mutate(config.genome_config)
    for link in genome.connections.values():
        link.weight = float(random.randint(-9, 9))
    for key, node in genome.nodes.items():
        node.bias = float(random.randint(-2, 2))
        node.response = random.choice([0.5, 1.0, 1.0, 0.25])
        # A hidden signal that saturates where neat-python's goes on would make any difference in what follows.
        node.activation = random.choice(["identity", "relu", "abs"] if key < 2 else ["clamped", "hat"])
    return genome, config


def test_integer_genomes_compute_what_neat_python_computes(config_file: Path) -> None:
    for seed in range(60):
        genome, config = make(config_file, seed)
        controller = convert(genome, SHAPE, INPUTS, 12)
        network = neat.nn.FeedForwardNetwork.create(genome, config)
        reference = Reference(controller)
        # Responses below 1 lose bits of a signal, each node at most one unit, which later weights may amplify.
        for _ in range(10):
            values = [random.randint(-256, 256) for _ in range(3)]
            expected = network.activate([value / 4096 for value in values])
            found = [y / 4096 for y in reference.step(values)]
            assert found == pytest.approx([max(-LARGEST, min(LARGEST, y)) for y in expected], abs=0.08), f"seed {seed}"


def test_float_genomes_compute_neat_pythons_very_bits(config_file: Path) -> None:
    for seed in range(60):
        genome, config = make(config_file, seed)
        for link in genome.connections.values():
            link.weight = random.gauss(0, 2)
        for node in genome.nodes.values():
            node.bias, node.response = random.gauss(0, 1), random.gauss(1, 1)
            node.activation = random.choice(["tanh", "sigmoid", "sin", "gauss", "clamped", "relu", "hat", "identity"])
        try:
            network = convert_float(genome, SHAPE)
        except BitneatError as error:
            assert "no path from any input" in str(error)
            continue
        theirs = neat.nn.FeedForwardNetwork.create(genome, config)
        if sys.version_info >= (3, 12):  # from then on Python's sum, by which neat-python adds up, compensates
            theirs.node_evals = [
                (key, activation, lambda terms: functools.reduce(operator.add, terms, 0), *rest)
                for key, activation, _, *rest in theirs.node_evals
            ]
        for _ in range(5):
            values = [random.gauss(0, 1) for _ in range(3)]
            assert network.step(values) == theirs.activate(values), f"seed {seed}"


AGGREGATIONS = ("sum", "product", "max", "min", "maxabs", "median", "mean")


def with_orphan(config_file: Path, aggregation: str, *, read: bool) -> tuple[Any, Any]:
    """A genome with a node without enabled links, which an output reads or not."""
    genome, config = make(config_file, 3)
    (first, second), node = list(genome.connections.values())[:2], genome.nodes[0].copy()
    node.key, node.aggregation, node.activation, node.bias, node.response = 99, aggregation, "identity", 1.0, 0.5
    into, out = first.copy(), second.copy()
    into.key, into.enabled, out.key, out.enabled, out.weight = (-1, 99), False, (99, 0), read, 2.0
    genome.nodes[99] = node
    genome.connections.update({into.key: into, out.key: out})
    return genome, config


@pytest.mark.parametrize("aggregation", AGGREGATIONS)
def test_a_node_without_links_is_what_neat_python_makes_of_it_or_refused(config_file: Path, aggregation: str) -> None:
    genome, config = with_orphan(config_file, aggregation, read=True)
    assert set(AGGREGATIONS) == set(config.genome_config.aggregation_function_defs.functions)
    values = [0.125, -0.25, 0.5]
    expected = neat.nn.FeedForwardNetwork.create(genome, config).activate(values)
    if aggregation == "product":
        message = r"node 99: aggregation 'product' without enabled links is 1, and a sum is 0; expected another"
        for read in (lambda: convert(genome, SHAPE, INPUTS, 12), lambda: convert_float(genome, SHAPE)):
            with pytest.raises(BitneatError, match=message):
                read()
        return
    found = Reference(convert(genome, SHAPE, INPUTS, 12)).step([int(4096 * value) for value in values])
    assert [y / 4096 for y in found] == pytest.approx(expected, abs=0.01)
    assert convert_float(genome, SHAPE).step(values) == pytest.approx(expected)


@pytest.mark.parametrize("aggregation", AGGREGATIONS)
def test_a_node_that_no_output_needs_may_be_anything(config_file: Path, aggregation: str) -> None:
    genome, config = with_orphan(config_file, aggregation, read=False)
    without, _ = make(config_file, 3)
    assert convert(genome, SHAPE, INPUTS, 12) == convert(without, SHAPE, INPUTS, 12)
    values = [0.125, -0.25, 0.5]
    expected = neat.nn.FeedForwardNetwork.create(genome, config).activate(values)
    assert convert_float(genome, SHAPE).step(values) == pytest.approx(expected)


def test_a_genome_is_whole_if_nothing_must_be_rounded(config_file: Path) -> None:
    genome, _ = make(config_file, 3)
    assert is_whole(genome)
    for response in (0.75, -1.0, 0.0, 512.0):
        next(iter(genome.nodes.values())).response = response
        assert not is_whole(genome)
    genome, _ = make(config_file, 3)
    next(iter(genome.nodes.values())).bias = 0.5
    assert not is_whole(genome)


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        ("connections", {"weight": float("inf")}, "weight is inf, expected a number"),
        ("connections", {"weight": True}, "weight is True, expected a number"),
        ("nodes", {"bias": 10**400}, "bias is 1000.*, expected a number"),
        ("nodes", {"response": None}, "response is None, expected a number"),
        ("nodes", {"aggregation": "max"}, "aggregation 'max'"),
    ],
)
def test_what_no_float_network_expresses_is_said(
    config_file: Path, part: str, values: dict[str, object], message: str
) -> None:
    genome, _ = make(config_file, 3)
    for link in genome.connections.values():
        link.enabled = True
    with pytest.raises(BitneatError, match=message):
        convert_float(change(genome, part, **values), SHAPE)


def change(genome: object, part: str, **values: object) -> object:
    gene = next(iter(getattr(genome, part).values()))
    vars(gene).update(values)
    return genome


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        ("connections", {"weight": 0.37}, r"weight is 0\.37, not an integer; make it one with `bitneat quantize`"),
        ("connections", {"weight": float("nan")}, "weight is nan, expected an integer"),
        ("connections", {"weight": "1"}, "weight is '1'"),
        ("connections", {"weight": 1000.0}, "weight 1000 is too large for shifts"),
        ("connections", {"weight": 10**400}, "weight 10000000000000000000 is too large"),
        ("connections", {"enabled": 1}, "enabled is 1, expected True or False"),
        ("connections", {"enabled": None}, "enabled is None, expected"),
        ("nodes", {"bias": -(10**400)}, "bias -1000000000000000000 is too large"),
        ("nodes", {"response": 10**400}, "response is 1000.*, expected a power of two"),
        ("nodes", {"response": float("nan")}, "response is nan, expected a power of two"),
        ("nodes", {"bias": 0.5}, r"bias is 0\.5, not an integer"),
        ("nodes", {"response": 3.0}, "response 3 is not a power of two"),
        ("nodes", {"response": -1.0}, r"response is -1\.0, expected a power of two"),
        ("nodes", {"response": 2.0**9}, "response 512 is not a power of two from"),
        ("nodes", {"activation": "softplus"}, "activation 'softplus' is not one of"),
        ("nodes", {"aggregation": "product"}, "aggregation 'product'"),
    ],
)
def test_what_cannot_be_expressed_is_said(
    config_file: Path, part: str, values: dict[str, object], message: str
) -> None:
    genome, _ = make(config_file, 3)
    for link in genome.connections.values():
        link.enabled = True
    with pytest.raises(BitneatError, match=message):
        convert(change(genome, part, **values), SHAPE, INPUTS, 8)


@pytest.mark.parametrize("key", [-7, "hidden", 1.5, (1, 2)])
def test_node_keys_must_be_numbers_of_nodes(config_file: Path, key: object) -> None:
    genome, _ = make(config_file, 3)
    genome.nodes[key] = genome.nodes[0]
    with pytest.raises(BitneatError, match="expected an integer from 0 as key"):
        convert(genome, SHAPE, INPUTS, 8)


def test_a_chain_of_thousands_of_nodes_is_ordered_at_once(config_file: Path) -> None:
    genome, _ = make(config_file, 3)
    link, node = next(iter(genome.connections.values())), genome.nodes[0]
    link.enabled, link.weight, node.activation, node.response, node.bias = True, 1.0, "identity", 1.0, 0.0
    count = 8000
    genome.nodes = dict.fromkeys(range(count), node)
    # From the last to the first, which is the worst order for a search of what is ready.
    genome.connections = dict.fromkeys(
        [(-1, count - 1), *((key + 1, key) for key in range(1, count - 1)), (2, 0)], link
    )
    assert len(convert(genome, SHAPE, INPUTS, 8).outputs) == 2
    genome.connections[1, 7000] = link
    with pytest.raises(BitneatError, match="form a cycle"):
        convert(genome, SHAPE, INPUTS, 8)


def test_a_genome_without_a_path_is_refused(config_file: Path) -> None:
    genome, _ = make(config_file, 3)
    genome.connections = {}
    with pytest.raises(BitneatError, match="no path from any input to an output"):
        convert(genome, SHAPE, INPUTS, 8)


class Payload:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_a_genome_pickle_is_read_without_running_anything(tmp_path: Path, config_file: Path, protocol: int) -> None:
    genome, _ = make(config_file, 1)
    path = tmp_path / "winner.pkl"
    path.write_bytes(pickle.dumps(genome, protocol))
    read = read_genome(path)
    assert type(read).__module__ == "bitneat.evolve.importing"
    assert set(read.nodes) == set(genome.nodes)
    assert convert(read, SHAPE, INPUTS, 8) == convert(genome, SHAPE, INPUTS, 8)
    canary = tmp_path / "canary"
    genome.payload = Payload(canary)
    path.write_bytes(pickle.dumps(genome, protocol))
    with pytest.raises(BitneatError, match=r"winner\.pkl: refused: the pickle names posix\.mkdir"):
        read_genome(path)
    assert not canary.exists()


def test_genome_pickles_made_to_exhaust_their_reader_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "winner.pkl"
    pair = b"".join(b"h%c\x86\x94" % i for i in range(60))
    for content, message in (
        (b"\x80\x04}" + b")" + b"\x85" * 100_000 + b"K\x01s.", "levels"),
        (b"\x80\x04}K\x01\x94" + pair + b"K\x01s.", "used twice"),
        (b"\x80\x04}K\x01K\x02\x86\x94h\x00\x86K\x01s.", "a key is not"),
        (b"\x80\x04}]K\x01s.", "a key is not"),
        (b"\x80\x02cneat.genome\nDefaultGenome\nK\x01\x85\x81.", "made with arguments"),
        (b"\x80\x02cneat.genome\nDefaultGenome\n)\x81K\x01b.", "the state of an object"),
        (b"\x80\x02cneat.genome\nDefaultGenome\n)R.", "uses REDUCE"),
    ):
        path.write_bytes(content)
        with pytest.raises(BitneatError, match=message):
            read_genome(path)


def test_files_that_hold_no_genome_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "winner.pkl"
    for content, message in ((b"", "damaged"), (pickle.dumps([1]), "holds a list"), (b"\x80\x04junk", "damaged")):
        path.write_bytes(content)
        with pytest.raises(BitneatError, match=message):
            read_genome(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("num_inputs = 3", "num_inputs = x", r"\[DefaultGenome\] num_inputs: expected an integer"),
        ("num_outputs = 2", "", r"num_outputs: expected an integer"),
        ("feed_forward = True", "feed_forward = False", "recurrent networks cannot be imported"),
        ("[DefaultGenome]", "[MyGenome]", r"missing section \[DefaultGenome\]"),
    ],
)
def test_a_configuration_that_does_not_fit_is_refused(config_file: Path, old: str, new: str, message: str) -> None:
    config_file.write_text(CONFIG.replace(old, new))
    with pytest.raises(BitneatError, match=message):
        read_shape(config_file)


def test_a_configuration_may_begin_with_the_mark_of_utf_8(config_file: Path) -> None:
    shape = read_shape(config_file)
    config_file.write_bytes(b"\xef\xbb\xbf" + config_file.read_bytes())
    assert read_shape(config_file) == shape


def test_the_command_writes_a_champion(tmp_path: Path, config_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    genome, _ = make(config_file, 5)
    (tmp_path / "winner.pkl").write_bytes(pickle.dumps(genome))
    output = tmp_path / "champion.pkl"
    arguments = ["import", str(tmp_path / "winner.pkl"), "--config", str(config_file), "-o", str(output)]
    assert main(arguments) == 0
    assert "links" in capsys.readouterr().out
    champion = champions.load(output)
    assert champion.environment is None
    assert champion.controller == convert(genome, SHAPE, INPUTS, 8)
    assert main([*arguments, "--env", "CartPole-v1"]) == 2
    assert "CartPole-v1 needs 4 and 2" in capsys.readouterr().err
    assert main([*arguments, "--env", "Pendulum-v1", "--import", "no_such_module"]) == 2
    assert "--import no_such_module: No module named" in capsys.readouterr().err


def test_a_float_genome_becomes_a_float_champion_and_it_is_said(
    tmp_path: Path, config_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    genome, _ = make(config_file, 5)
    path, output = tmp_path / "winner.pkl", tmp_path / "champion.pkl"
    path.write_bytes(pickle.dumps(genome))
    arguments = ["import", str(path), "--config", str(config_file), "-o", str(output)]
    assert main([*arguments, "--float"]) == 0
    assert capsys.readouterr().err == ""
    champion = champions.load_any(output)
    assert isinstance(champion, champions.FloatChampion)
    assert champion.network == convert_float(genome, SHAPE)
    next(iter(genome.connections.values())).weight = 0.37
    next(iter(genome.connections.values())).enabled = True
    path.write_bytes(pickle.dumps(genome))
    assert main(arguments) == 0
    assert "imported as a float network" in capsys.readouterr().err
    assert isinstance(champions.load_any(output), champions.FloatChampion)
    assert main([*arguments, "--to", "ternary"]) == 0
    assert champions.load(output).controller.is_ternary
