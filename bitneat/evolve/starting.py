# SPDX-License-Identifier: MIT
"""A search that starts from a champion: its first population is made of that, or of a float teacher's ternary versions."""

from __future__ import annotations

from neat.innovation import InnovationTracker

from bitneat.champion import AnyChampion, FloatChampion
from bitneat.controller import Controller
from bitneat.errors import BitneatError
from bitneat.evolve.config import Config, parse
from bitneat.evolve.genome import BitGenomeConfig
from bitneat.evolve.lowering import genome_from_controller
from bitneat.quantize import QuantizeError, spend_gains, to_ternary
from bitneat.sim.environment import EnvironmentInfo, default_inputs, one_limit

BITS = (5, 6, 4, 7, 3)
"""Resolutions of a teacher's weights, the first the one that mostly does; see docs/quantize.md."""


def starting_point(
    champion: AnyChampion, config: Config, info: EnvironmentInfo, where: str
) -> tuple[Config, tuple[Controller, ...]]:
    """What a search starts from, and its configuration: with the inputs of these controllers, and without a linear start.

    A ternary champion stands for itself, an integer one becomes ternary exactly. A float network becomes ternary by power-of-two
    gains, at several resolutions, which compete.

    Args:
        champion: the champion or teacher.
        config: of the search.
        info: of its environment.
        where: what a message starts with.

    Raises:
        BitneatError: if the champion does not fit the environment, nothing ternary comes of it, or no genome is like that.
    """
    if config["NEAT"]["genome"] != "BitGenome":
        raise BitneatError(f"{where}: a search can start from a champion with [NEAT] genome = BitGenome only")
    network = isinstance(champion, FloatChampion)
    found = champion.network.num_inputs if isinstance(champion, FloatChampion) else len(champion.controller.inputs)
    if found != info.num_inputs or champion.action != info.action:
        raise BitneatError(f"{where}: is for another task: its inputs or its action space are not the environment's")
    controllers = _of_teacher(champion, config, info) if network else _of_champion(champion)
    if not controllers:
        raise BitneatError(f"{where}: no ternary controller comes near it; try bitneat quantize --method search")
    _refuse_unlike(controllers, where)
    inputs = controllers[0].inputs
    config = config.with_values(
        "evolve",
        linear_generations=0,
        frac_bits=controllers[0].frac_bits,
        input_scales=tuple(entry.scale for entry in inputs),
        input_limits=tuple(entry.limit for entry in inputs),
    )
    return config, controllers


def _refuse_unlike(controllers: tuple[Controller, ...], where: str) -> None:
    """Say why no genome is like any of the controllers.

    Raises:
        BitneatError: if that is so.
    """
    reason: BitneatError | None = None
    for controller in controllers:
        settings = BitGenomeConfig(dict(parse("", where)["BitGenome"]), len(controller.inputs), len(controller.outputs))
        settings.innovation_tracker = InnovationTracker()
        try:
            genome_from_controller(0, controller, settings)
        except BitneatError as error:
            reason = reason or error
        else:
            return
    raise BitneatError(f"{where}: no genome is like it: {reason}")


def _of_champion(champion: AnyChampion) -> tuple[Controller, ...]:
    assert not isinstance(champion, FloatChampion)
    controller = champion.controller.canonical
    return (controller if controller.is_ternary else to_ternary(controller).canonical,)


def _of_teacher(champion: AnyChampion, config: Config, info: EnvironmentInfo) -> tuple[Controller, ...]:
    assert isinstance(champion, FloatChampion)
    inputs = one_limit(default_inputs(info, config["evolve"]["frac_bits"]))
    found: list[Controller] = []
    for bits in BITS:
        try:
            controller = spend_gains(champion.network, inputs, config["evolve"]["frac_bits"], ternary=True, bits=bits)
        except QuantizeError:
            continue  # a weight is beyond gains, or a sum beyond the accumulator, at this resolution
        if controller not in found:
            found.append(controller)
    return tuple(found)
