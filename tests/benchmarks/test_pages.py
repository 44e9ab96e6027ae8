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
