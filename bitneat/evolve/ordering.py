# SPDX-License-Identifier: MIT
"""In what order the nodes of a genome are evaluated, and which signals of a controller they become."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping


def evaluation_order(sources: Mapping[int, Iterable[int]], num_outputs: int) -> list[int]:
    """The nodes in topological order, hidden ones by key and outputs only when no hidden one is ready; none that is behind a cycle.

    Args:
        sources: for each node the nodes and inputs (with negative keys) that it reads in the same step, all of them among the keys.
        num_outputs: the outputs are the nodes from 0 to there.
    """
    readers: dict[int, list[int]] = {key: [] for key in sources}
    waiting_for = dict.fromkeys(sources, 0)
    for key, read in sources.items():
        for source in read:
            if source >= 0:
                readers[source].append(key)
                waiting_for[key] += 1
    ready = [(key < num_outputs, key) for key, count in waiting_for.items() if not count]
    heapq.heapify(ready)
    order = []
    while ready:
        _, key = heapq.heappop(ready)
        order.append(key)
        for reader in readers[key]:
            waiting_for[reader] -= 1
            if not waiting_for[reader]:
                heapq.heappush(ready, (reader < num_outputs, reader))
    return order


def signal_numbers(num_inputs: int, order: Iterable[int]) -> dict[int, int]:
    """The signal that a key of a genome stands for: inputs have the keys -1, -2, …."""
    number = {-1 - index: index for index in range(num_inputs)}
    number.update({key: num_inputs + position for position, key in enumerate(order)})
    return number
