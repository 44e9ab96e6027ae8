# SPDX-License-Identifier: MIT
"""Numbers for new genes, genomes and species."""

from __future__ import annotations


class Indexer:
    """Counts like `itertools.count`, but can be looked at, so that saving it burns no number."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __iter__(self) -> Indexer:
        return self

    def __next__(self) -> int:
        value = self.value
        self.value += 1
        return value
