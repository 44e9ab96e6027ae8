# SPDX-License-Identifier: MIT
"""Least squares in a given order, for drawings whose parts must not change places."""

from __future__ import annotations

from collections.abc import Sequence


def pooled(targets: Sequence[float]) -> list[float]:
    """The values nearest to the targets, by least squares, of which none is below the one before it.

    By pooling adjacent violators (Ayer, Brunk, Ewing, Reid and Silverman 1955): targets that fall move together to their mean.
    """
    pools: list[tuple[float, int]] = []  # (sum, how many)
    for target in targets:
        total, count = target, 1
        while pools and pools[-1][0] / pools[-1][1] >= total / count:
            earlier, members = pools.pop()
            total, count = total + earlier, count + members
        pools.append((total, count))
    return [total / count for total, count in pools for _ in range(count)]
