# SPDX-License-Identifier: MIT
"""The packed blob: a self-contained, bit-exact encoding of a canonical controller (`docs/packed-format.md`)."""

from __future__ import annotations

from dataclasses import dataclass

from bitneat.controller.activation import ACTIVATION_CODES, ACTIVATION_NAMES
from bitneat.controller.ir import (
    FRAC_BITS_RANGE,
    GAIN_RANGE,
    MAX_OUTPUTS,
    MAX_SIGNALS,
    SCALE_RANGE,
    Constant,
    Controller,
    ControllerError,
    Input,
    Link,
    Node,
    Output,
    Signal,
)
from bitneat.controller.packing.bits import BitReader, BitWriter, PackedFormatError
from bitneat.controller.packing.encodings import ENCODINGS, Encoding, PackedNode, Shape
from bitneat.controller.packing.layout import Layout, SlotLink

FORMAT_VERSION = 1

BIAS_NONE, BIAS_TERNARY, BIAS_GENERAL = 0, 1, 2
SCALE_BITS = 5
LIMIT_BITS = 15
OUTPUT_CONSTANT_BITS = 16


@dataclass(frozen=True, slots=True)
class Blob:
    """A packed controller: its bytes, where the body starts, and how the body is written."""

    data: bytes
    encoding: str
    body_offset: int
    field_bits: int
    """Bits of the fields of all nodes (activations, gains, general biases): what is neither topology nor weight."""


def pack(controller: Controller, encoding: str | None = None) -> bytes:
    """The packed blob of the controller's canonical form; without an ``encoding`` the smallest of all.

    Raises:
        PackedFormatError: if the encoding is unknown, or cannot express the controller.
    """
    return pack_blob(controller, encoding).data


def pack_blob(controller: Controller, encoding: str | None = None) -> Blob:
    """Like `pack`, with what code generation and size reports need to know of the blob."""
    layout = Layout(controller.canonical)
    if encoding is None:
        shape = shape_of(layout)
        blobs = [_pack(layout, candidate) for candidate in ENCODINGS.values() if candidate.applies(shape)]
        return min(blobs, key=lambda blob: len(blob.data))
    if encoding not in ENCODINGS:
        raise PackedFormatError(f"encoding: {encoding!r} is not one of {', '.join(ENCODINGS)}")
    if not ENCODINGS[encoding].applies(shape_of(layout)):
        raise PackedFormatError(f"encoding: {encoding!r} cannot express links with shifts")
    return _pack(layout, ENCODINGS[encoding])


def shape_of(layout: Layout) -> Shape:
    """What the body's encoding needs to know of a controller."""
    return Shape(
        num_nodes=layout.num_nodes,
        first_node=layout.first_node,
        zero_slot=layout.zero_slot if layout.has_empty_node else None,
        slot_bits=layout.slot_bits,
        record_bytes=layout.record_bytes,
        has_shifts=layout.has_shifts,
        field_bits=layout.activation_bits + layout.gain_bits,
        bias_width=layout.bias_width,
    )


def _pack(layout: Layout, encoding: Encoding) -> Blob:
    writer = BitWriter()
    _write_header(writer, layout, encoding)
    writer.align()
    body_offset = len(writer) // 8
    codes = {name: code for code, name in enumerate(layout.activations)}
    nodes = [
        PackedNode(
            fields=codes[node.activation] | (node.gain - layout.min_gain) << layout.activation_bits,
            bias=node.bias if layout.has_general_bias else 0,
            links=links,
        )
        for node, links in zip(layout.controller.nodes, layout.node_links, strict=True)
    ]
    shape = shape_of(layout)
    encoding.write(writer, shape, nodes)
    return Blob(writer.to_bytes(), encoding.name, body_offset, (shape.field_bits + shape.bias_width) * len(nodes))


def _write_header(writer: BitWriter, layout: Layout, encoding: Encoding) -> None:
    controller = layout.controller
    writer.put(FORMAT_VERSION, 3)
    writer.put(encoding.code, 3)
    writer.put(controller.frac_bits - FRAC_BITS_RANGE[0], 4)
    bias_mode = BIAS_TERNARY if layout.has_ternary_bias else BIAS_GENERAL if layout.has_general_bias else BIAS_NONE
    writer.put(bias_mode, 2)
    writer.put(int(layout.has_shifts), 1)
    writer.put(int(bool(layout.delayed)), 1)
    writer.put(int(layout.has_empty_node), 1)
    writer.put(int(layout.has_output_map), 1)
    classes = sorted({(entry.scale, entry.limit) for entry in controller.inputs})
    has_classes = classes != [(Input().scale, Input().limit)]
    writer.put(int(has_classes), 1)
    writer.put_count(layout.num_inputs)
    writer.put_count(layout.num_nodes)
    writer.put_count(layout.num_outputs)
    _write_activations(writer, layout)
    writer.put(layout.min_gain - GAIN_RANGE[0], 4)
    writer.put(layout.gain_bits, 3)
    if layout.has_general_bias:
        writer.put(layout.bias_width, 6)
    if layout.delayed:
        width = (controller.num_signals - 1).bit_length()
        writer.put_count(len(layout.delayed))
        for signal in layout.delayed:
            writer.put(signal, width)
    if layout.has_output_map:
        for output in controller.outputs:
            _write_output(writer, layout, output)
    if has_classes:
        _write_classes(writer, controller, classes)


def _write_activations(writer: BitWriter, layout: Layout) -> None:
    several = len(layout.activations) != 1
    writer.put(int(several), 1)
    if several:
        writer.put(sum(1 << ACTIVATION_CODES[name] for name in layout.activations), len(ACTIVATION_NAMES))
    else:
        writer.put(ACTIVATION_CODES[layout.activations[0]], 4)


def _write_output(writer: BitWriter, layout: Layout, output: Output) -> None:
    if isinstance(output, Constant):
        writer.put(1, 1)
        writer.put(output.value % (1 << OUTPUT_CONSTANT_BITS), OUTPUT_CONSTANT_BITS)
    else:
        writer.put(0, 1)
        writer.put(output.index, (layout.controller.num_signals - 1).bit_length())


def _write_classes(writer: BitWriter, controller: Controller, classes: list[tuple[int, int]]) -> None:
    writer.put_count(len(classes))
    for scale, limit in classes:
        writer.put(scale - SCALE_RANGE[0], SCALE_BITS)
        writer.put(limit, LIMIT_BITS)
    width = (len(classes) - 1).bit_length()
    for entry in controller.inputs:
        writer.put(classes.index((entry.scale, entry.limit)), width)


def unpack(data: bytes) -> Controller:
    """The canonical controller that `pack` wrote.

    Raises:
        PackedFormatError: if the bytes are not exactly what `pack` writes for some controller.
    """
    reader = BitReader(data)
    try:
        controller = _read(reader)
    except ControllerError as error:
        raise PackedFormatError(f"blob: {error}") from None
    reader.finish()
    encoding = next(e for e in ENCODINGS.values() if e.code == data[0] >> 3 & 7)
    if _pack(Layout(controller.canonical), encoding).data != data:
        raise PackedFormatError("blob: is not in canonical form")
    return controller


def _read(reader: BitReader) -> Controller:
    version = reader.take(3)
    if version != FORMAT_VERSION:
        raise PackedFormatError(f"blob: format version {version}, expected {FORMAT_VERSION}")
    encoding = _one_of(reader.take(3), [e.code for e in ENCODINGS.values()], list(ENCODINGS.values()), "encoding")
    frac_bits = reader.take(4) + FRAC_BITS_RANGE[0]
    bias_mode = reader.take(2)
    has_shifts, has_delays, has_empty, has_map, has_classes = (bool(reader.take(1)) for _ in range(5))
    num_inputs = reader.take_count(MAX_SIGNALS, "number of inputs")
    num_nodes = reader.take_count(MAX_SIGNALS - num_inputs, "number of nodes")
    num_outputs = reader.take_count(MAX_OUTPUTS, "number of outputs")
    num_signals = num_inputs + num_nodes
    if not num_inputs or not num_outputs:
        raise PackedFormatError("blob: no inputs or no outputs")
    if bias_mode > BIAS_GENERAL:
        raise PackedFormatError(f"blob: bias mode {bias_mode}, expected at most {BIAS_GENERAL}")
    signal_width = (num_signals - 1).bit_length()
    activations = _read_activations(reader)
    min_gain = reader.take(4) + GAIN_RANGE[0]
    gain_bits = reader.take(3)
    bias_width = reader.take(6) if bias_mode == BIAS_GENERAL else 0
    if gain_bits > 4 or bias_width > 32:
        raise PackedFormatError("blob: a gain of more than 4 bits or a bias of more than 32")
    delayed = []
    if has_delays:
        delayed = [
            reader.take(signal_width) for _ in range(reader.take_count(num_signals, "number of delayed signals"))
        ]
    outputs: list[Output] = [Signal(num_signals - num_outputs + i) for i in range(num_outputs)]
    if has_map:
        outputs = [_read_output(reader, signal_width) for _ in range(num_outputs)]
    inputs = _read_classes(reader, num_inputs) if has_classes else [Input()] * num_inputs
    reader.align()
    zero_slot = num_inputs + (bias_mode == BIAS_TERNARY)
    first_node = zero_slot + has_empty + len(delayed)
    slot_bits = max(first_node + num_nodes - 1, 0).bit_length()
    shape = Shape(
        num_nodes=num_nodes,
        first_node=first_node,
        zero_slot=zero_slot if has_empty else None,
        slot_bits=slot_bits,
        record_bytes=-(-(slot_bits + 3 * has_shifts + 2) // 8),
        has_shifts=has_shifts,
        field_bits=max(len(activations) - 1, 0).bit_length() + gain_bits,
        bias_width=bias_width,
    )
    slots = _SlotNames(num_inputs, bias_mode == BIAS_TERNARY, has_empty, delayed, frac_bits)
    nodes = tuple(
        _node(packed, slots, activations, min_gain, index) for index, packed in enumerate(encoding.read(reader, shape))
    )
    return Controller(tuple(inputs), nodes, tuple(outputs), frac_bits)


def _one_of(code: int, codes: list[int], values: list[Encoding], what: str) -> Encoding:
    if code not in codes:
        raise PackedFormatError(f"blob: {what} {code} is unknown")
    return values[codes.index(code)]


def _read_activations(reader: BitReader) -> list[str]:
    if reader.take(1):
        mask = reader.take(len(ACTIVATION_NAMES))
        return [name for name, code in ACTIVATION_CODES.items() if mask >> code & 1]
    code = reader.take(4)
    if code >= len(ACTIVATION_NAMES):
        raise PackedFormatError(f"blob: activation {code} is unknown")
    return [ACTIVATION_NAMES[code]]


def _read_output(reader: BitReader, signal_width: int) -> Output:
    if reader.take(1):
        value = reader.take(OUTPUT_CONSTANT_BITS)
        return Constant(value - (value >> 15 << 16))
    return Signal(reader.take(signal_width))


def _read_classes(reader: BitReader, num_inputs: int) -> list[Input]:
    count = reader.take_count(num_inputs, "number of input classes")
    classes = [Input(reader.take(SCALE_BITS) + SCALE_RANGE[0], reader.take(LIMIT_BITS)) for _ in range(count)]
    width = max(count - 1, 0).bit_length()
    indices = [reader.take(width) for _ in range(num_inputs)]
    if any(index >= count for index in indices):
        raise PackedFormatError("blob: an input class that is not there")
    return [classes[index] for index in indices]


@dataclass(frozen=True, slots=True)
class _SlotNames:
    """Turns slots back into links."""

    num_inputs: int
    has_one: bool
    has_zero: bool
    delayed: list[int]
    frac_bits: int

    def read(self, link: SlotLink) -> Link | int:
        """The link that a packed link stands for, or the bias if it reads the slot of One."""
        if link.slot < self.num_inputs:
            return Link(link.slot, 0, link.shift, link.sign)
        rest = link.slot - self.num_inputs
        if self.has_one:
            if rest == 0:
                return link.sign << (self.frac_bits + link.shift)
            rest -= 1
        if self.has_zero:
            if rest == 0:
                raise PackedFormatError("blob: the slot of 0 among other links")
            rest -= 1
        if rest < len(self.delayed):
            return Link(self.delayed[rest], 1, link.shift, link.sign)
        return Link(self.num_inputs + rest - len(self.delayed), 0, link.shift, link.sign)


def _node(packed: PackedNode, slots: _SlotNames, activations: list[str], min_gain: int, index: int) -> Node:
    activation_bits = max(len(activations) - 1, 0).bit_length()
    code = packed.fields & ((1 << activation_bits) - 1)
    if code >= len(activations):
        raise PackedFormatError(f"blob: activation of node {index} is not in the header's set")
    links: list[Link] = []
    bias = packed.bias
    for link in packed.links:
        value = slots.read(link)
        if isinstance(value, int):
            bias += value
        else:
            links.append(value)
    return Node(tuple(sorted(links)), bias, min_gain + (packed.fields >> activation_bits), activations[code])
