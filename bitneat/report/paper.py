# SPDX-License-Identifier: MIT
"""The figures of the reproduction: fitness over generations and steps, and a network's growth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bitneat.network import Policy
from bitneat.report import figure
from bitneat.report.networks import draw

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
