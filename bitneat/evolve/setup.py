# SPDX-License-Identifier: MIT
"""What a configuration comes to in an environment: inputs, the limit of an episode, and what neat-python is told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Input
from bitneat.controller.ir import MAX_OUTPUTS, MAX_SIGNALS
from bitneat.errors import BitneatError
from bitneat.evolve.config import SPECIES_SETS, Config
from bitneat.evolve.kinds import Kind
from bitneat.evolve.plain_reproduction import PlainReproduction, PlainSpeciesSet, PlainStagnation, SoftmaxReproduction
from bitneat.evolve.reproduction import BitReproduction, BitSpeciesSet, NoStagnation, Settings
from bitneat.sim.environment import EnvironmentInfo, default_inputs


def episode_limit(config: Config, spec: EnvironmentSpec, info: EnvironmentInfo) -> int:
    """The time limit of an episode.

    Raises:
        BitneatError: if neither the configuration nor the environment has one.
    """
    limits = [limit for limit in (config["evolve"]["max_steps"], info.max_steps) if limit]
    if not limits:
        raise BitneatError(
            f"environment {spec.id}: has no time limit; set [evolve] max_steps in the configuration ({config.source})"
        )
    return int(min(limits))


def refuse_too_many(config: Config, spec: EnvironmentSpec, info: EnvironmentInfo) -> None:
    """Say that an environment has more inputs or outputs than a controller can have, or than genomes may have nodes.

    Raises:
        BitneatError: if it has.
    """
    if info.action.num_outputs > MAX_OUTPUTS:
        raise BitneatError(
            f"environment {spec.id}: its action needs {info.action.num_outputs} outputs, a controller has at most {MAX_OUTPUTS}"
        )
    most = MAX_SIGNALS - info.action.num_outputs
    if info.num_inputs > most:
        raise BitneatError(
            f"environment {spec.id}: its observation has {info.num_inputs} components, a controller reads at most {most} here"
        )
    if config["NEAT"]["genome"] == "PlainGenome":
        return
    genome = config["BitGenome"]
    num_hidden = min(genome["max_nodes"], MAX_SIGNALS - info.num_inputs) - info.action.num_outputs
    if num_hidden < 0:
        raise BitneatError(
            f"{config.source}: [BitGenome] max_nodes = {genome['max_nodes']}:"
            f" expected at least {info.action.num_outputs}, the outputs of {spec.id}"
        )
    if genome["num_hidden"] > num_hidden:
        raise BitneatError(
            f"{config.source}: [BitGenome] num_hidden = {genome['num_hidden']}: expected at most {num_hidden},"
            f" since {spec.id} has {info.action.num_outputs} outputs and {info.num_inputs} inputs"
            f" and [BitGenome] max_nodes is {genome['max_nodes']}"
        )


def inputs_of(config: Config, info: EnvironmentInfo) -> tuple[Input, ...]:
    """The controller's inputs: the environment's, with the scales and limits that the configuration has.

    Raises:
        BitneatError: if it has neither one for all nor one for each.
    """
    settings = config["evolve"]
    scales = _spread(config, "input_scales", info.num_inputs)
    limits = _spread(config, "input_limits", info.num_inputs)
    inputs = default_inputs(info, settings["frac_bits"], scales)
    if limits is None:
        return inputs
    return tuple(Input(entry.scale, limit) for entry, limit in zip(inputs, limits, strict=True))


def _spread(config: Config, key: str, count: int) -> tuple[int, ...] | None:
    """One value for all inputs, or one for each; None if the configuration leaves them to us."""
    values: tuple[int, ...] = config["evolve"][key]
    if not values:
        return None
    if len(values) not in (1, count):
        raise BitneatError(f"{config.source}: [evolve] {key}: expected 1 or {count} integers, got {len(values)}")
    return values if len(values) == count else values * count


def neat_config(config: Config, kind: Kind) -> Any:
    """What neat-python's classes expect of a configuration; its own reader is not used, see `bitneat.evolve.config`."""
    reproduction = config["NEAT"]["reproduction"]
    reproduction_type, species_set_type, stagnation_type = _REPRODUCTIONS[reproduction]
    return SimpleNamespace(
        genome_type=kind.genome_type,
        genome_config=kind.settings,
        reproduction_type=reproduction_type,
        reproduction_config=Settings(config[reproduction]),
        species_set_type=species_set_type,
        species_set_config=Settings(config[SPECIES_SETS[reproduction]]),
        stagnation_type=stagnation_type,
        stagnation_config=Settings(config[reproduction]),
        pop_size=config["NEAT"]["pop_size"],
        fitness_criterion="max",
        fitness_threshold=math.inf,
        no_fitness_termination=True,
        reset_on_extinction=False,
        seed=None,
    )


_REPRODUCTIONS: Mapping[str, tuple[type[Any], type[Any], type[Any]]] = {
    "BitReproduction": (BitReproduction, BitSpeciesSet, NoStagnation),
    "PlainReproduction": (PlainReproduction, PlainSpeciesSet, PlainStagnation),
    "SoftmaxReproduction": (SoftmaxReproduction, PlainSpeciesSet, NoStagnation),
}
