# SPDX-License-Identifier: MIT
"""The packed form: exact, smallest, and strict with what it did not write."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.packing import ENCODINGS, Layout, PackedFormatError, pack, pack_blob, unpack
from bitneat.controller.packing.bits import BitReader, BitWriter, rice_cost
from bitneat.controller.packing.encodings import PackedNode, Shape
from bitneat.runtime import OpenBlob
from tests.packing import second_implementation
from tests.strategies import controllers, random_controller


def packable(controller: Controller) -> dict[str, bytes]:
    """The blob in every encoding that applies."""
    blobs = {}
    for encoding in ENCODINGS:
        try:
            blobs[encoding] = pack(controller, encoding)
        except PackedFormatError as error:
            assert "shifts" in str(error)
    return blobs


@given(controllers())
def test_every_encoding_gives_the_controller_back(controller: Controller) -> None:
    blobs = packable(controller)
    assert {"bytes", "rice"} <= set(blobs)
    for blob in blobs.values():
        assert unpack(blob) == controller.canonical
        assert unpack(blob).sha256 == controller.sha256


@given(controllers())
def test_the_smallest_encoding_is_chosen(controller: Controller) -> None:
    assert len(pack(controller)) == min(len(blob) for blob in packable(controller).values())


@pytest.mark.parametrize("seed", range(300))
def test_random_controllers_round_trip(seed: int) -> None:
    controller = random_controller(random.Random(seed))
    for blob in packable(controller).values():
        assert unpack(blob) == controller.canonical


@pytest.mark.parametrize("seed", range(1000, 1200))
def test_an_implementation_from_the_document_alone_gives_the_same_bits(seed: int) -> None:
    canonical = random_controller(random.Random(seed)).canonical
    for encoding, blob in packable(canonical).items():
        assert second_implementation.pack(canonical.to_data(), encoding) == blob
        assert Controller.from_data(second_implementation.unpack(blob)) == canonical


def dense(share: float) -> Controller:
    """A layer of ternary links of which ``share`` exist."""
    rng = random.Random(1)
    nodes = [
        Node(tuple(Link(i, sign=rng.choice((-1, 1))) for i in range(200) if rng.random() < share or i == 0))
        for _ in range(60)
    ]
    return Controller((Input(),) * 200, tuple(nodes), tuple(Signal(200 + i) for i in range(60)))


@pytest.mark.parametrize(
    ("share", "smaller", "larger"),
    [
        (0.02, "bytes", "planes"),
        (0.3, "planes", "bytes"),
        (0.3, "planes", "trits"),
        (0.3, "trits", "two_bits"),
        (0.6, "rice", "planes"),
        (0.9, "trits", "rice"),
    ],
)
def test_sparse_and_dense_networks_want_different_encodings(share: float, smaller: str, larger: str) -> None:
    controller = dense(share)
    assert len(pack(controller, smaller)) < len(pack(controller, larger))
    assert len(pack_blob(controller).data) <= len(pack(controller, smaller))


@given(controllers(), st.data())
def test_a_truncated_or_lengthened_blob_is_refused(controller: Controller, data: st.DataObject) -> None:
    blob = pack(controller)
    cut = data.draw(st.integers(0, len(blob) - 1))
    with pytest.raises(PackedFormatError):
        unpack(blob[:cut])
    with pytest.raises(PackedFormatError):
        unpack(blob + b"\0")


@given(controllers(), st.data())
def test_a_changed_blob_is_refused_or_another_controller(controller: Controller, data: st.DataObject) -> None:
    blob = pack(controller, data.draw(st.sampled_from(["bytes", "rice"])))
    bit = data.draw(st.integers(0, 8 * len(blob) - 1))
    changed = bytearray(blob)
    changed[bit >> 3] ^= 1 << (bit & 7)
    try:
        other = unpack(bytes(changed))
    except PackedFormatError:
        return
    # Only the encoding's own number (bits 3 to 5) can change without changing what is encoded, where there are no nodes.
    assert other != controller.canonical or bit in (3, 4, 5)
    assert other == other.canonical


@given(st.binary(max_size=60))
def test_any_bytes_are_refused_in_one_line_or_are_a_blob(data: bytes) -> None:
    try:
        controller = unpack(data)
    except PackedFormatError as error:
        assert "\n" not in str(error)
    else:
        encoding = list(ENCODINGS)[data[0] >> 3 & 7]
        assert pack(controller, encoding) == data


def test_an_unknown_encoding_is_refused() -> None:
    with pytest.raises(PackedFormatError, match="'hex' is not one of bytes, rice"):
        pack(dense(0.1), "hex")


def test_a_future_version_is_refused() -> None:
    blob = bytearray(pack(dense(0.02)))
    blob[0] = blob[0] & ~7 | 2
    with pytest.raises(PackedFormatError, match="format version 2, expected 1"):
        unpack(bytes(blob))


def test_ternary_biases_cost_a_link_and_no_field() -> None:
    biased = Controller((Input(),), (Node((Link(0),), bias=-256),), (Signal(1),))
    layout = Layout(biased)
    assert layout.has_ternary_bias
    assert layout.bias_width == 0
    assert [link.slot for link in layout.node_links[0]] == [0, layout.one_slot]


@given(st.lists(st.tuples(st.integers(0, 2**20), st.integers(0, 7)), max_size=20))
def test_rice_and_counts_read_back(numbers: list[tuple[int, int]]) -> None:
    writer = BitWriter()
    cost = 0
    small = [(value % 1000, k) for value, k in numbers]
    for value, k in small:
        writer.put_rice(value, k)
        cost += rice_cost(value, k)
    assert len(writer) == cost
    for value, _ in numbers:
        writer.put_count(value)
    reader = BitReader(writer.to_bytes())
    assert [reader.take_rice(k, 1000, "value") for _, k in small] == [value for value, _ in small]
    assert [reader.take_count(2**20, "value") for _ in numbers] == [value for value, _ in numbers]
    reader.finish()


def test_the_known_answers_of_the_document_hold() -> None:
    nodes = (
        Node((), bias=256),
        Node((), bias=0),
        Node((Link(1, delay=1), Link(2, delay=1, sign=-1), Link(3, delay=1)), bias=-256),
    )
    controller = Controller((Input(),), nodes, (Signal(3),))
    page = (Path(__file__).parents[2] / "docs" / "packed-format.md").read_text()
    rows = re.findall(r"^\| (\w+) \| `([0-9a-f]+)` \|$", page, re.MULTILINE)
    assert [name for name, _ in rows] == list(ENCODINGS)
    for encoding, blob in rows:
        assert pack(controller, encoding).hex() == blob


def test_a_controller_without_nodes_has_a_plain_header() -> None:
    controller = Controller((Input(),), (), (Signal(0),))
    assert pack(controller, "bytes").hex() == "0181022008c001"


def test_a_value_wider_than_its_field_is_refused() -> None:
    writer = BitWriter()
    writer.put(7, 3)
    for value in (8, -1):
        with pytest.raises(ValueError, match=rf"^{value} does not fit 3 bits$"):
            writer.put(value, 3)
    assert writer.to_bytes() == b"\7"


def test_a_count_has_one_form_and_a_largest_value() -> None:
    def read(*groups: int, limit: int = 2**20) -> int:
        writer = BitWriter()
        for place, group in enumerate(groups, start=1):
            writer.put(group, 5)
            writer.put(int(place < len(groups)), 1)
        return BitReader(writer.to_bytes()).take_count(limit, "number of things")

    assert [read(0), read(31), read(0, 1), read(1, 2, 3)] == [0, 31, 32, 1 + 2 * 32 + 3 * 1024]
    assert read(5, limit=5) == 5
    with pytest.raises(PackedFormatError, match=r"^blob: number of things is 6, expected at most 5$"):
        read(6, limit=5)
    with pytest.raises(PackedFormatError, match=r"^blob: number of things is written with a needless group$"):
        read(7, 0)
    with pytest.raises(PackedFormatError, match=r"^blob: number of things is too long$"):
        read(*([0] * 8))


def test_a_node_without_links_needs_the_slot_of_zero() -> None:
    shape = Shape(
        num_nodes=1, first_node=1, zero_slot=None, slot_bits=1, record_bytes=1, has_shifts=False, field_bits=0, bias_width=0
    )  # fmt: skip
    with pytest.raises(PackedFormatError, match=r"^blob: a node without links, but no slot of 0$"):
        ENCODINGS["bytes"].write(BitWriter(), shape, [PackedNode(0, 0, ())])


def test_the_workspace_has_room_for_slots_and_for_outputs_that_are_copied() -> None:
    nodes = (Node((Link(0),)), Node((Link(1), Link(0, 1))))
    in_place = Layout(Controller((Input(),), nodes, (Signal(2),)))
    assert (in_place.num_slots, in_place.has_output_map, in_place.workspace_length) == (4, False, 4)
    copied = Layout(Controller((Input(),), nodes, (Signal(2), Signal(0), Signal(2))))
    assert (copied.num_slots, copied.has_output_map, copied.workspace_length) == (4, True, 7)
    for layout in (in_place, copied):
        assert OpenBlob(pack(layout.controller)).workspace_length == layout.workspace_length


def test_bytes_that_are_left_over_are_counted() -> None:
    with pytest.raises(PackedFormatError, match=r"^blob: 2 bytes too long$"):
        unpack(pack(dense(0.1)) + b"\0\0")
