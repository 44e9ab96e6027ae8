# SPDX-License-Identifier: MIT
"""A C file that others include, as the walker's solver is, decides the library's bytes as much as they do."""

import ctypes
import os
from pathlib import Path

import pytest

from bitneat.native import shared_library


def test_an_edited_source_that_another_one_includes_gives_another_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BITNEAT_CACHE_DIR", str(tmp_path / "cache"))
    source, part = tmp_path / "whole.c", tmp_path / "part.c"
    source.write_text('# include "part.c"\n/*\n#include "gone.c"\n*/\n')
    part.write_text("int part(void) { return 1; }\n")
    before = shared_library([source], name="whole")
    os.utime(part, (0, 0))
    assert shared_library([source], name="whole") == before
    part.write_text("int part(void) { return 2; }\n")
    after = shared_library([source], name="whole")
    assert after != before
    assert ctypes.CDLL(str(after)).part() == 2
