# SPDX-License-Identifier: MIT
"""The goals for small code hold for the network that they were set for, where the compilers they speak of are installed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bitneat.native.compiler import identify

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.mark.skipif(identify(["arm-none-eabi-gcc"]) is None, reason="no gcc for Cortex-M0")
def test_generated_code_for_netb_is_as_small_as_its_goals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.delitem(sys.modules, "netb", raising=False)
    import netb  # type: ignore[import-not-found]

    rows = [row for row in netb.rows(netb.network(), tmp_path, goals=True) if row.goal and "bytes" in row.unit]
    assert len(rows) >= 3
    assert [row for row in rows if row.measured > row.goal] == []
