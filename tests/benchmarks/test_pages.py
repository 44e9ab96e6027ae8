# SPDX-License-Identifier: MIT
"""What programs write into pages."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import ablation, solve
from benchmarks.pages import replaced


def test_only_what_is_between_the_marks_changes() -> None:
    page = "a\n<!-- x -->\nold\n<!-- end of x -->\nb\n"
    assert replaced(page, "x", "new\n") == "a\n<!-- x -->\nnew\n<!-- end of x -->\nb\n"
    with pytest.raises(ValueError, match="unpack"):
        replaced("no marks\n", "x", "")


@pytest.mark.parametrize(("page", "mark"), [(ablation.PAGE, "ablation"), (solve.PAGE, "solve")])
def test_the_pages_have_a_place_for_the_tables(page: Path, mark: str) -> None:
    text = page.read_text(encoding="utf-8")
    assert f"<!-- {mark} -->\nnew\n<!-- end of {mark} -->\n" in replaced(text, mark, "new\n")


def run(seed: int, seconds: float, solved: bool) -> dict[str, object]:
    score = {"mean": 301.0 + seed}
    return {
        "seed": seed, "solved": solved, "seconds": seconds, "steps": 80_000_000, "generations": 200,
        "unseen": score if solved else None, "more": score, "packed_bytes": 130,
    }  # fmt: skip


def test_the_median_counts_runs_that_were_not_solved_as_the_longest() -> None:
    text = solve.table([run(1, 600.0, True), run(2, 1800.0, False), run(3, 900.0, True)], 2)
    assert "| 1 | 10.0 | 80 M | 200 | 302.0 | 302.0 | 130 |" in text
    assert "| 2 | not in 30 | 80 M | 200 | - | 303.0 | 130 |" in text
    assert text.endswith("Median of the 3 runs, 2 threads: 15.0 minutes.\n")
    assert "none: too few" in solve.table([run(1, 600.0, True), run(2, 1.0, False), run(3, 1.0, False)], 2)
