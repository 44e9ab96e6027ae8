# SPDX-License-Identifier: MIT
"""neat-python's own genome, with float, integer or ternary weights: the genomes of the Bit-Pedal Walker paper.

Structure mutates with neat-python's own probabilities, and attributes gene by gene, unlike `bitneat.evolve.genome`. A float
genome becomes a `FloatNetwork`, the others a controller: an integer weight is a sum of shifted links.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from neat.attributes import BaseAttribute, BoolAttribute, FloatAttribute, StringAttribute
from neat.genes import BaseGene, DefaultConnectionGene
from neat.genome import DefaultGenome, DefaultGenomeConfig

from bitneat.controller import ACTIVATION_NAMES
from bitneat.controller.ir import MAX_SIGNALS
from bitneat.errors import BitneatError
from bitneat.evolve.indexer import Indexer
from bitneat.network import MAX_NODES

WEIGHTS = ("float", "integer", "ternary")


class RoundedAttribute(FloatAttribute):  # type: ignore[misc]
    """A Gaussian sample rounded to an integer; a mutation adds another."""

    def init_value(self, config: Any) -> int:
        """A rounded sample."""
        return int(round(super().init_value(config)))  # noqa: RUF046

    def mutate_value(self, value: int, config: Any) -> int:
        """The value with a rounded sample added, a new one, or the same."""
        return int(round(super().mutate_value(value, config)))  # noqa: RUF046


class ResampledAttribute(BaseAttribute):  # type: ignore[misc]
    """A weight in {-1, 0, +1}, each as likely as the others; a mutation draws it again."""

    _config_items: ClassVar[dict[str, list[Any]]] = {"mutate_rate": [float, None]}

    def init_value(self, config: Any) -> int:
        """One of the three."""
        del config
        return random.choice((-1, 0, 1))

    def mutate_value(self, value: int, config: Any) -> int:
        """With the mutation's probability one of the three, which may be the same."""
        return random.choice((-1, 0, 1)) if random.random() < getattr(config, self.mutate_rate_name) else value

    def validate(self, config: Any) -> None:
        """Nothing to check."""


class FloatNodeGene(BaseGene):  # type: ignore[misc]
    """A node with a float bias. Its response is 1 and its aggregation the sum."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [
        FloatAttribute("bias"),
        StringAttribute("activation", options=""),
    ]
    key: int
    bias: float
    activation: str

    def distance(self, other: FloatNodeGene, config: Any) -> float:
        """How different two nodes of the same key are, as in neat-python."""
        difference = abs(self.bias - other.bias) + (self.activation != other.activation)
        return float(difference * config.compatibility_weight_coefficient)


class IntegerNodeGene(FloatNodeGene):
    """A node with an integer bias."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [
        RoundedAttribute("bias"),
        StringAttribute("activation", options=""),
    ]


class UnbiasedNodeGene(FloatNodeGene):
    """A node without bias."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [StringAttribute("activation", options="")]
    bias = 0


class FloatConnectionGene(DefaultConnectionGene):  # type: ignore[misc]
    """A link with a float weight."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [FloatAttribute("weight"), BoolAttribute("enabled")]


class IntegerConnectionGene(DefaultConnectionGene):  # type: ignore[misc]
    """A link with an integer weight."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [RoundedAttribute("weight"), BoolAttribute("enabled")]


class TernaryConnectionGene(DefaultConnectionGene):  # type: ignore[misc]
    """A link with a weight in {-1, 0, +1}."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [ResampledAttribute("weight"), BoolAttribute("enabled")]


_GENES: Mapping[str, tuple[type[FloatNodeGene], type[DefaultConnectionGene]]] = {
    "float": (FloatNodeGene, FloatConnectionGene),
    "integer": (IntegerNodeGene, IntegerConnectionGene),
    "ternary": (UnbiasedNodeGene, TernaryConnectionGene),
}

_ATTRIBUTE_KEYS = ("init_mean", "init_stdev", "replace_rate", "mutate_rate", "mutate_power")


class PlainGenomeConfig(DefaultGenomeConfig):  # type: ignore[misc]
    """neat-python's genome configuration; saving it changes nothing.

    Args:
        settings: the checked entries of the section [PlainGenome].
        num_inputs: of the environment.
        num_outputs: of the environment.
    """

    def __init__(self, settings: Mapping[str, Any], num_inputs: int, num_outputs: int) -> None:
        node_gene, connection_gene = _GENES[settings["weights"]]
        parameters = {
            "node_gene_type": node_gene,
            "connection_gene_type": connection_gene,
            "num_inputs": str(num_inputs),
            "num_outputs": str(num_outputs),
            "num_hidden": "0",
            "feed_forward": "True",
            "initial_connection": settings["initial_connection"],
            "enabled_default": "True",
            "enabled_mutate_rate": str(settings["enabled_mutate_rate"]),
            "activation_default": settings["activation_default"],
            "activation_options": " ".join(settings["activations"]),
            "activation_mutate_rate": str(settings["activation_mutate_rate"]),
        }
        for key in ("conn_add_prob", "conn_delete_prob", "node_add_prob", "node_delete_prob"):
            parameters[key] = str(settings[key])
        for key in ("compatibility_disjoint_coefficient", "compatibility_weight_coefficient"):
            parameters[key] = str(settings[key])
        for name in ("weight", "bias"):
            for key in _ATTRIBUTE_KEYS:
                parameters[f"{name}_{key}"] = str(settings.get(f"{name}_{key}", 0.0))
            parameters[f"{name}_max_value"] = str(settings[f"{name}_max"])
            parameters[f"{name}_min_value"] = str(-settings[f"{name}_max"])
        super().__init__(parameters, "PlainGenome")
        self.node_indexer = Indexer(num_outputs)
        self.weights: str = settings["weights"]
        self.max_nodes = min(MAX_NODES, MAX_SIGNALS - num_inputs)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__.copy()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


class PlainGenome(DefaultGenome):  # type: ignore[misc]
    """neat-python's genome; what it does differently is faster, or keeps integers integers."""

    key: int
    nodes: dict[int, FloatNodeGene]
    connections: dict[tuple[int, int], DefaultConnectionGene]
    fitness: float | None

    def configure_crossover(self, genome1: PlainGenome, genome2: PlainGenome, config: Any) -> None:
        """The structure of the fitter parent, attributes of shared genes from either.

        neat-python's own looks for a cycle with every link that it copies, which the fitter parent does not have.
        """
        del config
        assert genome1.fitness is not None
        assert genome2.fitness is not None
        first, second = (genome1, genome2) if genome1.fitness > genome2.fitness else (genome2, genome1)
        for key, link in first.connections.items():
            other = second.connections.get(key)
            same = other is not None and other.innovation == link.innovation
            self.connections[key] = link.crossover(other) if same else link.copy()
        for node_key, node in first.nodes.items():
            other_node = second.nodes.get(node_key)
            self.nodes[node_key] = node.copy() if other_node is None else node.crossover(other_node)

    def configure_clone(self, parent: PlainGenome) -> None:
        """A copy of the parent."""
        self.connections = {key: link.copy() for key, link in parent.connections.items()}
        self.nodes = {key: node.copy() for key, node in parent.nodes.items()}

    def mutate_add_node(self, config: Any) -> None:
        """As neat-python's, which gives the new node the bias 0.0, and the link into it the weight 1.0, whatever the genes hold.

        There are no more nodes than controllers and float networks can have.
        """
        if len(self.nodes) >= config.max_nodes:
            return
        before = set(self.nodes)
        super().mutate_add_node(config)
        if config.weights == "float":
            return
        for key in self.nodes.keys() - before:
            self.nodes[key].bias = 0
            for link in self.connections.values():
                if link.key[1] == key:
                    link.weight = 1


def plain_to_data(genome: PlainGenome) -> list[Any]:
    """The genome as plain data, genes in their order, which later draws depend on."""
    return [
        genome.key,
        genome.fitness,
        [[node.key, node.bias, node.activation] for node in genome.nodes.values()],
        [[*link.key, link.innovation, link.weight, int(link.enabled)] for link in genome.connections.values()],
    ]


def plain_from_data(data: list[Any], weights: str, activations: Sequence[str]) -> PlainGenome:
    """Read what `plain_to_data` wrote.

    Checkpoints of before activations were written by name have numbers, which count in ``activations``, the configuration's list.

    Raises:
        BitneatError: if there is no such activation. Whatever else is wrong raises whatever it may.
    """
    node_gene, connection_gene = _GENES[weights]
    key, fitness, nodes, links = data
    genome = PlainGenome(key)
    genome.fitness = fitness
    for node_key, bias, activation in nodes:
        node = node_gene(node_key)
        node.bias, node.activation = bias, _activation(activation, activations)
        genome.nodes[node_key] = node
    for source, target, innovation, weight, enabled in links:
        link = connection_gene((source, target), innovation=innovation)
        link.weight, link.enabled = weight, bool(enabled)
        genome.connections[link.key] = link
    return genome


def _activation(found: Any, activations: Sequence[str]) -> str:
    if type(found) is int and 0 <= found < len(activations):
        return activations[found]
    if found in ACTIVATION_NAMES:
        return str(found)
    raise BitneatError(f"activation {found!r:.40}: expected one of {', '.join(ACTIVATION_NAMES)}")


@dataclass(frozen=True)
class Wiring:
    """What a plain genome's network consists of: nodes that an output needs, in evaluation order, and their enabled links."""

    order: tuple[int, ...]
    links: Mapping[int, tuple[DefaultConnectionGene, ...]]


def wiring(genome: PlainGenome, num_outputs: int) -> Wiring:
    """The nodes and links that count, as neat-python's ``FeedForwardNetwork.create`` sees them.

    A link of weight zero counts. A hidden node without links is there, as a constant. Nodes come in layers of those whose sources
    are known, by key, which neat-python leaves to sets.

    Raises:
        BitneatError: if links form a cycle, which those of a damaged file may.
    """
    into: dict[int, list[DefaultConnectionGene]] = {key: [] for key in genome.nodes}
    for link in genome.connections.values():
        if link.enabled:
            into[link.key[1]].append(link)
    needed = set(range(num_outputs))
    pending = sorted(needed)
    while pending:
        for link in into[pending.pop()]:
            source = link.key[0]
            if source >= 0 and source not in needed:
                needed.add(source)
                pending.append(source)
    order: list[int] = []
    placed: set[int] = set()
    waiting = sorted(needed)
    while waiting:
        ready = [key for key in waiting if all(link.key[0] < 0 or link.key[0] in placed for link in into[key])]
        if not ready:
            raise BitneatError(f"nodes {', '.join(map(str, waiting[:5]))}: form a cycle")
        order.extend(ready)
        placed.update(ready)
        waiting = [key for key in waiting if key not in placed]
    return Wiring(tuple(order), {key: tuple(into[key]) for key in order})
