# SPDX-License-Identifier: MIT
"""The search: generations of a race, ranked selection and reproduction, and the choice of a champion."""

from __future__ import annotations

import contextlib
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from neat.population import Population

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Constant, Controller
from bitneat.errors import BitneatError
from bitneat.evolve.config import Config
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.indexer import Indexer
from bitneat.evolve.kinds import kind_for
from bitneat.evolve.linear import LinearSearch
from bitneat.evolve.lowering import genome_from_controller
from bitneat.evolve.plain_reproduction import PlainSpeciesSet
from bitneat.evolve.randomness import Streams, report_seeds, selection_seeds
from bitneat.evolve.reproduction import BitSpeciesSet
from bitneat.evolve.setup import episode_limit, inputs_of, neat_config, refuse_too_many
from bitneat.network import FloatNetwork, Policy, network_from_data
from bitneat.sim.environment import EnvironmentInfo, EpisodeResult, Shaping

LINEAR_RESOLUTION = 4
"""The linear start ends in ternary controllers with weights in halves to sixteenths."""


@dataclass(frozen=True)
class Score:
    """Official rewards of a controller over some episodes."""

    episodes: int
    mean: float
    std: float
    min: float
    max: float

    @classmethod
    def of(cls, episodes: Sequence[EpisodeResult]) -> Score:
        """The score of episodes that ran without shaping."""
        return cls.over([episode.reward for episode in episodes])

    @classmethod
    def over(cls, rewards: Sequence[float]) -> Score:
        """The score of official rewards."""
        return cls(len(rewards), statistics.fmean(rewards), statistics.pstdev(rewards), min(rewards), max(rewards))

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {"episodes": self.episodes, "mean": self.mean, "std": self.std, "min": self.min, "max": self.max}


@dataclass(frozen=True)
class Candidate:
    """A controller (or float network) that once led a generation, with its official rewards on the first selection seeds."""

    controller: Policy
    generation: int
    rewards: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Mean official reward on the selection seeds."""
        return statistics.fmean(self.rewards)

    def order(self) -> tuple[float, int, str]:
        """Sorts the best first; of equals the smaller."""
        return -self.mean, self.controller.num_links, self.controller.sha256

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        kind = "network" if isinstance(self.controller, FloatNetwork) else "controller"
        return {kind: self.controller.to_data(), "generation": self.generation, "rewards": list(self.rewards)}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Candidate:
        """Read what `to_data` wrote."""
        rewards = tuple(_finite(reward, "rewards") for reward in data["rewards"])
        if not rewards:
            raise BitneatError("rewards: expected at least one")
        policy: Policy
        if "network" in data:
            policy = network_from_data(data["network"])
        else:
            policy = Controller.from_data(data["controller"])
        return cls(policy, _whole(data["generation"], "generation"), rewards)


@dataclass(frozen=True)
class Generation:
    """What happened in one generation; a row of history.csv."""

    generation: int
    best: float
    mean: float
    selection: float
    species: int
    best_nodes: int
    best_links: int
    mean_links: float
    duplicates: int
    episodes: int
    steps: int
    genome_nodes: int = 0
    """Nodes in the leader's genome, whether or not an output needs them."""
    genome_links: int = 0
    """Enabled links in the leader's genome."""


@dataclass
class _Entrant:
    """What the race runs for one genome, or for all genomes that come to the same."""

    variants: tuple[Policy, ...]
    """Usually one controller; the score is the mean over all."""
    genome: Any
    episodes: list[list[EpisodeResult]]
    """By variant."""
    stage: int = 0
    score: float = -math.inf

    @property
    def controller(self) -> Policy:
        """The variant with the best official rewards."""
        if len(self.variants) == 1 or not self.episodes[0]:
            return self.variants[0]
        means = [statistics.fmean(episode.reward for episode in row) for row in self.episodes]
        return self.variants[means.index(max(means))]

    @property
    def all_episodes(self) -> list[EpisodeResult]:
        """Of every variant."""
        return [episode for row in self.episodes for episode in row]

    @property
    def num_links(self) -> int:
        """Links of a variant."""
        return self.variants[0].num_links

    @property
    def lower_bound(self) -> float:
        """The score less one standard error: whoever is above it, the race cannot tell from this one."""
        rewards = [episode.shaped for episode in self.all_episodes]
        return self.score - statistics.pstdev(rewards) / math.sqrt(len(rewards))


class Search:
    """The state of a run, and how it goes on by a generation.

    Args:
        config: the configuration.
        spec: the environment.
        info: what `inspect` says of it.
        seed: of all randomness.
        start: controllers that the first population is made of, with mutants of them; none for random genomes.

    Raises:
        BitneatError: if the environment has too many inputs or outputs, or no genome is like any controller of ``start``.
    """

    def __init__(
        self,
        config: Config,
        spec: EnvironmentSpec,
        info: EnvironmentInfo,
        seed: int,
        start: Sequence[Controller] = (),
    ) -> None:
        self.config = config
        self.spec = spec
        self.info = info
        self.seed = seed
        refuse_too_many(config, spec, info)
        self.inputs = inputs_of(config, info)
        self.max_steps = episode_limit(config, spec, info)
        self.streams = Streams(seed)
        self.history: list[Generation] = []
        self.candidates: list[Candidate] = []
        self._evaluator: Evaluator | None = None
        self._previous_keys: set[int] = set()
        self._restarted = 0
        """The generation from which on the present population has been bred."""
        self.kind = kind_for(config, self.inputs, info.action.num_outputs)
        self._by_rank = config["NEAT"]["reproduction"] == "BitReproduction"
        self._neat_config = neat_config(config, self.kind)
        with self.streams.neat():
            self.population = Population(self._neat_config)
            if start and not self._populate(start):
                raise BitneatError("start: no genome is like the champion")
        settings = config["evolve"]
        self.linear: LinearSearch | None = None
        if settings["linear_generations"]:
            self.linear = LinearSearch(
                self.inputs,
                info.action.num_outputs,
                settings["frac_bits"],
                seed,
                population=settings["linear_population"],
                episodes=settings["linear_episodes"],
                fall_reward=settings["fall_reward"],
                walks_at=settings["linear_walks_at"],
            )

    @property
    def generation(self) -> int:
        """Generations completed, those of the linear start included."""
        return int(self.population.generation) + (self.linear.generation if self.linear else 0)

    @property
    def starting(self) -> bool:
        """True while the linear start is not over."""
        return self.linear is not None and self.linear.generation < self.config["evolve"]["linear_generations"]

    @property
    def frac_bits(self) -> int:
        """F of every controller in this run."""
        return int(self.config["evolve"]["frac_bits"])

    def advance(self, evaluator: Evaluator) -> Generation:
        """Run one generation and breed the next."""
        self._evaluator = evaluator
        if self.linear is not None and self.starting:
            return self._advance_linear(self.linear, evaluator)
        keys = set(self.population.population)
        with self.streams.neat():
            self.population.run(self._assign_fitness, 1)
        self._previous_keys = keys
        self._restart_if_stuck()
        return self.history[-1]

    def _restart_if_stuck(self) -> None:
        """Breed a new population from the best candidates, if for long none was better than the best."""
        settings = self.config["evolve"]
        patience = settings["restart_after"]
        if not patience or self.generation - max(self.candidates[0].generation, self._restarted) < patience:
            return
        self._restarted = self.generation
        best = [candidate.controller for candidate in self.candidates[: settings["finalists"]]]
        with self.streams.neat():
            if not self._populate([policy for policy in best if isinstance(policy, Controller)]):
                self._settle(
                    self.population.reproduction.create_new(
                        self.kind.genome_type, self._neat_config.genome_config, self.config["NEAT"]["pop_size"]
                    )
                )

    def _advance_linear(self, linear: LinearSearch, evaluator: Evaluator) -> Generation:
        """One generation of the linear start; with its last one the population is made anew from its policy."""
        generation = self.generation
        row = linear.advance(evaluator)
        policy = linear.ternary(LINEAR_RESOLUTION)
        self._try(policy, generation, evaluator)
        self.history.append(
            Generation(
                generation=generation,
                best=row.best,
                mean=row.median,
                selection=self.candidates[0].mean,
                species=1,
                best_nodes=len(policy.nodes),
                best_links=policy.num_links,
                mean_links=float(policy.num_links),
                duplicates=0,
                episodes=row.episodes,
                steps=row.steps,
            )
        )
        if not self.starting:
            with self.streams.neat():
                roundings = [linear.ternary(r) for r in range(1, LINEAR_RESOLUTION + 1)]
                # Too coarse a rounding leaves an output without links; it would take a share of the population for nothing.
                self._populate([one for one in roundings if not any(isinstance(o, Constant) for o in one.outputs)])
            self._restarted = self.generation  # patience is for what is bred, which has had no generation yet
        return self.history[-1]

    def _populate(self, controllers: Sequence[Controller]) -> bool:
        """A population of these controllers' genomes in turn, all but the first of each mutated.

        A controller that no genome is like is left out; without any the population stays, and the answer is False.
        """
        settings = self._neat_config.genome_config
        settings.innovation_tracker = self.population.reproduction.innovation_tracker
        ancestors = []
        for controller in controllers:
            with contextlib.suppress(BitneatError):
                ancestors.append(genome_from_controller(0, controller, settings))
        if not ancestors:
            return False
        population: dict[int, Any] = {}
        for index in range(self.config["NEAT"]["pop_size"]):
            key = next(self.population.reproduction.genome_indexer)
            genome = self.kind.genome_type(key)
            genome.configure_clone(ancestors[index % len(ancestors)])
            if index >= len(ancestors):
                genome.mutate(settings)
            population[key] = genome
        self._settle(population)
        return True

    def _settle(self, population: dict[int, Any]) -> None:
        """Put a population in the place of the present one and its species."""
        self.population.population = population
        self.population.species.species.clear()
        self.population.species.speciate(self._neat_config, population, 0)

    @property
    def total_steps(self) -> int:
        """Steps simulated in all races so far."""
        return sum(row.steps for row in self.history)

    @property
    def finished(self) -> bool:
        """True once the generations or the steps that the configuration allows are used up."""
        settings = self.config["evolve"]
        used_up = settings["max_total_steps"] and self.total_steps >= settings["max_total_steps"]
        return bool(self.generation >= settings["generations"] or used_up)

    def finalists(self, evaluator: Evaluator) -> list[Candidate]:
        """The best candidates on all selection seeds, the champion first."""
        settings = self.config["evolve"]
        seeds = selection_seeds(max(settings["final_episodes"], settings["selection_episodes"]))
        finals = []
        for candidate in self._tuned(evaluator)[: settings["finalists"]]:
            rest = seeds[len(candidate.rewards) :]
            more = evaluator.evaluate([candidate.controller], rest)[0] if rest else []
            rewards = (*candidate.rewards, *(episode.reward for episode in more))
            finals.append(Candidate(candidate.controller, candidate.generation, rewards))
        return sorted(finals, key=Candidate.order)

    def _tuned(self, evaluator: Evaluator) -> list[Candidate]:
        """The candidates, and the variations that their kind of genome suggests of the best of them."""
        best = self.candidates[0]
        seeds = selection_seeds(self.config["evolve"]["selection_episodes"])
        more = self.kind.tuned(best.controller)
        results = evaluator.evaluate(more, seeds) if more else []
        variations = [
            Candidate(policy, best.generation, tuple(episode.reward for episode in row))
            for policy, row in zip(more, results, strict=True)
        ]
        return sorted([*self.candidates, *variations], key=Candidate.order)

    def report(self, evaluator: Evaluator, controller: Policy) -> Score:
        """The score of a controller on the report seeds, which nothing was chosen on."""
        return Score.of(evaluator.evaluate([controller], report_seeds(self.config["evolve"]["report_episodes"]))[0])

    def shaping(self) -> Shaping:
        """How the search's reward differs from the official one in the present generation."""
        settings = self.config["evolve"]
        start, end = settings["fall_ramp_start"], settings["fall_ramp_end"]
        generation = int(self.population.generation)
        done = (generation - start) / (end - start) if end > start else float(generation >= end)
        done = min(max(done, 0.0), 1.0)
        return Shaping(
            fall_reward=settings["fall_reward"],
            fall_value=settings["fall_value_start"]
            + done * (settings["fall_value_end"] - settings["fall_value_start"]),
            finish_bonus=settings["finish_bonus"],
            max_steps=settings["search_steps"],
            stall_steps=settings["stall_steps"],
            stall_gain=settings["stall_gain"],
        )

    def _assign_fitness(self, genomes: list[tuple[int, Any]], neat_config: Any) -> None:
        del neat_config
        with self.streams.aside():
            self._rank(genomes)

    def _rank(self, genomes: list[tuple[int, Any]]) -> None:
        assert self._evaluator is not None
        entrants: dict[str, _Entrant] = {}
        entrant_of: dict[int, _Entrant] = {}
        for key, genome in genomes:
            variants = self.kind.lower(genome)
            entrant = _Entrant(variants, genome, [[] for _ in variants])
            entrant_of[key] = entrants.setdefault(variants[0].sha256, entrant)
        ranked = self._race(list(entrants.values()), self._evaluator)
        if self._by_rank:
            for _, genome in genomes:
                genome.fitness = 0.0  # a duplicate adds nothing to the next generation
            for rank, entrant in enumerate(ranked):
                entrant.genome.fitness = 1.0 - rank / max(len(ranked) - 1, 1)
        else:
            for key, genome in genomes:
                genome.fitness = entrant_of[key].score
        self._consider(ranked, self._evaluator)
        self._record(ranked, len(genomes) - len(ranked))

    def _race(self, entrants: list[_Entrant], evaluator: Evaluator) -> list[_Entrant]:
        """All run the first stage, the best fraction the second, and so on; the elites of last time run them all."""
        settings = self.config["evolve"]
        # Without new seeds a generation draws what the first one drew.
        streams = self.streams if settings["new_seeds"] else Streams(self.seed)
        seeds = streams.search_seeds(settings["race_episodes"][-1])
        shaping = self.shaping()
        active, done = entrants, 0
        for stage, (episodes, fraction) in enumerate(
            zip(settings["race_episodes"], settings["race_fractions"], strict=True), start=1
        ):
            if stage > 1:
                keep = max(1, round(fraction * len(entrants)))
                best = sorted(active, key=_by_score)
                active = [e for i, e in enumerate(best) if i < keep or e.genome.key in self._previous_keys]
            runs = [(entrant, index) for entrant in active for index in range(len(entrant.variants))]
            policies = [entrant.variants[index] for entrant, index in runs]
            results = evaluator.evaluate(policies, seeds[done:episodes], shaping)
            for (entrant, index), more in zip(runs, results, strict=True):
                entrant.episodes[index].extend(more)
            for entrant in active:
                entrant.stage = stage
                entrant.score = _robust_mean([e.shaped for e in entrant.all_episodes], settings["risk"])
            done = episodes
        ranked = sorted(entrants, key=_by_score)
        if self.streams.pressure() < settings["size_pressure"]:
            tied = [e for e in ranked if e.stage == ranked[0].stage and e.score >= ranked[0].lower_bound]
            ranked = _by_fronts(tied) + ranked[len(tied) :]
        return ranked

    def _consider(self, ranked: list[_Entrant], evaluator: Evaluator) -> None:
        """Try the generation's best by official reward on the selection seeds, and keep it if it is among the best so far."""
        last = [e for e in ranked if e.stage == ranked[0].stage]
        leader = max(last, key=lambda e: statistics.fmean(episode.reward for episode in e.all_episodes))
        self._try(leader.controller, self.generation, evaluator)

    def _try(self, policy: Policy, generation: int, evaluator: Evaluator) -> None:
        """Run a policy on the selection seeds, unless it is a candidate already, and keep the best candidates."""
        if any(c.controller.sha256 == policy.sha256 for c in self.candidates):
            return
        seeds = selection_seeds(self.config["evolve"]["selection_episodes"])
        episodes = evaluator.evaluate([policy], seeds)[0]
        rewards = tuple(episode.reward for episode in episodes)
        self.candidates.append(Candidate(policy, generation, rewards))
        self.candidates.sort(key=Candidate.order)
        del self.candidates[2 * self.config["evolve"]["finalists"] :]

    def _record(self, ranked: list[_Entrant], duplicates: int) -> None:
        leader = ranked[0]
        episodes = [episode for entrant in ranked for episode in entrant.all_episodes]
        genome_nodes, genome_links = leader.genome.size()
        self.history.append(
            Generation(
                generation=self.generation,
                best=max(e.score for e in ranked if e.stage == leader.stage),
                mean=statistics.fmean(e.episodes[0][0].shaped for e in ranked),
                selection=self.candidates[0].mean,
                species=len(self.population.species.species),
                best_nodes=len(leader.variants[0].nodes),
                best_links=leader.num_links,
                mean_links=statistics.fmean(e.num_links for e in ranked),
                duplicates=duplicates,
                episodes=len(episodes),
                steps=sum(episode.steps for episode in episodes),
                genome_nodes=genome_nodes,
                genome_links=genome_links,
            )
        )

    def to_data(self) -> dict[str, Any]:
        """Everything a checkpoint needs, as plain data."""
        species_set: BitSpeciesSet | PlainSpeciesSet = self.population.species
        reproduction = self.population.reproduction
        return {
            "generation": int(self.population.generation),
            "linear": None if self.linear is None else self.linear.to_data(),
            "population": [self.kind.to_data(genome) for genome in self.population.population.values()],
            "previous_keys": sorted(self._previous_keys),
            "restarted": self._restarted,
            "species": [
                [key, group.created, group.representative.key, list(group.members), *species_set.past(group)]
                for key, group in species_set.species.items()
            ],
            "threshold": species_set.threshold,
            "next_species": species_set.indexer.value,
            "next_genome": reproduction.genome_indexer.value,
            "next_node": self._neat_config.genome_config.node_indexer.value,
            "innovations": reproduction.innovation_tracker.global_counter,
            "streams": self.streams.to_data(),
            "candidates": [candidate.to_data() for candidate in self.candidates],
            "history": [list(vars(row).values()) for row in self.history],
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue where `to_data` was taken.

        Raises:
            BitneatError: if a number is out of its range. Whatever else is wrong raises whatever it may.
        """
        from neat.species import Species

        generation, next_genome, next_node, next_species, innovations = (
            _whole(data[key], key) for key in ("generation", "next_genome", "next_node", "next_species", "innovations")
        )
        population = {genome.key: genome for genome in map(self.kind.from_data, data["population"])}
        if len(population) < 2:
            raise BitneatError("population: expected at least two genomes")
        for genome in population.values():
            self._check_genome(genome, next_genome, next_node)
        species_set: BitSpeciesSet | PlainSpeciesSet = self.population.species
        species_set.species = {}
        species_set.genome_to_species = {}
        for key, created, representative, members, *past in data["species"]:
            group = Species(_whole(key, "species"), _whole(created, "species"))
            group.update(population[representative], {member: population[member] for member in members})
            species_set.remember(group, past)
            species_set.species[key] = group
            species_set.genome_to_species.update(dict.fromkeys(members, key))
        members = [member for _, _, _, group, *_ in data["species"] for member in group]
        if sorted(members) != sorted(population) or not all(group for _, _, _, group, *_ in data["species"]):
            raise BitneatError("species: do not hold every genome once")
        species_set.threshold = _finite(data["threshold"], "threshold")
        species_set.indexer = Indexer(next_species)
        self.population.population = population
        self.population.generation = generation
        self.population.reproduction.genome_indexer = Indexer(next_genome)
        self.population.reproduction.innovation_tracker.global_counter = innovations
        self._neat_config.genome_config.node_indexer = Indexer(next_node)
        self._previous_keys = {_whole(key, "previous_keys") for key in data["previous_keys"]}
        self._restarted = _whole(
            data.get("restarted", 0), "restarted"
        )  # checkpoints of before there were restarts lack it
        if self.linear is not None:
            self.linear.restore(data["linear"])
        self.streams.restore(data["streams"])
        self.candidates = [Candidate.from_data(entry) for entry in data["candidates"]]
        for candidate in self.candidates:
            policy = candidate.controller
            inputs = policy.num_inputs if isinstance(policy, FloatNetwork) else len(policy.inputs)
            sizes = inputs, len(policy.outputs)
            if sizes != (len(self.inputs), self.info.action.num_outputs):
                raise BitneatError("candidates: a controller does not fit the environment")
        self.history = [
            Generation(*(value if type(value) is int else _finite(value, "history") for value in row))
            for row in data["history"]
        ]

    def _check_genome(self, genome: Any, next_genome: int, next_node: int) -> None:
        where = f"genome {genome.key!r:.20}"
        if not 0 <= _whole(genome.key, where) < next_genome:
            raise BitneatError(f"{where}: its number is not below next_genome")
        if genome.fitness is not None:
            _finite(genome.fitness, where)
        for key in genome.nodes:
            if not 0 <= _whole(key, where) < max(next_node, self.info.action.num_outputs):
                raise BitneatError(f"{where}: a node has a wrong number")
        for link in genome.connections.values():
            _whole(link.innovation, where)
        self.kind.check(genome, where)
        self.kind.lower(genome)


def _whole(value: Any, name: str) -> int:
    if type(value) is not int or not 0 <= value < 1 << 53:
        raise BitneatError(f"{name}: expected an integer from 0")
    return value


def _finite(value: Any, name: str) -> Any:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise BitneatError(f"{name}: expected a finite number")
    return value


def _by_score(entrant: _Entrant) -> tuple[int, float, int, int]:
    """Furthest in the race first, then the best score; of equals the smaller, then the older."""
    return -entrant.stage, -entrant.score, entrant.num_links, entrant.genome.key


def _by_fronts(entrants: Iterable[_Entrant]) -> list[_Entrant]:
    """Sorted by Pareto front over score and number of links, and by score within a front."""
    remaining = sorted(entrants, key=_by_score)
    ordered: list[_Entrant] = []
    while remaining:
        front, rest, fewest = [], [], math.inf
        for entrant in remaining:  # best score first: on the front iff smaller than all before
            if entrant.num_links < fewest:
                front.append(entrant)
                fewest = entrant.num_links
            else:
                rest.append(entrant)
        ordered.extend(front)
        remaining = rest
    return ordered


def _robust_mean(rewards: Sequence[float], risk: float) -> float:
    mean = statistics.fmean(rewards)
    return mean - risk * statistics.pstdev(rewards) if risk else mean
