# SPDX-License-Identifier: MIT
"""The kinds of genome that a run may evolve, each behind the same few methods: how the search sees none of them in particular."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Protocol

from bitneat.controller import Controller, Input, Link, Node
from bitneat.errors import BitneatError
from bitneat.evolve.config import UNWEIGHTED, Config
from bitneat.evolve.genome import BitGenome, BitGenomeConfig, genome_from_data, genome_to_data
from bitneat.evolve.lowering import lower, lower_float, lower_integer, with_shared_weight
from bitneat.evolve.plain import PlainGenome, PlainGenomeConfig, plain_from_data, plain_to_data
from bitneat.network import Policy

_TUNING_RESOLUTION = 4
"""A tuned shared weight is a multiple of 2^-4."""
_TUNING_LARGEST = 3.0


class Kind(Protocol):
    """What the search needs to know of its genomes."""

    genome_type: type[Any]
    settings: Any
    """neat-python's configuration of the genome."""

    def lower(self, genome: Any) -> tuple[Policy, ...]:
        """What runs in the episodes for a genome; its score is the mean over all of them."""

    def tuned(self, policy: Policy) -> list[Policy]:
        """Variations of a finalist that are tried before the champion is chosen; none for most kinds."""

    def to_data(self, genome: Any) -> list[Any]:
        """The genome as plain data."""

    def from_data(self, data: list[Any]) -> Any:
        """Read what `to_data` wrote."""

    def check(self, genome: Any, where: str) -> None:
        """Look at what the search does not.

        Raises:
            BitneatError: if a gene has a value that it cannot have.
        """


class BitKind:
    """Ternary weights and gains: `bitneat.evolve.genome`."""

    genome_type: type[Any] = BitGenome

    def __init__(self, config: Config, inputs: tuple[Input, ...], num_outputs: int) -> None:
        self.settings: Any = BitGenomeConfig(dict(config["BitGenome"]), len(inputs), num_outputs)
        self._inputs, self._num_outputs = inputs, num_outputs
        self._frac_bits: int = config["evolve"]["frac_bits"]

    def controller(self, genome: BitGenome) -> Controller:
        """The controller of a genome."""
        return lower(genome, self._inputs, self._num_outputs, self._frac_bits)

    def lower(self, genome: BitGenome) -> tuple[Policy, ...]:
        """The controller."""
        return (self.controller(genome),)

    def tuned(self, policy: Policy) -> list[Policy]:
        """None."""
        del policy
        return []

    def to_data(self, genome: BitGenome) -> list[Any]:
        """The genome as plain data."""
        return genome_to_data(genome)

    def from_data(self, data: list[Any]) -> BitGenome:
        """Read what `to_data` wrote."""
        return genome_from_data(data)

    def check(self, genome: BitGenome, where: str) -> None:
        """Gains, weights and delays."""
        if any(type(node.gain) is not int for node in genome.nodes.values()):
            raise BitneatError(f"{where}: a node has a wrong gain")
        for link in genome.connections.values():
            if type(link.weight) is not int or not -1 <= link.weight <= 1 or link.delay not in (0, 1):
                raise BitneatError(f"{where}: a link has a wrong weight or delay")


class WeightAgnosticKind(BitKind):
    """Topologies whose links all share one weight, tried with several (Gaier and Ha 2019, "Weight Agnostic Neural Networks")."""

    def __init__(self, config: Config, inputs: tuple[Input, ...], num_outputs: int) -> None:
        # A topology has neither: their mutations would make copies of it, and the genetic distance would see what is not there.
        super().__init__(config.with_values("BitGenome", **dict.fromkeys(UNWEIGHTED, 0)), inputs, num_outputs)
        self._weights = [_units(weight) for weight in config["WeightAgnostic"]["shared_weights"]]

    def lower(self, genome: BitGenome) -> tuple[Policy, ...]:
        """A controller for each of the shared weights."""
        base = _topology(self.controller(genome))
        return tuple(with_shared_weight(base, *weight) for weight in self._weights)

    def tuned(self, policy: Policy) -> list[Policy]:
        """The same topology with every multiple of 2^-4 as its shared weight, from -3 to 3."""
        assert isinstance(policy, Controller)
        largest = int(_TUNING_LARGEST * (1 << _TUNING_RESOLUTION))
        base = _topology(policy)
        return [with_shared_weight(base, *_lowest_terms(u)) for u in range(-largest, largest + 1) if u]


def _units(weight: float) -> tuple[int, int]:
    """A shared weight as (units, resolution): units / 2^resolution, in lowest terms; resolution may be negative."""
    resolution = next(r for r in range(-7, 8) if math.ldexp(weight, r).is_integer())
    return int(math.ldexp(weight, resolution)), resolution


def _lowest_terms(sixteenths: int) -> tuple[int, int]:
    return _units(sixteenths / (1 << _TUNING_RESOLUTION))


def _topology(controller: Controller) -> Controller:
    """The controller with every weight 1, no biases and no gains."""
    nodes = []
    for node in controller.nodes:
        sources = sorted({(link.source, link.delay) for link in node.links})
        links = tuple(Link(source, delay, 0, 1) for source, delay in sources)
        nodes.append(Node(links, 0, 0, node.activation))
    return replace(controller, nodes=tuple(nodes)).canonical


class PlainKind:
    """neat-python's own genome with float, integer or ternary weights: `bitneat.evolve.plain`."""

    genome_type: type[Any] = PlainGenome

    def __init__(self, config: Config, inputs: tuple[Input, ...], num_outputs: int) -> None:
        self.settings: Any = PlainGenomeConfig(config["PlainGenome"], len(inputs), num_outputs)
        self._inputs, self._num_outputs = inputs, num_outputs
        self._frac_bits: int = config["evolve"]["frac_bits"]
        self._weights: str = config["PlainGenome"]["weights"]
        self._activations: tuple[str, ...] = config["PlainGenome"]["activations"]

    def lower(self, genome: PlainGenome) -> tuple[Policy, ...]:
        """A float network, or a controller for the other weights."""
        if self._weights == "float":
            return (lower_float(genome, len(self._inputs), self._num_outputs),)
        return (lower_integer(genome, self._inputs, self._num_outputs, self._frac_bits),)

    def tuned(self, policy: Policy) -> list[Policy]:
        """None."""
        del policy
        return []

    def to_data(self, genome: PlainGenome) -> list[Any]:
        """The genome as plain data."""
        return plain_to_data(genome)

    def from_data(self, data: list[Any]) -> PlainGenome:
        """Read what `to_data` wrote."""
        return plain_from_data(data, self._weights, self._activations)

    def check(self, genome: PlainGenome, where: str) -> None:
        """Weights and biases."""
        number = (int, float) if self._weights == "float" else (int,)
        values = [link.weight for link in genome.connections.values()]
        values += [node.bias for node in genome.nodes.values()]
        if not all(type(value) in number and math.isfinite(value) for value in values):
            raise BitneatError(f"{where}: a weight or bias is wrong")
        if self._weights != "ternary":
            return
        if any(abs(value) > 1 for value in values):
            raise BitneatError(f"{where}: a weight is not -1, 0 or 1")


_KINDS: dict[str, type[BitKind | PlainKind]] = {
    "BitGenome": BitKind,
    "WeightAgnostic": WeightAgnosticKind,
    "PlainGenome": PlainKind,
}


def kind_for(config: Config, inputs: tuple[Input, ...], num_outputs: int) -> Kind:
    """What the configuration's ``[NEAT] genome`` names."""
    return _KINDS[config["NEAT"]["genome"]](config, inputs, num_outputs)
