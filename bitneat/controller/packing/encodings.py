# SPDX-License-Identifier: MIT
"""The ways to write the links of a controller; `docs/packed-format.md` lays them out.

An encoding writes and reads the body of a blob: for each node its fields (activation, gain, bias) and its links. Which one is
smallest depends on how many of the possible links there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bitneat.controller.packing.bits import BitReader, BitWriter, PackedFormatError, rice_cost
from bitneat.controller.packing.layout import SlotLink

RICE_PARAMETER_BITS = 3
TRITS_PER_BYTE = 5


@dataclass(frozen=True, slots=True)
class Shape:
    """What an encoding needs to know of a blob before it reads the body; all of it is in the header."""

    num_nodes: int
    first_node: int
    zero_slot: int | None
    slot_bits: int
    record_bytes: int
    has_shifts: bool
    field_bits: int
    bias_width: int

    @property
    def num_slots(self) -> int:
        """Slots that links may read."""
        return self.first_node + self.num_nodes


@dataclass(frozen=True, slots=True)
class PackedNode:
    """A node as the body has it: its field bits as one number, its general bias, and its links by slot and shift."""

    fields: int
    bias: int
    links: tuple[SlotLink, ...]


Nodes = Sequence[PackedNode]


@dataclass(frozen=True, slots=True)
class Encoding:
    """One way to write a body. ``write`` is only called if ``applies`` says so."""

    name: str
    code: int
    applies: Callable[[Shape], bool]
    write: Callable[[BitWriter, Shape, Nodes], None]
    read: Callable[[BitReader, Shape], list[PackedNode]]


def _sign_bit(link: SlotLink) -> int:
    return int(link.sign < 0)


def _sign_of(bit: int) -> int:
    return -1 if bit else 1


def _put_fields(writer: BitWriter, shape: Shape, node: PackedNode) -> None:
    writer.put(node.fields, shape.field_bits)
    writer.put(node.bias % (1 << shape.bias_width), shape.bias_width)


def _take_fields(reader: BitReader, shape: Shape) -> tuple[int, int]:
    fields = reader.take(shape.field_bits)
    bias = reader.take(shape.bias_width)
    if shape.bias_width and bias >> (shape.bias_width - 1):
        bias -= 1 << shape.bias_width
    return fields, bias


def _always(shape: Shape) -> bool:
    del shape
    return True


def _without_shifts(shape: Shape) -> bool:
    return not shape.has_shifts


# bytes: whole bytes throughout; a node's fields, its bias, then a record for each link.


def _write_bytes(writer: BitWriter, shape: Shape, nodes: Nodes) -> None:
    width = 8 * shape.record_bytes
    slot_and_shift = width - 2
    for node in nodes:
        _put_fields(writer, shape, node)
        writer.align()
        links = node.links or (SlotLink(_zero_slot(shape), 0, 1),)
        for link in links:
            record = link.slot | link.shift << (slot_and_shift - 3) if shape.has_shifts else link.slot
            record |= _sign_bit(link) << (width - 2) | int(link is links[-1]) << (width - 1)
            writer.put(record, width)


def _zero_slot(shape: Shape) -> int:
    if shape.zero_slot is None:
        raise PackedFormatError("blob: a node without links, but no slot of 0")
    return shape.zero_slot


def _read_bytes(reader: BitReader, shape: Shape) -> list[PackedNode]:
    width = 8 * shape.record_bytes
    slot_width = width - 2 - 3 * shape.has_shifts
    nodes = []
    for _ in range(shape.num_nodes):
        fields, bias = _take_fields(reader, shape)
        reader.align()
        links = []
        last = 0
        while not last:
            slot = reader.take(slot_width)
            shift = reader.take(3 if shape.has_shifts else 0)
            sign = _sign_of(reader.take(1))
            last = reader.take(1)
            links.append(SlotLink(slot, shift, sign))
        if shape.zero_slot is not None and links == [SlotLink(shape.zero_slot, 0, 1)]:
            links = []
        nodes.append(PackedNode(fields, bias, tuple(links)))
    return nodes


# rice: a count, then for each link the gap to the slot before it, both in Rice code.


def _rice_parameters(shape: Shape, nodes: Nodes) -> tuple[int, int]:
    counts = [len(node.links) for node in nodes]
    gaps = [gap for node in nodes for gap in _gaps(shape, node)]
    options = range(1 << RICE_PARAMETER_BITS)
    return (
        min(options, key=lambda k: sum(rice_cost(count, k) for count in counts)),
        min(options, key=lambda k: sum(rice_cost(gap, k) for gap in gaps)),
    )


def _gaps(shape: Shape, node: PackedNode) -> list[int]:
    # With shifts a slot may come again, so the gap is the difference itself; without, it is at least 1.
    step = 0 if shape.has_shifts else 1
    slots = [-step, *(link.slot for link in node.links)]
    return [b - a - step for a, b in pairwise(slots)]


def _write_rice(writer: BitWriter, shape: Shape, nodes: Nodes) -> None:
    count_k, gap_k = _rice_parameters(shape, nodes)
    writer.put(count_k, RICE_PARAMETER_BITS)
    writer.put(gap_k, RICE_PARAMETER_BITS)
    for node in nodes:
        _put_fields(writer, shape, node)
        writer.put_rice(len(node.links), count_k)
        for link, gap in zip(node.links, _gaps(shape, node), strict=True):
            writer.put_rice(gap, gap_k)
            writer.put(link.shift, 3 if shape.has_shifts else 0)
            writer.put(_sign_bit(link), 1)


def _read_rice(reader: BitReader, shape: Shape) -> list[PackedNode]:
    count_k = reader.take(RICE_PARAMETER_BITS)
    gap_k = reader.take(RICE_PARAMETER_BITS)
    step = 0 if shape.has_shifts else 1
    nodes = []
    for index in range(shape.num_nodes):
        fields, bias = _take_fields(reader, shape)
        count = reader.take_rice(count_k, shape.num_slots * 8, f"number of links of node {index}")
        slot = -step
        links = []
        for _ in range(count):
            slot += step + reader.take_rice(gap_k, shape.num_slots, f"slot of node {index}")
            shift = reader.take(3 if shape.has_shifts else 0)
            links.append(SlotLink(slot, shift, _sign_of(reader.take(1))))
        nodes.append(PackedNode(fields, bias, tuple(links)))
    return nodes


# The dense encodings: for node j a weight for each of the slots 0 .. first_node + j - 1.


def _weights(shape: Shape, index: int, node: PackedNode) -> list[int]:
    weights = [0] * (shape.first_node + index)
    for link in node.links:
        weights[link.slot] = link.sign
    return weights


def _links_from(weights: Sequence[int]) -> tuple[SlotLink, ...]:
    return tuple(SlotLink(slot, 0, weight) for slot, weight in enumerate(weights) if weight)


def _write_planes(writer: BitWriter, shape: Shape, nodes: Nodes) -> None:
    for index, node in enumerate(nodes):
        _put_fields(writer, shape, node)
        for weight in _weights(shape, index, node):
            writer.put(int(weight != 0), 1)
        for link in node.links:
            writer.put(_sign_bit(link), 1)


def _read_planes(reader: BitReader, shape: Shape) -> list[PackedNode]:
    nodes = []
    for index in range(shape.num_nodes):
        fields, bias = _take_fields(reader, shape)
        slots = [slot for slot in range(shape.first_node + index) if reader.take(1)]
        links = tuple(SlotLink(slot, 0, _sign_of(reader.take(1))) for slot in slots)
        nodes.append(PackedNode(fields, bias, links))
    return nodes


_CODE_OF_WEIGHT = {0: 0, 1: 1, -1: 2}
_WEIGHT_OF_CODE = {0: 0, 1: 1, 2: -1}


def _write_two_bits(writer: BitWriter, shape: Shape, nodes: Nodes) -> None:
    for index, node in enumerate(nodes):
        _put_fields(writer, shape, node)
        for weight in _weights(shape, index, node):
            writer.put(_CODE_OF_WEIGHT[weight], 2)


def _read_two_bits(reader: BitReader, shape: Shape) -> list[PackedNode]:
    nodes = []
    for index in range(shape.num_nodes):
        fields, bias = _take_fields(reader, shape)
        weights = []
        for slot in range(shape.first_node + index):
            code = reader.take(2)
            if code not in _WEIGHT_OF_CODE:
                raise PackedFormatError(f"blob: weight code 3 at slot {slot} of node {index}")
            weights.append(_WEIGHT_OF_CODE[code])
        nodes.append(PackedNode(fields, bias, _links_from(weights)))
    return nodes


# trits: the fields of all nodes first, then from a whole byte on five weights a byte, the first in the highest digit.


def _write_trits(writer: BitWriter, shape: Shape, nodes: Nodes) -> None:
    for node in nodes:
        _put_fields(writer, shape, node)
    writer.align()
    digits = [_CODE_OF_WEIGHT[w] for index, node in enumerate(nodes) for w in _weights(shape, index, node)]
    digits += [0] * (-len(digits) % TRITS_PER_BYTE)
    for start in range(0, len(digits), TRITS_PER_BYTE):
        value = 0
        for digit in digits[start : start + TRITS_PER_BYTE]:
            value = 3 * value + digit
        writer.put(value, 8)


def _read_trits(reader: BitReader, shape: Shape) -> list[PackedNode]:
    fields = [_take_fields(reader, shape) for _ in range(shape.num_nodes)]
    reader.align()
    total = sum(shape.first_node + index for index in range(shape.num_nodes))
    digits: list[int] = []
    while len(digits) < total:
        value = reader.take(8)
        if value >= 3**TRITS_PER_BYTE:
            raise PackedFormatError(f"blob: byte {value} is no five trits (0..{3**TRITS_PER_BYTE - 1})")
        digits += [value // 3**power % 3 for power in reversed(range(TRITS_PER_BYTE))]
    if any(digits[total:]):
        raise PackedFormatError("blob: padding trits are not zero")
    nodes = []
    start = 0
    for index, (node_fields, bias) in enumerate(fields):
        end = start + shape.first_node + index
        links = _links_from([_WEIGHT_OF_CODE[digit] for digit in digits[start:end]])
        nodes.append(PackedNode(node_fields, bias, links))
        start = end
    return nodes


ENCODINGS: dict[str, Encoding] = {
    encoding.name: encoding
    for encoding in (
        Encoding("bytes", 0, _always, _write_bytes, _read_bytes),
        Encoding("rice", 1, _always, _write_rice, _read_rice),
        Encoding("planes", 2, _without_shifts, _write_planes, _read_planes),
        Encoding("two_bits", 3, _without_shifts, _write_two_bits, _read_two_bits),
        Encoding("trits", 4, _without_shifts, _write_trits, _read_trits),
    )
}
"""Every encoding by name; of equally small blobs the one that comes first here wins, which is the cheapest to read."""
