# SPDX-License-Identifier: MIT
"""Champion files: what is written can be read, and nothing that is read can run."""

from __future__ import annotations

import io
import json
import os
import pickle
import struct
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.champion import Champion, EnvironmentSpec
from bitneat.controller import BoxAction, Controller, DiscreteAction, Input, Link, Node, Signal
from bitneat.errors import BitneatError
from bitneat.unpickle import MAX_OPCODES


@pytest.fixture
def champion() -> Champion:
    controller = Controller(
        inputs=(Input(), Input(2, 300)),
        nodes=(Node((Link(0), Link(1, 0, 0, -1)), 256, 2, "tanh"), Node((Link(2, 1), Link(1)), 0, -1, "clamped")),
        outputs=(Signal(3),),
    )
    return Champion(
        controller,
        BoxAction((-2.0,), (2.0,), (1,), "float32"),
        EnvironmentSpec("Pendulum-v1", {"g": 9.81}, ("module",)),
        {
            "seed": 3,
            "held_out": {"mean": -150.25, "first_seed": 1},
            "config": "[evolve]\n",
            "none": None,
            "list": [True],
        },
    )


class Payload:
    """A pickle of this creates the file when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.path),)


def test_a_champion_survives_both_forms_without_loss(champion: Champion, tmp_path: Path) -> None:
    champions.save_pickle(champion, tmp_path / "champion.pkl")
    champions.save_json(champion, tmp_path / "champion.json")
    assert champions.load(tmp_path / "champion.pkl") == champion
    assert champions.load(tmp_path / "champion.json") == champion


def test_loading_and_saving_gives_the_same_bytes(champion: Champion) -> None:
    content = champions.dump_pickle(champion)
    assert champions.dump_pickle(champions.loads(content)) == content
    assert champions.dump_pickle(champions.loads(champions.dumps(champion).encode())) == content


def test_pickle_bytes_do_not_depend_on_shared_objects(champion: Champion) -> None:
    shared = "a text"
    together = Champion(champion.controller, champion.action, None, {"a": shared, "b": shared})
    apart = Champion(champion.controller, champion.action, None, {"a": shared, "b": "".join(["a ", "text"])})
    assert champions.dump_pickle(together) == champions.dump_pickle(apart)


@pytest.mark.parametrize("protocol", range(6))
def test_a_pickle_that_would_run_a_command_is_refused_and_runs_nothing(tmp_path: Path, protocol: int) -> None:
    canary = tmp_path / "canary"
    for data in (Payload(canary), {"format": champions.FORMAT, "version": 1, "controller": Payload(canary)}):
        file = tmp_path / "hostile.pkl"
        file.write_bytes(pickle.dumps(data, protocol))
        with pytest.raises(BitneatError, match=r"hostile\.pkl: refused: the pickle uses"):
            champions.load(file)
        assert not canary.exists()


@pytest.mark.parametrize(
    "content",
    [
        b"cos\nsystem\n(S'true'\ntR.",
        b"(S'true'\nios\nsystem\n.",
        b"\x80\x02Pid\n.",
        b"\x80\x04\x95\x00\x00\x00\x00\x00\x00\x00\x00Q.",
        b"\x80\x02\x82\x01.",
        b"\x80\x05\x96" + struct.pack("<Q", 2**62) + b".",
        b"\x80\x04\x8d" + struct.pack("<Q", 2**62) + b".",
        b"\x80\x04\x8b" + struct.pack("<I", 2**31 - 1) + b".",
    ],
)
def test_opcodes_that_plain_data_does_not_need_are_refused(content: bytes) -> None:
    with pytest.raises(BitneatError, match=r"refused|damaged"):
        champions.loads(content)


def test_a_memo_number_costs_nothing() -> None:
    assert champions.plain_pickle(b"\x80\x04]r" + struct.pack("<I", 2**31 - 1) + b".") == []


def test_every_truncated_champion_is_one_clear_error(champion: Champion) -> None:
    for content in (champions.dump_pickle(champion), champions.dumps(champion).rstrip().encode()):
        for length in range(0, len(content), 7):
            with pytest.raises(BitneatError) as caught:
                champions.loads(content[:length])
            assert "\n" not in str(caught.value)


def test_a_champion_of_a_later_version_is_refused(champion: Champion) -> None:
    data = champion.to_data() | {"version": 2}
    for content in (json.dumps(data).encode(), pickle.dumps(data)):
        with pytest.raises(BitneatError, match="version: 2 was written by a newer bitneat"):
            champions.loads(content)


@pytest.mark.parametrize(
    "data",
    [
        [],
        {},
        {"format": "other"},
        "text",
        None,
        7,
        {"format": champions.FORMAT},
        {"format": champions.FORMAT, "version": 1},
    ],
)
def test_foreign_files_are_refused(data: object) -> None:
    with pytest.raises(BitneatError):
        champions.loads(pickle.dumps(data))
    with pytest.raises(BitneatError):
        champions.loads(json.dumps(data).encode())


def test_the_error_names_file_and_field(champion: Champion, tmp_path: Path) -> None:
    data = champion.to_data()
    data["controller"]["nodes"][1]["gain"] = 99
    path = tmp_path / "champion.json"
    path.write_text(json.dumps(data))
    with pytest.raises(BitneatError, match=r"champion\.json: nodes\[1\]\.gain: 99 is outside -7\.\.7"):
        champions.load(path)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("environment", {"id": 3, "kwargs": {}, "imports": []}, r"environment\.id"),
        ("environment", {"id": "x", "kwargs": [], "imports": []}, r"environment\.kwargs"),
        ("environment", {"id": "x", "kwargs": {}, "imports": [1]}, r"environment\.imports"),
        ("environment", [], "environment: expected a mapping"),
        ("action", {"kind": "discrete", "n": 5, "start": 0}, "action: needs 5 outputs"),
        ("action", {}, "action: expected"),
        ("provenance", [], "provenance: expected a mapping"),
        ("surplus", 1, "unknown key 'surplus'"),
    ],
)
def test_wrong_fields_are_named(champion: Champion, field: str, value: object, message: str) -> None:
    data = champion.to_data()
    data[field] = value
    with pytest.raises(BitneatError, match=message):
        champions.loads(json.dumps(data).encode())


def test_deep_shared_and_unfinite_data_is_refused() -> None:
    deep: object = 1
    for _ in range(60):
        deep = [deep]
    laughs: list[object] = ["ha"]
    for _ in range(20):
        laughs = [laughs] * 10
    for data in (deep, laughs, {"a": float("nan")}, {"a": float("inf")}, {1: 2}):
        with pytest.raises(BitneatError, match="refused"):
            champions.plain_pickle(pickle.dumps(data, 4))
    with pytest.raises(BitneatError, match="no JSON number"):
        champions.loads(b'{"a": NaN}')
    with pytest.raises(BitneatError, match="damaged"):
        champions.loads(b'{"a": ' + b"[" * 100_000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x80\x04}" + b")" + b"\x85" * 100_000 + b"K\x01s.", "levels"),
        (b"\x80\x04}" + b"]" * 100_000 + b"a" * 99_999 + b"K\x01s.", "levels"),
        (b"\x80\x04" + b"(" * 100_000, "levels"),
        (b"\x80\x04}K\x01\x94" + b"".join(b"h%c\x86\x94" % i for i in range(60)) + b"K\x01s.", "used twice"),
        (b"\x80\x04]\x94h\x00a.", "a list that is used twice"),
        (b"\x80\x04}]K\x01s.", "a key is not a string"),
        (b"\x80\x04}\x8c\x03\xed\xa0\x80K\x01s.", "not Unicode"),
        (b"\x80\x04\x86.", "damaged"),
        (b"\x80\x04K\x01K\x02a.", "damaged"),
        (b"\x80\x04" + b"K\x01" * MAX_OPCODES + b".", "operations"),
    ],
)
def test_pickles_made_to_exhaust_their_reader_are_refused(content: bytes, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        champions.plain_pickle(content)


def test_tuples_are_written_and_read_as_lists(champion: Champion) -> None:
    spec = EnvironmentSpec("Pendulum-v1", {"size": (1, (2, 3, 4, 5)), "none": ()})
    with_tuples = Champion(champion.controller, champion.action, spec)
    content = champions.dump_pickle(with_tuples)
    for form in (content, champions.dumps(with_tuples).encode(), pickle.dumps(with_tuples.to_data(), 4)):
        loaded = champions.loads(form)
        assert loaded.environment is not None
        assert loaded.environment.kwargs == {"size": [1, [2, 3, 4, 5]], "none": []}
        assert champions.dump_pickle(loaded) == content


def test_a_file_that_is_too_large_missing_or_a_folder_is_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.pkl"
    with large.open("wb") as file:
        file.truncate(champions.MAX_FILE_BYTES + 1)
    for path in (large, tmp_path / "missing.pkl", tmp_path):
        with pytest.raises(BitneatError, match=path.name):
            champions.load(path)


def test_a_discrete_champion_without_environment_round_trips() -> None:
    controller = Controller((Input(),), (Node((Link(0),)),), (Signal(1), Signal(0)))
    champion = Champion(controller, DiscreteAction(2, 1))
    assert champions.loads(champions.dump_pickle(champion)) == champion


def test_a_plain_pickle_written_by_others_is_read(champion: Champion) -> None:
    for protocol in (2, 3, 4, 5):
        buffer = io.BytesIO()
        pickle.dump(champion.to_data(), buffer, protocol)
        assert champions.loads(buffer.getvalue()) == champion


def test_json_may_begin_with_the_mark_of_utf_8(champion: Champion) -> None:
    assert champions.loads(b"\xef\xbb\xbf" + champions.dumps(champion).encode()) == champion


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[1, 2]", r"not a champion: expected a mapping with 'format': 'bitneat-champion'"),
        (b" \n[1, 2", r"not a champion: damaged or truncated JSON"),
        (b"\xef\xbb\xbf3", r"not a champion: expected a mapping"),
        ("{}".encode("utf-16"), r"not a champion: text in UTF-16, expected JSON in UTF-8"),
        ("{}".encode("utf-16-be").join([b"\xfe\xff", b""]), r"not a champion: text in UTF-16, expected JSON in UTF-8"),
    ],
)
def test_json_that_is_no_champion_is_not_called_a_pickle(content: bytes, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        champions.loads(content)
