# SPDX-License-Identifier: MIT
"""Searches that take a second: little of everything."""


def small_search(generations: int, population: int, more: str = "") -> str:
    """A configuration; ``more`` is text for its end."""
    return f"""
[evolve]
generations = {generations}
race_episodes = 1 2
race_fractions = 1 0.3
selection_episodes = 2
final_episodes = 3
report_episodes = 3
finalists = 2
max_steps = 60
[NEAT]
pop_size = {population}
{more}"""
