# SPDX-License-Identifier: MIT
"""The genes of the ternary genome: nodes and links with their attributes, and how each attribute mutates.

Everything random here comes from the global ``random``, as in neat-python; `bitneat.evolve.randomness` puts a stream of
our own under it.
"""

from __future__ import annotations

import random
from typing import Any, ClassVar

from neat.attributes import BaseAttribute, BoolAttribute, StringAttribute
from neat.genes import BaseGene, DefaultConnectionGene


class TernaryAttribute(BaseAttribute):  # type: ignore[misc]
    """A weight in {-1, 0, +1}. A mutation always changes it: to the other sign, or with ``zero_rate`` to 0."""

    _config_items: ClassVar[dict[str, list[Any]]] = {"zero_rate": [float, None]}

    def init_value(self, config: Any) -> int:
        """A random sign; a new link is never a zero."""
        return random.choice((-1, 1))

    def mutate_value(self, value: int, config: Any) -> int:
        """Another value of the three."""
        if value == 0:
            return random.choice((-1, 1))
        return 0 if random.random() < getattr(config, self.zero_rate_name) else -value

    def validate(self, config: Any) -> None:
        """Nothing to check beyond the schema."""


class GainAttribute(BaseAttribute):  # type: ignore[misc]
    """The exponent of a power-of-two gain. A mutation moves it by one, rarely by two, within its range."""

    _config_items: ClassVar[dict[str, list[Any]]] = {
        "min_value": [int, None],
        "max_value": [int, None],
        "init_min": [int, None],
        "init_max": [int, None],
    }

    def init_value(self, config: Any) -> int:
        """Uniform over the initial range."""
        return random.randint(getattr(config, self.init_min_name), getattr(config, self.init_max_name))

    def mutate_value(self, value: int, config: Any) -> int:
        """A neighbouring gain."""
        low: int = getattr(config, self.min_value_name)
        high: int = getattr(config, self.max_value_name)
        if low == high:
            return low
        distance = 2 if random.random() < 0.2 else 1
        moved = value + (distance if random.random() < 0.5 else -distance)
        if not low <= moved <= high:
            moved = 2 * value - moved
        return min(max(moved, low), high)

    def validate(self, config: Any) -> None:
        """Nothing to check beyond the schema."""


class SignBiasAttribute(BaseAttribute):  # type: ignore[misc]
    """A link from a constant one: -1, 0 or +1, and 0 at the start."""

    _config_items: ClassVar[dict[str, list[Any]]] = {}

    def init_value(self, config: Any) -> int:
        """No bias."""
        return 0

    def mutate_value(self, value: int, config: Any) -> int:
        """Another value of the three."""
        return random.choice([other for other in (-1, 0, 1) if other != value])

    def validate(self, config: Any) -> None:
        """Nothing to check."""


class DelayAttribute(SignBiasAttribute):
    """Whether a link reads the step before: 0 or 1."""

    def mutate_value(self, value: int, config: Any) -> int:
        """The other one."""
        return 1 - value


class ActivationAttribute(StringAttribute):  # type: ignore[misc]
    """An activation; unlike neat-python's, a mutation takes another one than the present, if there is another."""

    def mutate_value(self, value: str, config: Any) -> str:
        """Another of the options."""
        others = [option for option in getattr(config, self.options_name) if option != value]
        return random.choice(others) if others else value


class BitNodeGene(BaseGene):  # type: ignore[misc]
    """A node: gain, bias and activation."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [
        GainAttribute("gain"),
        SignBiasAttribute("bias"),
        ActivationAttribute("activation"),
    ]

    gain: int
    bias: int
    activation: str

    def distance(self, other: BitNodeGene, config: Any) -> float:
        """How different two nodes of the same key are: at most about 2."""
        difference = min(abs(self.gain - other.gain), 4) / 4 + (self.bias != other.bias) / 2
        return float((difference + (self.activation != other.activation)) * config.compatibility_weight_coefficient)


class BitConnectionGene(DefaultConnectionGene):  # type: ignore[misc]
    """A link: weight, whether it is enabled, and its delay."""

    _gene_attributes: ClassVar[list[BaseAttribute]] = [
        TernaryAttribute("weight"),
        BoolAttribute("enabled", default="True", mutate_rate=0.0),
        DelayAttribute("delay"),
    ]

    key: tuple[int, int]
    innovation: int
    weight: int
    enabled: bool
    delay: int

    def distance(self, other: BitConnectionGene, config: Any) -> float:
        """How different two links of the same key are: 0 to 2."""
        difference = (
            (self.weight != other.weight) + (self.enabled != other.enabled) / 2 + (self.delay != other.delay) / 2
        )
        return float(difference * config.compatibility_weight_coefficient)

    @property
    def counts(self) -> bool:
        """True iff the link exists for the network: a weight of zero is the absence of a link."""
        return self.enabled and self.weight != 0


_ATTRIBUTES: dict[str, BaseAttribute] = {
    attribute.name: attribute for attribute in (*BitNodeGene._gene_attributes, *BitConnectionGene._gene_attributes)
}


def mutate_attribute(gene: BaseGene, name: str, config: Any) -> bool:
    """Give an attribute of a gene another value; False if it stays."""
    before = getattr(gene, name)
    after = _ATTRIBUTES[name].mutate_value(before, config)
    setattr(gene, name, after)
    return bool(after != before)
