# SPDX-License-Identifier: MIT
"""Sealed JSON, and checkpoints of which the one before stands in for a damaged one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.state import MAX_CONTAINERS, DamagedError, StateFile, is_whole, read_state, seal, unseal
from tests.sealed import sealed


def test_a_seal_is_what_the_document_says() -> None:
    assert seal({"a": [1, "é"]}).decode() == (
        '{"a":[1,"é"],"sha256":"31e9740868bc0f87811d0be154ae0cb4921c50fbebaab5e9f2102a15982a1b76"}\n'
    )
    assert seal({"a": 1}, indent=2).startswith(b'{\n  "a": 1,\n  "sha256": "')
    assert seal({"a": 1}, indent=2).endswith(b'"\n}\n')
    for indent in (None, 2):
        content = seal({"a": {"b": []}, "c": "}"}, indent=indent)
        assert unseal(content, "x") == {"a": {"b": []}, "c": "}"}
        assert is_whole(content)
        assert not is_whole(content.replace(b"c", b"d", 1))


def test_a_seal_by_others_is_read() -> None:
    assert unseal(sealed({"x": [1.5, None]}).encode(), "x") == {"x": [1.5, None]}


@pytest.mark.parametrize("content", [b"", b"{}", b'{"a": 1}', b"\xff", b'{"sha256": "' + b"0" * 64 + b'"}'])
def test_what_has_no_seal_is_damaged_where_one_is_required(content: bytes) -> None:
    with pytest.raises(DamagedError, match=r"^x\.json: damaged: "):
        unseal(content, "x.json")


def test_a_text_of_too_many_lists_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(BitneatError, match="refused: more than") as caught:
        unseal(b"[" * (MAX_CONTAINERS + 1), "x")
    assert not isinstance(caught.value, DamagedError)


def test_a_newer_version_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(sealed({"format": "f", "version": 3}))
    with pytest.raises(BitneatError, match="version 3: this bitneat reads 2") as caught:
        read_state(path, "f", 2, 1000)
    assert not isinstance(caught.value, DamagedError)


def test_the_state_before_is_kept_and_stands_in(tmp_path: Path) -> None:
    file, told = StateFile(tmp_path / "a.json", "f", 2, 1000), list[str]()
    assert not file.exists()
    for number in range(3):
        file.save({"n": number})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-previous.json", "a.json"]
    assert file.load(told.append)[1]["n"] == 2
    (tmp_path / "a.json").write_text("")
    assert file.load(told.append)[1]["n"] == 1
    assert told == [f"{tmp_path / 'a.json'}: damaged: not JSON; going on from {tmp_path / 'a-previous.json'}"]
    file.save({"n": 3})  # a damaged file does not take the place of a whole one
    assert json.loads((tmp_path / "a-previous.json").read_text())["n"] == 1
    assert file.load(told.append)[1]["n"] == 3
    for path in tmp_path.iterdir():
        path.write_text("{")
    with pytest.raises(DamagedError, match=r"a\.json: damaged"):
        file.load(told.append)


def test_where_there_are_no_links_the_state_before_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("bitneat.state.os.link", no_links)
    file = StateFile(tmp_path / "a.json", "f", 2, 1000)
    file.save({"n": 0})
    first = (tmp_path / "a.json").read_bytes()
    file.save({"n": 1})
    assert (tmp_path / "a-previous.json").read_bytes() == first
    assert len(list(tmp_path.iterdir())) == 2
