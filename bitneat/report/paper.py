# SPDX-License-Identifier: MIT
"""The figures of the reproduction: fitness over generations, a network's growth, and the walk as a strip of pictures."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action, Controller, Encoder
from bitneat.network import FloatNetwork, Policy, decode
from bitneat.report import figure
from bitneat.report.networks import draw

Image = npt.NDArray[np.uint8]

_STYLES = ("-", "--", "-.", ":")


def fitness_figure(runs: Mapping[str, Sequence[Sequence[float]]], file_type: str) -> bytes:
    """The best fitness of each generation: for each system the mean of its runs, and the band between their extremes.

    Args:
        runs: by system, the histories of its runs; a longer one than the shortest is cut.
        file_type: ``svg`` or ``png``.
    """
    with figure.settings():
        from matplotlib.figure import Figure

        page = Figure(figsize=(7.0, 4.0), layout="constrained")
        axes = page.add_subplot()
        for place, (system, histories) in enumerate(runs.items()):
            length = min(len(history) for history in histories)
            values = np.array([history[:length] for history in histories])
            colour, style = figure.CYCLE[place % len(figure.CYCLE)], _STYLES[place % len(_STYLES)]
            generations = np.arange(length)
            label = f"{system} ({len(histories)} run{'s' if len(histories) > 1 else ''})"
            axes.plot(generations, values.mean(axis=0), color=colour, linestyle=style, linewidth=1.4, label=label)
            axes.fill_between(
                generations, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.15, linewidth=0
            )
        axes.axhline(300, color=figure.GREY, linewidth=0.6)
        axes.annotate("solved", (0, 300), textcoords="offset points", xytext=(2, 2), color=figure.GREY)
        axes.set_xlabel("generation")
        axes.set_ylabel("largest fitness in the generation")
        axes.grid(visible=True)
        axes.legend(frameon=False, loc="center right")
        return figure.render(page, file_type, "Fitness over generations", "Mean over runs, and the band between them")


def steps_figure(runs: Mapping[str, Sequence[tuple[Sequence[float], Sequence[float]]]], file_type: str) -> bytes:
    """The best fitness by simulated steps, a line for each run: what a budget buys, whatever a generation is.

    Args:
        runs: by system, for each run the best fitness and the steps of each generation.
        file_type: ``svg`` or ``png``.
    """
    with figure.settings():
        from matplotlib.figure import Figure

        page = Figure(figsize=(7.0, 4.0), layout="constrained")
        axes = page.add_subplot()
        for place, (system, histories) in enumerate(runs.items()):
            colour, style = figure.CYCLE[place % len(figure.CYCLE)], _STYLES[place % len(_STYLES)]
            for number, (best, steps) in enumerate(histories):
                label = system if number == 0 else None
                axes.plot(np.cumsum(steps) / 1e6, best, color=colour, linestyle=style, linewidth=1.2, label=label)
        axes.axhline(300, color=figure.GREY, linewidth=0.6)
        axes.set_xlabel("simulated steps, in millions")
        axes.set_ylabel("largest fitness in the generation")
        axes.grid(visible=True)
        axes.legend(frameon=False, loc="center right")
        return figure.render(page, file_type, "Fitness by simulated steps", "A line for each run")


def growth_figure(stages: Sequence[tuple[int, Policy]], file_type: str) -> bytes:
    """A run's best candidate at some generations, side by side."""
    with figure.settings():
        from matplotlib.figure import Figure

        columns = min(4, len(stages))
        rows = math.ceil(len(stages) / columns)
        page = Figure(figsize=(2.4 * columns, 2.4 * rows), layout="constrained")
        for place, (generation, policy) in enumerate(stages, start=1):
            axes = page.add_subplot(rows, columns, place)
            draw(axes, policy, f"{generation}: {len(policy.nodes)} nodes, {policy.num_links} links")
        return figure.render(page, file_type, "Growth of a network", "The best candidate by generation")


def strip_figure(frames: Sequence[tuple[int, Image]], title: str) -> bytes:
    """Pictures of a walk, the step under each, as PNG."""
    with figure.settings():
        from matplotlib.figure import Figure

        page = Figure(figsize=(2.0 * len(frames), 1.7), layout="constrained")
        for place, (step, image) in enumerate(frames, start=1):
            axes = page.add_subplot(1, len(frames), place)
            axes.imshow(image)
            axes.set_title(f"step {step}", fontsize=8)
            axes.set_axis_off()
        return figure.render(page, "png", title, "Frames of one episode, rendered by Gymnasium")


def frames(spec: EnvironmentSpec, policy: Policy, action: Action, seed: int, count: int) -> list[tuple[int, Image]]:
    """``count`` pictures of an episode, evenly spaced, by Gymnasium's own renderer; fewer if it ends earlier."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # it draws into memory, on machines without a screen too
    length = len(_walk(spec, policy, action, seed, None))
    wanted = {round(i * (length - 1) / max(count - 1, 1)) for i in range(count)}
    taken = _walk(spec, policy, action, seed, wanted)
    return [(step, image) for step, image in taken if image is not None]


def _walk(
    spec: EnvironmentSpec, policy: Policy, action: Action, seed: int, wanted: set[int] | None
) -> list[tuple[int, Image | None]]:
    """Every step of an episode, with a picture of those that are wanted."""
    import gymnasium

    mode = None if wanted is None else "rgb_array"
    environment = gymnasium.make(spec.id, render_mode=mode, **spec.kwargs)
    act = _actor(policy, action)
    taken: list[tuple[int, Image | None]] = []
    try:
        observation, _ = environment.reset(seed=seed)
        over = False
        while not over:
            observation, _, terminated, truncated, _ = environment.step(act(observation))
            over = bool(terminated or truncated)
            picture: Any = environment.render() if wanted is not None and len(taken) in wanted else None
            taken.append((len(taken), picture))
    finally:
        environment.close()
    return taken


def _actor(policy: Policy, action: Action) -> Any:
    if isinstance(policy, FloatNetwork):
        return lambda observation: decode(action, policy.step(observation))
    assert isinstance(policy, Controller)
    from bitneat.runtime import RuntimeController

    encoder, running = Encoder(policy), RuntimeController(policy)
    running.reset()
    return lambda observation: action.decode(running.step(encoder(observation)), policy.frac_bits)
