# SPDX-License-Identifier: MIT
"""Damaged files, briefly: old findings are replayed, some new files are read, and a reader that is wrong is found out."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from bitneat.errors import MAX_MESSAGE, BitneatError
from tests.fuzz import files
from tests.fuzz.blobs import read_blobs
from tests.fuzz.files import KINDS, REGRESSIONS, check
from tests.fuzz.target import FindingError


@pytest.mark.parametrize("name", KINDS)
def test_what_was_found_before_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    for content in read_blobs(REGRESSIONS / f"{name}.txt"):
        assert check(tmp_path / name, content, KINDS[name].read) is None


@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path: Path, name: str, budget: int) -> None:
    rng = random.Random(f"{name} in short")
    count = 1000 * budget
    valid = sum(check(tmp_path / name, KINDS[name].draw(rng), KINDS[name].read) is not None for _ in range(count))
    assert count // 50 < valid < count // 2


def _raises_key_error(path: Path) -> Any:
    return {}["x"]


def _recurses(path: Path) -> Any:
    return _recurses(path)


@pytest.mark.parametrize(("read", "message"), [(_raises_key_error, "KeyError"), (_recurses, "RecursionError")])
def test_a_reader_that_is_wrong_is_found_out(tmp_path: Path, read: Any, message: str) -> None:
    with pytest.raises(FindingError, match=message):
        check(tmp_path / "file", b"x", read)


def test_a_reader_that_takes_too_long_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "SECONDS", 0.02)
    assert check(tmp_path / "file", b"x", lambda path: 1) == 1
    with pytest.raises(FindingError, match="took"):
        check(tmp_path / "file", b"x", lambda path: sum(range(10**7)))


def test_a_message_of_more_than_a_line_is_found_out(tmp_path: Path) -> None:
    def read(path: Path) -> Any:
        error = BitneatError("")
        error.args = ("two\nlines",)
        raise error

    with pytest.raises(FindingError, match="one line of text"):
        check(tmp_path / "file", b"x", read)


@pytest.mark.parametrize("text", ["a\nb", "\x1b[2J", "\ud800", "\u202eabc", "x" * 10**6, "\0" * 900])
def test_every_error_is_one_line_of_printable_text(text: str) -> None:
    message = str(BitneatError(f"file: {text}: expected less"))
    assert message.isprintable()
    assert len(message) <= MAX_MESSAGE
    assert message.startswith("file: ")
    assert message.endswith(": expected less")
