# SPDX-License-Identifier: MIT
"""Speciation and reproduction as in the Bit-Pedal Walker paper: neat-python's own, and softmax sampling over fitness.

A genome's ``fitness`` is its mean reward. What is here beyond neat-python's classes lets a run be saved and resumed to the same
bytes.
"""

from __future__ import annotations

import math
import random
from typing import Any

from neat.innovation import InnovationTracker
from neat.reproduction import DefaultReproduction
from neat.species import DefaultSpeciesSet, Species
from neat.stagnation import DefaultStagnation

from bitneat.errors import BitneatError
from bitneat.evolve.indexer import Indexer


class PlainSpeciesSet(DefaultSpeciesSet):  # type: ignore[misc]
    """neat-python's speciation with a fixed threshold."""

    def __init__(self, config: Any, reporters: Any) -> None:
        super().__init__(config, reporters)
        self.indexer = Indexer(1)
        self.threshold: float = config.compatibility_threshold

    def past(self, group: Species) -> list[Any]:
        """What a checkpoint must hold of a species besides its members: when it improved, and its fitness so far."""
        return [group.last_improved, list(group.fitness_history)]

    def remember(self, group: Species, past: list[Any]) -> None:
        """Give a species back its past."""
        last_improved, history = past
        if type(last_improved) is not int or not all(type(f) is float and math.isfinite(f) for f in history):
            raise BitneatError("species: expected a generation and finite numbers as its past")
        group.last_improved, group.fitness_history = last_improved, list(history)


class PlainStagnation(DefaultStagnation):  # type: ignore[misc]
    """neat-python's: a species whose best has not improved for ``max_stagnation`` generations is removed, but for the best few."""

    def __init__(self, config: Any, reporters: Any) -> None:
        config.species_fitness_func = "max"
        super().__init__(config, reporters)


class PlainReproduction(DefaultReproduction):  # type: ignore[misc]
    """neat-python's: offspring in proportion to shared fitness, parents from the best part of a species."""

    def __init__(self, config: Any, reporters: Any, stagnation: Any) -> None:
        super().__init__(config, reporters, stagnation)
        self.genome_indexer = Indexer(1)
        self.innovation_tracker = InnovationTracker()

    def reproduce(self, config: Any, species: Any, pop_size: int, generation: int) -> dict[int, Any]:
        """The next generation.

        Raises:
            BitneatError: if there are so many species that the least number for each does not fit the population.
        """
        self.ancestors.clear()  # a long run would never forget them
        try:
            population: dict[int, Any] = super().reproduce(config, species, pop_size, generation)
        except RuntimeError as error:
            raise BitneatError(
                f"[NEAT] pop_size: {len(species.species)} species do not fit; raise [PlainSpeciesSet]"
                f" compatibility_threshold ({' '.join(str(error).split())})"
            ) from None
        return population


class SoftmaxReproduction(PlainReproduction):
    """Every child is a copy of a parent drawn from the whole population with a probability in proportion to exp(beta * fitness).

    ``survival_threshold`` is the best part of the population that may be drawn, ``mutation_rate`` the part of the children that
    mutate. Species are kept for the record only.
    """

    def reproduce(self, config: Any, species: Any, pop_size: int, generation: int) -> dict[int, Any]:
        """The next generation: the elites under their old keys, then copies."""
        del generation
        settings = self.reproduction_config
        config.genome_config.innovation_tracker = self.innovation_tracker
        self.innovation_tracker.reset_generation()
        everyone = [member for group in species.species.values() for member in group.members.values()]
        everyone.sort(key=lambda genome: (-genome.fitness, genome.key))
        pool = everyone[: max(1, math.ceil(settings.survival_threshold * len(everyone)))]
        weights = [math.exp(settings.beta * (genome.fitness - pool[0].fitness)) for genome in pool]
        population = {elite.key: elite for elite in everyone[: settings.elitism]}
        while len(population) < pop_size:
            child = config.genome_type(next(self.genome_indexer))
            child.configure_clone(random.choices(pool, weights)[0])
            if random.random() < settings.mutation_rate:
                child.mutate(config.genome_config)
            population[child.key] = child
        return population
