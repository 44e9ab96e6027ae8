# SPDX-License-Identifier: MIT
"""Species and reproduction on neat-python's framework, by rank.

A genome's ``fitness`` is its rank in the race, scaled to [0, 1]: noisy rewards order genomes, their sizes say nothing.
Elites are the best of the species that are kept, and they run again in the next generation on its seeds.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any

from neat.innovation import InnovationTracker
from neat.reproduction import DefaultReproduction
from neat.species import DefaultSpeciesSet, GenomeDistanceCache, Species

from bitneat.evolve.genome import BitGenome, same_network
from bitneat.evolve.indexer import Indexer


class Settings:
    """Checked entries as attributes, the way neat-python's classes hold their configuration."""

    def __init__(self, entries: Mapping[str, Any]) -> None:
        self.__dict__.update(entries)


class BitSpeciesSet(DefaultSpeciesSet):  # type: ignore[misc]
    """neat-python's speciation, with a threshold that drifts toward the wanted number of species."""

    def __init__(self, config: Any, reporters: Any) -> None:
        super().__init__(config, reporters)
        self.indexer = Indexer(1)
        self.threshold: float = config.compatibility_threshold

    def speciate(self, config: Any, population: dict[int, BitGenome], generation: int) -> None:
        """Partition the population, by a threshold that is sought for it or that is adjusted for the next time."""
        settings = self.species_set_config
        self._keep_oldest(population)
        if settings.threshold_trials:
            self.threshold = self._sought(config, population)
        settings.compatibility_threshold = self.threshold
        super().speciate(config, population, generation)
        excess = len(self.species) - settings.target_species
        if excess and not settings.threshold_trials:
            self.threshold = min(max(self.threshold * (1.1 if excess > 0 else 0.92), 0.05), 20.0)

    def _sought(self, config: Any, population: dict[int, BitGenome]) -> float:
        """The present threshold if it gives the wanted number of species, else the nearest of a bisection.

        Distances are means over genes, so what tells relatives apart depends on the size of their genomes: a linear policy of two
        hundred links and its mutants are a hundredth apart.
        """
        wanted = self.species_set_config.target_species
        distances = GenomeDistanceCache(config.genome_config)
        too_small, too_large = 0.0, math.inf
        nearest, threshold = (math.inf, self.threshold), self.threshold
        for _ in range(self.species_set_config.threshold_trials):
            count = self._count(population, threshold, distances, 2 * wanted)
            nearest = min(nearest, (abs(count - wanted), threshold))
            if count == wanted:
                break
            if count > wanted:
                too_small = threshold
                threshold = min(2 * threshold, 20.0) if too_large == math.inf else math.sqrt(too_small * too_large)
            else:
                too_large = threshold
                threshold = max(threshold / 2, 0.001) if too_small == 0.0 else math.sqrt(too_small * too_large)
        return nearest[1]

    def _count(
        self, population: dict[int, BitGenome], threshold: float, distances: GenomeDistanceCache, enough: int
    ) -> int:
        """How many species `speciate` would make, counted no further than ``enough``."""
        left = sorted(population)
        found = []
        for key in sorted(self.species):
            old = self.species[key].representative
            nearest = min(left, key=lambda one: distances(old, population[one]))
            left.remove(nearest)
            found.append(population[nearest])
        for key in left:
            if len(found) > enough:
                break
            if all(distances(one, population[key]) >= threshold for one in found):
                found.append(population[key])
        return len(found)

    def past(self, group: Species) -> list[Any]:
        """What a checkpoint must hold of a species besides its members: nothing."""
        del group
        return []

    def remember(self, group: Species, past: list[Any]) -> None:
        """Give a species back its past."""
        del group, past

    def _keep_oldest(self, population: dict[int, BitGenome]) -> None:
        """neat-python needs a genome for each old species; where there are fewer, the youngest species go."""
        for key in sorted(self.species)[len(population) :]:
            del self.species[key]


class NoStagnation:
    """No species is removed for standing still: ranks are relative, so that a species that does will shrink anyway."""

    def __init__(self, config: Any, reporters: Any) -> None:
        del config, reporters

    def update(self, species_set: BitSpeciesSet, generation: int) -> list[tuple[int, Species, bool]]:
        """Every species, none stagnant."""
        del generation
        return [(key, species_set.species[key], False) for key in sorted(species_set.species)]


class BitReproduction(DefaultReproduction):  # type: ignore[misc]
    """Elites of the species that are kept, then children of each, fewer by ``species_decay`` from one place to the next."""

    def __init__(self, config: Any, reporters: Any, stagnation: Any) -> None:
        super().__init__(config, reporters, stagnation)
        self.genome_indexer = Indexer(1)
        self.innovation_tracker = InnovationTracker()

    def create_new(self, genome_type: type[BitGenome], genome_config: Any, num_genomes: int) -> dict[int, BitGenome]:
        """A population from scratch; ancestors are not recorded, since a long run would never forget them."""
        genome_config.innovation_tracker = self.innovation_tracker
        population = {}
        for _ in range(num_genomes):
            key = next(self.genome_indexer)
            population[key] = genome_type(key)
            population[key].configure_new(genome_config)
        return population

    def reproduce(self, config: Any, species: BitSpeciesSet, pop_size: int, generation: int) -> dict[int, BitGenome]:
        """The next generation: exactly ``pop_size`` genomes, the elites under their old keys."""
        settings = self.reproduction_config
        config.genome_config.innovation_tracker = self.innovation_tracker
        self.innovation_tracker.reset_generation()
        groups = [group for _, group, _ in self.stagnation.update(species, generation)]
        most = min(config.species_set_config.target_species, pop_size // (2 * settings.min_species_size))
        groups = _best_species(groups, max(1, most))
        # Most children of any species are broken, so that mean ranks hardly differ; the best member tells more.
        for place, group in enumerate(sorted(groups, key=_best_member)):
            group.adjusted_fitness = settings.species_decay**place
        everyone = sorted((m for group in groups for m in group.members.values()), key=_by_fitness)
        elites = everyone[: min(max(1, round(settings.elitism * pop_size)), pop_size - 1)]
        wanted = pop_size - len(elites)
        sizes = _shares(groups, wanted, settings.min_species_size)
        population = {elite.key: elite for elite in elites}
        for group, size in zip(groups, sizes, strict=True):
            members = sorted(group.members.values(), key=_by_fitness)
            parents = members[: max(1, round(settings.survival_threshold * len(members)))]
            for _ in range(size):
                child = self._child(config, parents, everyone)
                population[child.key] = child
        species.species = {group.key: group for group in groups}
        return population

    def _child(self, config: Any, parents: list[BitGenome], everyone: list[BitGenome]) -> BitGenome:
        settings = self.reproduction_config
        child: BitGenome = config.genome_type(next(self.genome_indexer))
        parent = self._pick(parents)
        if random.random() < settings.crossover:
            # Now and then across species, so that they are not islands for ever.
            mate = self._pick(everyone[: len(parents)] if random.random() < 0.2 else parents)
            child.configure_crossover(parent, mate, config.genome_config)
        else:
            child.configure_clone(parent)
        for _ in range(3):
            child.mutate(config.genome_config)
            if not same_network(child, parent):
                break
        return child

    def _pick(self, candidates: list[BitGenome]) -> BitGenome:
        """The best of a few drawn; candidates are sorted, best first."""
        draws = (random.randrange(len(candidates)) for _ in range(self.reproduction_config.tournament))
        return candidates[min(draws)]


def _by_fitness(genome: BitGenome) -> tuple[float, int]:
    """Best first; the older of equals first."""
    assert genome.fitness is not None
    return -genome.fitness, genome.key


def _best_member(group: Species) -> tuple[float, int]:
    """Sorts species by their best member, best first."""
    return min(map(_by_fitness, group.members.values()))


def _best_species(groups: list[Species], most: int) -> list[Species]:
    """The species with the best members, by key. neat-python's speciation never ends a species, so this must."""
    return sorted(sorted(groups, key=_best_member)[:most], key=lambda group: int(group.key))


def _shares(groups: list[Species], wanted: int, min_size: int) -> list[int]:
    """``wanted`` children split in proportion to adjusted fitness by largest remainders, each at least ``min_size`` if it fits."""
    least = min(min_size, wanted // len(groups))
    spare = wanted - least * len(groups)
    total = 0.0
    for group in groups:  # one after the other: Python's sum has another last bit from version 3.12 on
        total += group.adjusted_fitness
    exact = [spare * (group.adjusted_fitness / total if total > 0 else 1 / len(groups)) for group in groups]
    sizes = [int(share) for share in exact]
    remainders = sorted(range(len(groups)), key=lambda i: (sizes[i] - exact[i], i))
    for index in remainders[: spare - sum(sizes)]:
        sizes[index] += 1
    return [least + size for size in sizes]
