# SPDX-License-Identifier: MIT
"""A controller's step in the C runtime, against neat-python's network of the same links."""

from __future__ import annotations

from typing import Any

import numpy as np
from neat.activations import clamped_activation
from neat.aggregations import sum_aggregation
from neat.nn.feed_forward import FeedForwardNetwork

from bitneat.bench.measurement import Measurement, seconds_of, side_by_side
from bitneat.bench.network import INPUT_LIMIT, NUM_INPUTS, hundred_links
from bitneat.controller import Controller, Signal
from bitneat.runtime import Population, RuntimeController

GOAL = 100.0
_CONTROLLERS = 200
_STEPS = 100
_NEAT_STEPS = 300


def measure(repetitions: int) -> list[Measurement]:
    """Measure a step in a population, and alone through one call from Python, against ``FeedForwardNetwork.activate``."""
    controller = hundred_links()
    draw = np.random.default_rng(0)
    inputs = draw.integers(-INPUT_LIMIT, INPUT_LIMIT, (_STEPS, NUM_INPUTS), dtype=np.int16, endpoint=True)
    network = as_neat_network(controller)
    observations = [[float(value) / controller.one for value in row] for row in inputs]
    population = Population([controller] * _CONTROLLERS)
    batches = [inputs] * _CONTROLLERS
    single = RuntimeController(controller)

    def neat_step() -> float:
        def steps() -> None:
            for step in range(_NEAT_STEPS):
                network.activate(observations[step % _STEPS])

        return seconds_of(steps) / _NEAT_STEPS

    def population_step() -> float:
        return seconds_of(lambda: population.run(batches)) / (_CONTROLLERS * _STEPS)

    def single_step() -> float:
        def steps() -> None:
            for row in inputs:
                single.step(row)

        return seconds_of(steps) / _STEPS

    in_population = side_by_side(population_step, neat_step, repetitions)
    alone = side_by_side(single_step, neat_step, repetitions)
    baseline = "neat-python FeedForwardNetwork.activate"
    return [
        Measurement(
            f"one step of {controller.num_links} links, {_CONTROLLERS} controllers and {_STEPS} steps a call",
            in_population.ours * 1e6,
            baseline,
            in_population.baseline * 1e6,
            "µs",
            in_population.ratio,
            "times as fast",
            f">= {GOAL:.0f}",
            in_population.ratio >= GOAL,
        ),
        Measurement(
            "the same, one controller and one step a call",
            alone.ours * 1e6,
            baseline,
            alone.baseline * 1e6,
            "µs",
            alone.ratio,
            "times as fast",
            "",
            None,
        ),
    ]


def as_neat_network(controller: Controller) -> Any:
    """Return neat-python's network with the links, signs and gains of a ternary controller of clamped nodes."""
    inputs = [-1 - index for index in range(len(controller.inputs))]
    first_node = len(controller.inputs)

    def key(signal: int) -> int:
        return inputs[signal] if signal < first_node else signal

    node_evals = [
        (
            first_node + index,
            clamped_activation,
            sum_aggregation,
            node.bias / controller.one,
            2.0**node.gain,
            [(key(link.source), float(link.sign << link.shift)) for link in node.links],
        )
        for index, node in enumerate(controller.nodes)
    ]
    outputs = [key(output.index) for output in controller.outputs if isinstance(output, Signal)]
    untyped: Any = FeedForwardNetwork
    return untyped(inputs, outputs, node_evals)
