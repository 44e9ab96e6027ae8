# SPDX-License-Identifier: MIT
"""From genome to controller."""

from __future__ import annotations

from collections.abc import Iterable

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.activation import ACTIVATION_NAMES, output_limit
from bitneat.controller.digits import halved, signed_powers
from bitneat.controller.ir import ACCUMULATOR_MAX, GAIN_RANGE, Constant
from bitneat.controller.reference import node_value
from bitneat.errors import BitneatError
from bitneat.evolve.genes import BitConnectionGene, BitNodeGene
from bitneat.evolve.genome import BitGenome, BitGenomeConfig
from bitneat.evolve.ordering import evaluation_order, signal_numbers
from bitneat.evolve.plain import PlainGenome, wiring
from bitneat.network import FloatNetwork, FloatNode, Policy


def lower(genome: BitGenome, inputs: tuple[Input, ...], num_outputs: int, frac_bits: int) -> Controller:
    """The canonical controller that a genome stands for.

    Links that are disabled or of weight zero are absent. A hidden node that no input reaches is absent too, with its links:
    neat-python would make it a constant nobody asked for. An output without links is the constant that its bias gives.
    A gain that could carry a node's sum beyond the accumulator is lowered to the largest that cannot.

    Raises:
        BitneatError: if undelayed links form a cycle, which those of a damaged file may.
    """
    links = [link for link in genome.connections.values() if link.counts]
    alive = _reached_from_inputs(links) | set(range(num_outputs))
    links = [link for link in links if link.key[1] in alive and (link.key[0] < 0 or link.key[0] in alive)]
    into: dict[int, list[BitConnectionGene]] = {key: [] for key in alive & set(genome.nodes)}
    for link in links:
        into[link.key[1]].append(link)
    # No undelayed link leaves an output, so that the outputs come last, as they do in the canonical order.
    order = evaluation_order(
        {key: [link.key[0] for link in found if not link.delay] for key, found in into.items()}, num_outputs
    )
    if len(order) < len(into):
        raise BitneatError(f"nodes {', '.join(map(str, sorted(into.keys() - set(order))[:5]))}: form a cycle")
    number = signal_numbers(len(inputs), order)
    one = 1 << frac_bits
    reach = _reach(inputs, ((key, genome.nodes[key].activation) for key in order), frac_bits)
    nodes = []
    for key in order:
        gene = genome.nodes[key]
        total = abs(gene.bias) * one + sum(reach[link.key[0]] for link in into[key])
        gain = gene.gain
        while gain > 0 and total << gain > ACCUMULATOR_MAX:
            gain -= 1
        sources = sorted(Link(number[link.key[0]], link.delay, 0, link.weight) for link in into[key])
        nodes.append(Node(tuple(sources), gene.bias * one, gain, gene.activation))
    outputs = tuple(Signal(number[key]) for key in range(num_outputs))
    return Controller(inputs, tuple(nodes), outputs, frac_bits).canonical


def genome_from_controller(key: int, controller: Controller, settings: BitGenomeConfig) -> BitGenome:
    """A genome that lowers to a ternary controller again, or to one that computes the same.

    In a genome each output is a node of its own, nothing reads one in the same step, and a link is known by its ends. So an output
    that is a constant or an input becomes a node of that value; a node that serves two outputs, or an output and other nodes, is
    there twice; and so is a source that a node reads both now and delayed.

    Args:
        key: of the genome.
        controller: canonical.
        settings: of the genome; they give innovation numbers and keys.

    Raises:
        BitneatError: naming what no genome has: a link with a shift, a bias that is not 0 or ±2^F, a constant output that no bias
            and gain make, or a node that no input reaches, unless it is an output.
    """
    genome = BitGenome(key)
    first, count = len(controller.inputs), len(controller.outputs)
    keys, copies = _places(controller)
    genome.nodes = {place: BitNodeGene(place) for place in range(count)}
    names = {}
    for index in range(first, controller.num_signals):
        if index not in keys:
            keys[index] = settings.get_new_node_key(genome.nodes)
            genome.nodes[keys[index]] = BitNodeGene(keys[index])
        names[keys[index]] = f"nodes[{index - first}]"
    again: dict[int, int] = {}

    def fill(target: int, node: Node, where: str) -> None:
        gene = genome.nodes[target]
        gene.gain, gene.activation, gene.bias = node.gain, node.activation, node.bias // controller.one
        if gene.bias not in (-1, 0, 1) or gene.bias * controller.one != node.bias:
            raise BitneatError(f"{where}.bias: {node.bias} is not 0 or ±2^F")
        for place, link in enumerate(node.links):
            if link.shift:
                raise BitneatError(f"{where}.links[{place}]: has a shift, which no link of a genome has")
            ends = keys[link.source], target
            if ends in genome.connections:
                ends = second(link.source), target
            innovation = settings.innovation_tracker.get_innovation_number(*ends, "add_connection")
            gene_link = BitConnectionGene(ends, innovation=innovation)
            gene_link.weight, gene_link.enabled, gene_link.delay = link.sign, True, link.delay
            genome.connections[ends] = gene_link

    def second(source: int) -> int:
        """Another node of a signal's value; what it reads comes before it where it is read now, so that this ends."""
        if source not in again:
            again[source] = settings.get_new_node_key(genome.nodes)
            genome.nodes[again[source]] = BitNodeGene(again[source])
            fill(again[source], _node_like(source, controller), names.get(keys[source], f"inputs[{source}]"))
        return again[source]

    for index, node in enumerate(controller.nodes, start=first):
        if keys[index] not in copies:
            fill(keys[index], node, f"nodes[{index - first}]")
    for place, node in copies.items():
        fill(place, node, f"outputs[{place}]")
    reached = _reached_from_inputs(genome.connections.values())
    for hidden in genome.nodes:
        if hidden >= count and hidden not in reached:
            raise BitneatError(
                f"{names.get(hidden, 'a node')}: no input reaches it, and a genome leaves such a node out"
            )
    return genome


def _places(controller: Controller) -> tuple[dict[int, int], dict[int, Node]]:
    """The keys in a genome of inputs and of nodes that are outputs, and the outputs that need a node beside the controller's."""
    first = len(controller.inputs)
    keys = {index: -1 - index for index in range(first)}
    read_now = {link.source for node in controller.nodes for link in node.links if not link.delay}
    copies: dict[int, Node] = {}
    constants: dict[int, int] = {}
    for place, output in enumerate(controller.outputs):
        if isinstance(output, Constant):
            constants[output.value] = place
            copies[place] = _constant_node(output.value, controller, f"outputs[{place}]")
        elif output.index in keys or output.index in read_now:
            copies[place] = _node_like(output.index, controller)
        else:
            keys[output.index] = place
    for index, node in enumerate(controller.nodes, start=first):
        value = None if node.links else node_value(node, (), (), controller.frac_bits)
        if value in constants:  # of a constant output that others read delayed the canonical form makes two
            keys[index] = constants[value]
    return keys, copies


def _node_like(signal: int, controller: Controller) -> Node:
    """A node of a signal's value."""
    first = len(controller.inputs)
    return controller.nodes[signal - first] if signal >= first else Node((Link(signal),), 0, 0, "identity")


def _constant_node(value: int, controller: Controller, where: str) -> Node:
    """A node without links of a genome's bias and gain, whose value is a constant.

    Raises:
        BitneatError: if there is none.
    """
    for activation in dict.fromkeys(("clamped", "identity", *ACTIVATION_NAMES)):
        for gain in sorted(range(GAIN_RANGE[0], GAIN_RANGE[1] + 1), key=abs):
            for bias in (0, 1, -1):
                node = Node((), bias * controller.one, gain, activation)
                if node_value(node, (), (), controller.frac_bits) == value:
                    return node
    raise BitneatError(f"{where}: is the constant {value}, which no bias and gain of a genome make")


def lower_float(genome: PlainGenome, num_inputs: int, num_outputs: int) -> FloatNetwork:
    """The network that neat-python would make of a genome with float weights."""
    found = wiring(genome, num_outputs)
    number = signal_numbers(num_inputs, found.order)
    nodes = []
    for key in found.order:
        gene = genome.nodes[key]
        links = tuple((number[link.key[0]], float(link.weight)) for link in found.links[key])
        nodes.append(FloatNode(links, float(gene.bias), 1.0, gene.activation))
    return FloatNetwork(num_inputs, tuple(nodes), tuple(number[key] for key in range(num_outputs)))


def lower_integer(genome: PlainGenome, inputs: tuple[Input, ...], num_outputs: int, frac_bits: int) -> Controller:
    """The canonical controller of a genome with integer or ternary weights: a link for each signed power of two of a weight.

    A hidden node that no input reaches is absent, as in `lower`: neat-python would make it a constant, which need not be ternary.
    If a node's sum could go beyond the accumulator, its weights and its bias are halved, toward zero, until it cannot.
    """
    found = wiring(genome, num_outputs)
    reached: set[int] = set()
    for key in found.order:
        if any(link.weight and (link.key[0] < 0 or link.key[0] in reached) for link in found.links[key]):
            reached.add(key)
    order = [key for key in found.order if key in reached or key < num_outputs]
    number = signal_numbers(len(inputs), order)
    reach = _reach(inputs, ((key, genome.nodes[key].activation) for key in order), frac_bits)
    nodes = []
    for key in order:
        gene = genome.nodes[key]
        bias = int(gene.bias) << frac_bits
        weights = {link.key[0]: link.weight for link in found.links[key] if link.key[0] in number}
        while abs(bias) + sum(_total(weight, reach[source]) for source, weight in weights.items()) > ACCUMULATOR_MAX:
            bias = halved(bias)
            weights = {source: halved(weight) for source, weight in weights.items()}
        links = [
            Link(number[source], 0, power, sign)
            for source, weight in weights.items()
            for power, sign in signed_powers(weight)
        ]
        nodes.append(Node(tuple(sorted(links)), bias, 0, gene.activation))
    outputs = tuple(Signal(number[key]) for key in range(num_outputs))
    return Controller(inputs, tuple(nodes), outputs, frac_bits).canonical


def with_shared_weight(controller: Controller, units: int, resolution: int) -> Controller:
    """A controller without biases and gains, whose links get the weight ``units / 2^resolution`` in place of the 1 they have.

    So is a weight-agnostic network (Gaier and Ha 2019) tried with one shared weight after the other: a power of two is a gain.
    If a node's sum could go beyond the accumulator, its weight is made coarser, or else halved, until it cannot.
    """
    nodes = []
    for node in controller.nodes:
        here, gain = units, -resolution
        reach = sum(controller.signal_limit(link.source) for link in node.links)
        while _total(here, reach) << max(gain, 0) > ACCUMULATOR_MAX:
            if gain > 0:
                gain -= 1
            else:
                here = halved(here)
                gain += gain < 0  # twice the gain for half the weight
        links = [
            Link(link.source, link.delay, power, sign) for link in node.links for power, sign in signed_powers(here)
        ]
        nodes.append(Node(tuple(sorted(links)), 0, gain, node.activation))
    return Controller(controller.inputs, tuple(nodes), controller.outputs, controller.frac_bits).canonical


def _reach(inputs: tuple[Input, ...], activations: Iterable[tuple[int, str]], frac_bits: int) -> dict[int, int]:
    """The largest magnitude of the signals that keys of a genome stand for, from the inputs' limits and the nodes' activations."""
    reach = {-1 - index: entry.limit for index, entry in enumerate(inputs)}
    reach.update({key: output_limit(activation, frac_bits) for key, activation in activations})
    return reach


def _total(weight: int, reach: int) -> int:
    """What the shifted links that make a weight can add to the magnitude of a sum: the signed digits do not cancel there."""
    return sum(reach << power for power, _ in signed_powers(weight))


def has_path(controller: Policy) -> bool:
    """True iff some output depends on an input; a controller must be canonical."""
    if isinstance(controller, FloatNetwork):
        return bool(_read(controller))
    return any(not isinstance(output, Constant) for output in controller.outputs)


def _read(network: FloatNetwork) -> set[int]:
    """The inputs that some output depends on."""
    needed = set(network.outputs)
    for index in reversed(range(len(network.nodes))):
        if network.num_inputs + index in needed:
            needed.update(source for source, _ in network.nodes[index].links)
    return {signal for signal in needed if signal < network.num_inputs}


def _reached_from_inputs(links: Iterable[BitConnectionGene]) -> set[int]:
    """The nodes that depend on an input, now or through delayed links."""
    readers: dict[int, list[int]] = {}
    for link in links:
        readers.setdefault(link.key[0], []).append(link.key[1])
    pending = [source for source in readers if source < 0]
    reached: set[int] = set()
    while pending:
        for reader in readers.get(pending.pop(), ()):
            if reader not in reached:
                reached.add(reader)
                pending.append(reader)
    return reached
