# SPDX-License-Identifier: MIT
"""The ternary genome, on neat-python's genes and attributes.

neat-python mutates every gene of a child with some probability, so that children of large genomes change more than those
of small ones. Here a child undergoes a *number* of mutations that its size does not change: one, and a Poisson number
more. Each is drawn from the table of `MUTATIONS` with the weights in the configuration. In a search with ternary weights that
count matters most: one to five changes a child work, dozens are noise.

Everything random here comes from the global ``random``, as in neat-python; `bitneat.evolve.randomness` puts a stream of
our own under it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from typing import Any

from neat.genome import DefaultGenome, DefaultGenomeConfig

from bitneat.controller import ACTIVATION_NAMES
from bitneat.controller.ir import MAX_SIGNALS
from bitneat.evolve.genes import BitConnectionGene, BitNodeGene, mutate_attribute
from bitneat.evolve.indexer import Indexer


class BitGenomeConfig(DefaultGenomeConfig):  # type: ignore[misc]
    """neat-python's genome configuration with our own entries; saving it changes nothing.

    Args:
        settings: the checked entries of the section [BitGenome].
        num_inputs: of the environment.
        num_outputs: of the environment.
    """

    def __init__(self, settings: dict[str, Any], num_inputs: int, num_outputs: int) -> None:
        parameters = {
            "node_gene_type": BitNodeGene,
            "connection_gene_type": BitConnectionGene,
            "num_inputs": str(num_inputs),
            "num_outputs": str(num_outputs),
            "num_hidden": str(settings["num_hidden"]),
            "feed_forward": "True",
            "initial_connection": "unconnected",
            "compatibility_disjoint_coefficient": str(settings["compatibility_disjoint_coefficient"]),
            "compatibility_weight_coefficient": str(settings["compatibility_weight_coefficient"]),
            # Mutation follows MUTATIONS instead.
            "conn_add_prob": "0.0",
            "conn_delete_prob": "0.0",
            "node_add_prob": "0.0",
            "node_delete_prob": "0.0",
            "gain_min_value": str(settings["gain_min"]),
            "gain_max_value": str(settings["gain_max"]),
            "gain_init_min": str(settings["gain_init_min"]),
            "gain_init_max": str(settings["gain_init_max"]),
            "activation_default": "random",
            "activation_options": " ".join(settings["activations"]),
            "activation_mutate_rate": "0.0",
            "weight_zero_rate": str(settings["weight_zero_rate"]),
        }
        super().__init__(parameters, "BitGenome")
        self.node_indexer = Indexer(num_outputs)
        self.initial_links: float = settings["initial_links"]
        self.mutations: float = settings["mutations"]
        self.max_nodes: int = min(settings["max_nodes"], MAX_SIGNALS - num_inputs)
        self.max_links: int = settings["max_links"]
        self.output_activation: str = settings["output_activation"]
        self.mutation_names: list[str] = list(MUTATIONS)
        self.mutation_weights: list[float] = [settings[f"mutate_{name}"] for name in MUTATIONS]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__.copy()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


class BitGenome(DefaultGenome):  # type: ignore[misc]
    """A genome of ternary links between nodes with power-of-two gains."""

    key: int
    nodes: dict[int, BitNodeGene]
    connections: dict[tuple[int, int], BitConnectionGene]
    fitness: float | None

    def configure_new(self, config: BitGenomeConfig) -> None:
        """Outputs, the hidden nodes asked for, and about ``initial_links`` random links to each node, ``max_links`` at most."""
        for key in config.output_keys:
            self._add_node_gene(config, key)
        hidden = [config.get_new_node_key(self.nodes) for _ in range(config.num_hidden)]
        for key in hidden:
            self._add_node_gene(config, key)
        for key in [*hidden, *config.output_keys]:
            sources = config.input_keys if key in hidden else [*config.input_keys, *hidden]
            wanted = min(len(sources), _poisson(config.initial_links))
            for source in random.sample(sources, min(wanted, config.max_links - len(self.connections))):
                self._link(config, source, key)

    def configure_crossover(self, genome1: BitGenome, genome2: BitGenome, config: BitGenomeConfig) -> None:
        """The structure of the fitter parent; attributes of shared genes from either.

        Genes are lined up by key: node keys are never used twice, so that equal keys mean a common origin. A delay stays with
        the fitter parent, since another one could close a cycle.
        """
        del config
        first, second = (genome1, genome2) if _fitness(genome1) >= _fitness(genome2) else (genome2, genome1)
        for key, link in first.connections.items():
            child = link.copy()
            other = second.connections.get(key)
            if other is not None and random.random() < 0.5:
                child.weight, child.enabled = other.weight, other.enabled
            self.connections[key] = child
        for node_key, node in first.nodes.items():
            node_child = node.copy()
            other_node = second.nodes.get(node_key)
            if other_node is not None and random.random() < 0.5:
                node_child.gain, node_child.bias = other_node.gain, other_node.bias
                node_child.activation = other_node.activation
            self.nodes[node_key] = node_child

    def configure_clone(self, parent: BitGenome) -> None:
        """A copy of the parent."""
        self.connections = {key: link.copy() for key, link in parent.connections.items()}
        self.nodes = {key: node.copy() for key, node in parent.nodes.items()}

    def mutate(self, config: BitGenomeConfig) -> None:
        """One mutation and a Poisson number more, so that ``mutations`` is their mean."""
        changes_left = 1 + _poisson(config.mutations - 1.0)
        attempts = 10 * changes_left
        while changes_left and attempts:
            attempts -= 1
            name = random.choices(config.mutation_names, config.mutation_weights)[0]
            changes_left -= MUTATIONS[name](self, config)
        self._drop_zeros()

    def mutate_weight(self, config: BitGenomeConfig) -> bool:
        """Change one weight."""
        return self._mutate_link_attribute(config, "weight")

    def mutate_gain(self, config: BitGenomeConfig) -> bool:
        """Change one gain."""
        return self._mutate_node_attribute(config, "gain")

    def mutate_bias(self, config: BitGenomeConfig) -> bool:
        """Change one bias."""
        return self._mutate_node_attribute(config, "bias")

    def mutate_activation(self, config: BitGenomeConfig) -> bool:
        """Change one activation; those of the outputs only if the configuration leaves them free."""
        return self._mutate_node_attribute(config, "activation")

    def mutate_delay(self, config: BitGenomeConfig) -> bool:
        """Turn a link into a delayed one or back, or add a delayed link, which may also point backwards."""
        if self.connections and random.random() < 0.5:
            link = self.connections[random.choice(list(self.connections))]
            if link.delay and (link.key[0] in config.output_keys or self._closes_cycle(*link.key)):
                return False
            link.delay = 1 - link.delay
            return True
        source = random.choice([*config.input_keys, *sorted(self.nodes)])
        target = random.choice(sorted(self.nodes))
        if (source, target) in self.connections or len(self.connections) >= config.max_links:
            return False
        self._link(config, source, target).delay = 1
        return True

    def mutate_add_link(self, config: BitGenomeConfig) -> bool:
        """Add a link between an input or hidden node and a node, where there is none."""
        if len(self.connections) >= config.max_links:
            return False
        target = random.choice(sorted(self.nodes))
        source = self._random_source(config)
        if (source, target) in self.connections or self._closes_cycle(source, target):
            return False
        self._link(config, source, target)
        return True

    def mutate_delete_link(self, config: BitGenomeConfig) -> bool:
        """Remove one link."""
        del config
        if not self.connections:
            return False
        del self.connections[random.choice(list(self.connections))]
        return True

    def mutate_rewire(self, config: BitGenomeConfig) -> bool:
        """Move one end of a link elsewhere; it keeps its sign and becomes a new gene."""
        if not self.connections:
            return False
        link = self.connections[random.choice(list(self.connections))]
        source, target = link.key
        if random.random() < 0.5:
            source = self._random_source(config)
        else:
            target = random.choice(sorted(self.nodes))
        if (source, target) in self.connections or (not link.delay and self._closes_cycle(source, target)):
            return False
        if source in config.output_keys and not link.delay:
            return False
        del self.connections[link.key]
        moved = self._link(config, source, target)
        moved.weight, moved.delay = link.weight, link.delay
        return True

    def mutate_split(self, config: BitGenomeConfig) -> bool:
        """Put a node into a link, as NEAT's add-node does: the link is replaced by two, the first of weight one."""
        candidates = [key for key, link in self.connections.items() if link.counts and not link.delay]
        if not candidates or not self._room(config, 2):
            return False
        source, target = random.choice(candidates)
        link = self.connections.pop((source, target))
        node = self._new_node(config)
        self._link(config, source, node).weight = 1
        self._link(config, node, target).weight = link.weight
        return True

    def mutate_path(self, config: BitGenomeConfig) -> bool:
        """Add a node beside what is there: one to three links into it and one out of it."""
        if not self._room(config, 4):
            return False
        target = random.choice(sorted(self.nodes))
        ancestors_first = [*config.input_keys, *self._not_after(config, target)]
        node = self._new_node(config)
        for source in random.sample(ancestors_first, min(len(ancestors_first), random.randint(1, 3))):
            self._link(config, source, node)
        self._link(config, node, target)
        return True

    def mutate_delete_node(self, config: BitGenomeConfig) -> bool:
        """Remove a hidden node with its links."""
        hidden = [key for key in self.nodes if key not in config.output_keys]
        if not hidden:
            return False
        self._remove_node(random.choice(hidden))
        return True

    def mutate_bypass_node(self, config: BitGenomeConfig) -> bool:
        """Remove a hidden node and link each of its sources straight to each of its readers, unless linked already."""
        hidden = [key for key in self.nodes if key not in config.output_keys]
        if not hidden:
            return False
        node = random.choice(hidden)
        into = [link for key, link in self.connections.items() if key[1] == node and key[0] != node and link.counts]
        out = [link for key, link in self.connections.items() if key[0] == node and key[1] != node and link.counts]
        if len(into) * len(out) > 6:
            return False
        kept = {key for key in self.connections if node not in key}
        ends = {
            (first.key[0], second.key[1]): first.weight * second.weight
            for first in into
            for second in out
            if not first.delay and not second.delay
        }
        new = {key: weight for key, weight in ends.items() if key not in kept}
        if len(kept) + len(new) > config.max_links:
            return False
        self._remove_node(node)
        for key, weight in new.items():
            self._link(config, *key).weight = weight
        return True

    def size(self) -> tuple[int, int]:
        """Nodes, and links that count."""
        return len(self.nodes), sum(link.counts for link in self.connections.values())

    def _add_node_gene(self, config: BitGenomeConfig, key: int) -> None:
        gene = BitNodeGene(key)
        gene.init_attributes(config)
        if key in config.output_keys and config.output_activation != "any":
            gene.activation = config.output_activation
        self.nodes[key] = gene

    def _new_node(self, config: BitGenomeConfig) -> int:
        key: int = config.get_new_node_key(self.nodes)
        self._add_node_gene(config, key)
        return key

    def _remove_node(self, node: int) -> None:
        del self.nodes[node]
        self.connections = {key: link for key, link in self.connections.items() if node not in key}

    def _link(self, config: BitGenomeConfig, source: int, target: int) -> BitConnectionGene:
        innovation = config.innovation_tracker.get_innovation_number(source, target, "add_connection")
        link = BitConnectionGene((source, target), innovation=innovation)
        link.init_attributes(config)
        link.delay = 0
        self.connections[link.key] = link
        return link

    def _room(self, config: BitGenomeConfig, links: int) -> bool:
        return len(self.nodes) < config.max_nodes and len(self.connections) + links <= config.max_links

    def _random_source(self, config: BitGenomeConfig) -> int:
        """An input in half of the cases, so that many inputs do not crowd out the few hidden nodes."""
        hidden = [key for key in sorted(self.nodes) if key not in config.output_keys]
        inputs: list[int] = config.input_keys
        return random.choice(hidden if hidden and random.random() < 0.5 else inputs)

    def _mutate_link_attribute(self, config: BitGenomeConfig, name: str) -> bool:
        if not self.connections:
            return False
        return mutate_attribute(self.connections[random.choice(list(self.connections))], name, config)

    def _mutate_node_attribute(self, config: BitGenomeConfig, name: str) -> bool:
        key = random.choice(sorted(self.nodes))
        if name == "activation" and key in config.output_keys and config.output_activation != "any":
            return False
        return mutate_attribute(self.nodes[key], name, config)

    def _drop_zeros(self) -> None:
        """Forget a link of weight zero now and then: for a while it can come back, but it must not pile up."""
        self.connections = {key: link for key, link in self.connections.items() if link.counts or random.random() < 0.8}

    def _closes_cycle(self, source: int, target: int) -> bool:
        """True iff an undelayed link source → target would close a cycle: source is reachable from target."""
        return source == target or source in self._after(target)

    def _after(self, start: int) -> set[int]:
        """The nodes that depend on ``start`` through undelayed links."""
        readers: dict[int, list[int]] = {}
        for (source, target), link in self.connections.items():
            if not link.delay:
                readers.setdefault(source, []).append(target)
        reached: set[int] = set()
        pending = [start]
        while pending:
            for reader in readers.get(pending.pop(), ()):
                if reader not in reached:
                    reached.add(reader)
                    pending.append(reader)
        return reached

    def _not_after(self, config: BitGenomeConfig, target: int) -> list[int]:
        """The hidden nodes that can come before ``target``."""
        excluded = self._after(target) | {target} | set(config.output_keys)
        return [key for key in sorted(self.nodes) if key not in excluded]


MUTATIONS: dict[str, Callable[[BitGenome, BitGenomeConfig], bool]] = {
    "weight": BitGenome.mutate_weight,
    "gain": BitGenome.mutate_gain,
    "bias": BitGenome.mutate_bias,
    "activation": BitGenome.mutate_activation,
    "delay": BitGenome.mutate_delay,
    "add_link": BitGenome.mutate_add_link,
    "delete_link": BitGenome.mutate_delete_link,
    "rewire": BitGenome.mutate_rewire,
    "split": BitGenome.mutate_split,
    "path": BitGenome.mutate_path,
    "delete_node": BitGenome.mutate_delete_node,
    "bypass_node": BitGenome.mutate_bypass_node,
}
"""Every mutation by name; ``mutate_NAME`` in the section [BitGenome] is its weight. Each says whether it changed anything."""


def genome_to_data(genome: BitGenome) -> list[Any]:
    """The genome as plain data, genes in their order, which later draws depend on."""
    return [
        genome.key,
        genome.fitness,
        [[node.key, node.gain, node.bias, ACTIVATION_NAMES.index(node.activation)] for node in genome.nodes.values()],
        [
            [*link.key, link.innovation, link.weight, int(link.enabled), link.delay]
            for link in genome.connections.values()
        ],
    ]


def genome_from_data(data: list[Any]) -> BitGenome:
    """Read what `genome_to_data` wrote."""
    key, fitness, nodes, links = data
    genome = BitGenome(key)
    genome.fitness = fitness
    for node_key, gain, bias, activation in nodes:
        node = BitNodeGene(node_key)
        node.gain, node.bias, node.activation = gain, bias, ACTIVATION_NAMES[activation]
        genome.nodes[node_key] = node
    for source, target, innovation, weight, enabled, delay in links:
        link = BitConnectionGene((source, target), innovation=innovation)
        link.weight, link.enabled, link.delay = weight, bool(enabled), delay
        genome.connections[link.key] = link
    return genome


def same_network(first: BitGenome, second: BitGenome) -> bool:
    """True iff two genomes have the same genes, apart from innovation numbers."""
    return genome_to_data(first)[2] == genome_to_data(second)[2] and _links(first) == _links(second)


def _links(genome: BitGenome) -> Iterable[tuple[Any, ...]]:
    return sorted((*link.key, link.weight, link.enabled, link.delay) for link in genome.connections.values())


def _poisson(mean: float) -> int:
    """A Poisson number by Knuth's product of uniform draws; fit for small means."""
    threshold = math.exp(-max(mean, 0.0))
    count, product = 0, random.random()
    while product > threshold:
        count += 1
        product *= random.random()
    return count


def _fitness(genome: BitGenome) -> float:
    return -math.inf if genome.fitness is None else genome.fitness
