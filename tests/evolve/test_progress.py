# SPDX-License-Identifier: MIT
"""What a run says of the time that is left."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import pytest

from bitneat.evolve import progress
from bitneat.evolve.search import Generation


def row(generation: int, steps: int) -> Generation:
    return Generation(generation, 1.0, 1.0, 1.0, 1, 1, 1, 1.0, 0, 10, steps)


@pytest.mark.parametrize(
    ("most_steps", "generations", "left"),
    [(0, 10, "0:01:30"), (4000, 10, "0:00:30"), (4000, 2, "0:00:10"), (10**9, 10, "0:01:30")],
)
def test_the_time_left_follows_generations_or_steps_whichever_ends_first(
    most_steps: int, generations: int, left: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter((100.0, 110.0))  # the first of ten generations takes ten seconds and 1,000 steps
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    search: Any = SimpleNamespace(
        config={"evolve": {"max_total_steps": most_steps, "linear_generations": 0}, "NEAT": {"pop_size": 5}},
        spec=SimpleNamespace(id="X-v0"), generation=0, total_steps=0, seed=1,
    )  # fmt: skip
    stream = io.StringIO()
    shown = progress.PlainProgress(stream)
    shown.start(search, generations, None)
    shown.generation(row(0, 1000), None)
    assert stream.getvalue().splitlines()[-1].endswith(f"left {left}")
