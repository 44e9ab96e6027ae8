# SPDX-License-Identifier: MIT
"""From a genome that plain neat-python pickled to a controller, or to a float network.

The pickle is foreign, so `bitneat.unpickle` reads it; it knows three class names, neat-python's genome and genes, and builds
stand-ins for them: no code of the file or of neat-python runs.
"""

from __future__ import annotations

import configparser
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from bitneat.controller import Constant, Controller, ControllerError, Input, Link, Node, Signal
from bitneat.controller.digits import signed_powers
from bitneat.controller.ir import GAIN_RANGE, MAX_SIGNALS, SHIFT_RANGE
from bitneat.errors import BitneatError
from bitneat.evolve.ordering import evaluation_order, signal_numbers
from bitneat.files import read_capped
from bitneat.network import MAX_VALUE, FloatNetwork, FloatNode
from bitneat.unpickle import Record, UnpickleError, read

MAX_GENOME_BYTES = 16 * 1024 * 1024
NEAT_ACTIVATIONS = ("identity", "clamped", "relu", "abs", "hat", "tanh", "sigmoid", "sin", "gauss")
"""neat-python's activations that bitneat has, under the same names and with the same scaling."""

_GAINS = frozenset(2.0**gain for gain in range(GAIN_RANGE[0], GAIN_RANGE[1] + 1))


class GenomeImportError(BitneatError):
    """A genome cannot be read, or has no equal among controllers."""


class _Genome(Record):
    """Stands in for neat.genome.DefaultGenome."""

    connections: dict[tuple[int, int], _Gene]
    nodes: dict[int, _Gene]


class _Gene(Record):
    """Stands in for neat.genes.DefaultNodeGene and DefaultConnectionGene."""


_CLASSES: dict[tuple[str, str], Callable[[], Record]] = {
    ("neat.genome", "DefaultGenome"): _Genome,
    ("neat.genes", "DefaultNodeGene"): _Gene,
    ("neat.genes", "DefaultConnectionGene"): _Gene,
}


@dataclass(frozen=True)
class NeatShape:
    """What the importer needs of a neat-python configuration."""

    num_inputs: int
    num_outputs: int


def read_shape(path: Path) -> NeatShape:
    """Numbers of inputs and outputs from neat-python's ini file.

    Raises:
        BitneatError: if a key is missing or wrong, or the networks are recurrent.
    """
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_capped(path, 1 << 20).decode("utf-8-sig"), source=str(path))
    except (configparser.Error, UnicodeDecodeError) as error:
        raise GenomeImportError(f"{path}: {' '.join(str(error).split())}") from None
    section = "DefaultGenome"
    if not parser.has_section(section):
        raise GenomeImportError(f"{path}: missing section [{section}]: expected a configuration of plain neat-python")
    numbers = {}
    for key in ("num_inputs", "num_outputs"):
        try:
            numbers[key] = int(parser.get(section, key))
        except (configparser.Error, ValueError):
            numbers[key] = 0
        if not 1 <= numbers[key] <= 1024:
            raise GenomeImportError(f"{path}: [{section}] {key}: expected an integer from 1 to 1024")
    if parser.get(section, "feed_forward", fallback="True").strip().lower() not in ("true", "1", "yes", "on"):
        raise GenomeImportError(f"{path}: [{section}] feed_forward: recurrent networks cannot be imported")
    return NeatShape(**numbers)


def read_genome(path: Path) -> Any:
    """The genome in a pickle, as a stand-in with plain attributes.

    Raises:
        BitneatError: if the pickle is damaged or names anything but neat-python's default genome and genes.
    """
    content = read_capped(path, MAX_GENOME_BYTES)
    try:
        genome = read(content, _CLASSES)
    except UnpickleError as error:
        raise GenomeImportError(f"{path}: {error}") from None
    if not isinstance(genome, _Genome):
        raise GenomeImportError(f"{path}: holds a {type(genome).__name__}, expected a genome of neat-python")
    for part in ("nodes", "connections"):
        if not isinstance(getattr(genome, part, None), dict):
            raise GenomeImportError(f"{path}: the genome has no {part}")
    return genome


def convert(genome: Any, shape: NeatShape, inputs: tuple[Input, ...], frac_bits: int) -> Controller:
    """The canonical controller that computes what the genome does, up to the resolution of its signals.

    An integer weight becomes a sum of shifted links (canonical signed digits), a response that is a power of two a gain.

    Raises:
        BitneatError: naming the gene and what a controller cannot express.
    """
    into = _links_into(genome, shape, _integer)
    order = _needed(into, shape)
    number = signal_numbers(shape.num_inputs, order)
    nodes = tuple(_node(genome.nodes[key], key, into[key], number, frac_bits) for key in order)
    outputs = tuple(Signal(number[key]) for key in range(shape.num_outputs))
    try:
        controller = Controller(inputs, nodes, outputs, frac_bits).canonical
    except ControllerError as error:
        raise GenomeImportError(f"the genome has no equal controller: {error}") from None
    if all(isinstance(output, Constant) for output in controller.outputs):
        raise GenomeImportError("the genome has no path from any input to an output")
    return controller


def convert_float(genome: Any, shape: NeatShape) -> FloatNetwork:
    """The float network that computes what the genome does, without the nodes that no output needs.

    Raises:
        BitneatError: naming the gene and what a float network cannot express.
    """
    into = _links_into(genome, shape, _number)
    order = _needed(into, shape)
    number = signal_numbers(shape.num_inputs, order)
    nodes = []
    for key in order:
        gene, where = genome.nodes[key], f"node {key}"
        activation = _activation(gene, where, len(into[key]))
        links = tuple((number[source], weight) for source, weight in into[key])
        nodes.append(FloatNode(links, _number(gene, "bias", where), _number(gene, "response", where), activation))
    if not any(source < 0 for key in order for source, _ in into[key]):
        raise GenomeImportError("the genome has no path from any input to an output")
    return FloatNetwork(shape.num_inputs, tuple(nodes), tuple(number[key] for key in range(shape.num_outputs)))


def is_whole(genome: Any) -> bool:
    """Whether all weights and biases are integers and all responses gains, as far as they are numbers at all."""
    numbers = [getattr(gene, "weight", None) for gene in genome.connections.values() if getattr(gene, "enabled", None)]
    numbers += [getattr(gene, "bias", None) for gene in genome.nodes.values()]
    responses: list[Any] = [getattr(gene, "response", None) for gene in genome.nodes.values()]
    return all(type(value) is not float or not math.isfinite(value) or value.is_integer() for value in numbers) and all(
        type(value) not in (int, float) or value in _GAINS or not abs(value) < math.inf for value in responses
    )


_Weight = TypeVar("_Weight", int, float)


def _links_into(
    genome: Any, shape: NeatShape, read: Callable[[Any, str, str], _Weight]
) -> dict[int, list[tuple[int, _Weight]]]:
    """The enabled links, (source, weight), into each node, in the order of the genome."""
    if len(genome.nodes) > MAX_SIGNALS:
        raise GenomeImportError(f"the genome has {len(genome.nodes)} nodes, a controller at most {MAX_SIGNALS}")
    for key in genome.nodes:
        if type(key) is not int or key < 0:
            raise GenomeImportError(f"node {key!r:.40}: expected an integer from 0 as key")
    into: dict[int, list[tuple[int, _Weight]]] = {key: [] for key in genome.nodes}
    for key, gene in genome.connections.items():
        source, target = _connection_key(key)
        enabled = getattr(gene, "enabled", None)
        if type(enabled) is not bool:
            raise GenomeImportError(
                f"connection {source} -> {target}: enabled is {enabled!r:.40}, expected True or False"
            )
        if target not in into or (source not in into and not -shape.num_inputs <= source < 0):
            raise GenomeImportError(f"connection {source} -> {target}: leads to or from a node that is not there")
        if enabled:
            into[target].append((source, read(gene, "weight", f"connection {source} -> {target}")))
    for output in range(shape.num_outputs):
        if output not in genome.nodes:
            raise GenomeImportError(
                f"output {output}: the genome has no such node; does the configuration belong to it?"
            )
    return into


def _node(gene: Any, key: int, sources: list[tuple[int, int]], number: dict[int, int], frac_bits: int) -> Node:
    where = f"node {key}"
    activation = _activation(gene, where, len(sources))
    gain = _exponent(getattr(gene, "response", None), where)
    # neat-python adds the bias after the response, a controller before the gain.
    bias = _integer(gene, "bias", where) << frac_bits
    if gain > 0 and bias % (1 << gain):
        raise GenomeImportError(
            f"{where}: its bias is not a multiple of 2^{gain - frac_bits}, its response's resolution"
        )
    bias = bias >> gain if gain > 0 else bias << -gain
    links = []
    for source, weight in sources:
        for shift, sign in signed_powers(weight):
            if shift > SHIFT_RANGE[1]:
                raise GenomeImportError(
                    f"connection {source} -> {key}: weight {weight} is too large for shifts up to 7"
                )
            links.append(Link(number[source], 0, shift, sign))
    return Node(tuple(sorted(links)), bias, gain, activation)


def _activation(gene: Any, where: str, fan_in: int) -> str:
    activation, aggregation = getattr(gene, "activation", None), getattr(gene, "aggregation", None)
    if activation not in NEAT_ACTIVATIONS:
        raise GenomeImportError(f"{where}: activation {activation!r:.40} is not one of {', '.join(NEAT_ACTIVATIONS)}")
    if aggregation != "sum" and fan_in > 1:
        raise GenomeImportError(f"{where}: aggregation {aggregation!r:.40}: a node of a controller can only sum")
    if aggregation == "product" and not fan_in:  # neat-python's others give 0 of nothing
        raise GenomeImportError(
            f"{where}: aggregation 'product' without enabled links is 1, and a sum is 0; expected another aggregation or a link"
        )
    return str(activation)


def _connection_key(key: Any) -> tuple[int, int]:
    if isinstance(key, tuple) and len(key) == 2 and all(type(end) is int for end in key):
        return key
    raise GenomeImportError(f"connection {key!r:.40}: expected a pair of integers as key")


def _integer(gene: Any, name: str, where: str) -> int:
    value: Any = getattr(gene, name, None)
    if type(value) not in (int, float) or (type(value) is float and not math.isfinite(value)):
        raise GenomeImportError(f"{where}: {name} is {value!r:.40}, expected an integer")
    if abs(value) > 1 << 20:
        raise GenomeImportError(f"{where}: {name} {value!r:.20} is too large")
    if value != int(value):
        raise GenomeImportError(f"{where}: {name} is {value:g}, not an integer; make it one with `bitneat quantize`")
    return int(value)


def _number(gene: Any, name: str, where: str) -> float:
    value: Any = getattr(gene, name, None)
    if type(value) not in (int, float) or not abs(value) <= MAX_VALUE:  # NaN is not
        raise GenomeImportError(f"{where}: {name} is {value!r:.40}, expected a number of at most {MAX_VALUE:g} in size")
    return float(value)


def _exponent(response: Any, where: str) -> int:
    if type(response) not in (int, float) or not 0 < response < 1 << 20:
        raise GenomeImportError(f"{where}: response is {response!r:.40}, expected a power of two")
    mantissa, exponent = math.frexp(response)
    if mantissa != 0.5 or not GAIN_RANGE[0] <= exponent - 1 <= GAIN_RANGE[1]:
        raise GenomeImportError(
            f"{where}: response {response:g} is not a power of two from 2^-7 to 2^7; make it one with `bitneat quantize`"
        )
    return exponent - 1


def _needed(into: Mapping[int, Sequence[tuple[int, float]]], shape: NeatShape) -> list[int]:
    """The nodes that an output depends on, in the order of `_order`."""
    needed = set(range(shape.num_outputs))
    waiting = list(needed)
    while waiting:
        sources = {source for source, _ in into[waiting.pop()] if source >= 0} - needed
        needed |= sources
        waiting += sources
    return [key for key in _order(into, shape) if key in needed]


def _order(into: Mapping[int, Sequence[tuple[int, float]]], shape: NeatShape) -> list[int]:
    """Hidden nodes in topological order, then the outputs that no node reads."""
    order = evaluation_order(
        {key: [source for source, _ in sources] for key, sources in into.items()}, shape.num_outputs
    )
    waiting = sorted(into.keys() - set(order), key=lambda key: (key < shape.num_outputs, key))
    if waiting:
        raise GenomeImportError(
            f"nodes {', '.join(map(str, waiting[:5]))}: form a cycle; recurrent networks cannot be imported"
        )
    return order
