# SPDX-License-Identifier: MIT
"""The cases on which mutants of C are judged: few controllers that need every feature, and what they must answer.

Expected outputs are the reference's. The controllers are small, so that a mutant is compiled and run in about a second: random
ones, each of which adds a feature or a pair of features to those before it, and some made by hand for what random ones seldom have.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from bitneat.codegen.interpreter import fits_unsigned, specialized_view
from bitneat.controller import (
    ACTIVATION_NAMES,
    Constant,
    Controller,
    DiscreteAction,
    Input,
    Link,
    Node,
    Signal,
)
from bitneat.controller.packing import ENCODINGS, Layout, PackedFormatError, pack, pack_blob, shape_of, unpack
from bitneat.controller.packing.bits import BitWriter
from bitneat.controller.packing.blob import _pack
from bitneat.verify.vectors import random_vectors
from tests.compiled import Case, Signals, reference_outputs
from tests.runtime.test_validate import mutated, valid_blobs
from tests.strategies import input_vectors, random_controller

VECTORS = 144
STEPS = 24


@dataclass(frozen=True)
class Subject:
    """A controller, its inputs (sequences, steps, inputs), the outputs that are right, and how its C is generated."""

    case: Case
    expected: Signals
    guard: bool = False
    start: int | None = None
    """The first action, if the outputs are a choice among actions."""
    styles: bool = True
    """Whether C is generated; else the runtime alone runs it."""
    canonical: bool = True
    """Whether its blobs are those of its canonical form, as bitneat's are; else of itself, which the runtime takes, too."""

    @property
    def action(self) -> DiscreteAction | None:
        """The action space of a choice."""
        return None if self.start is None else DiscreteAction(len(self.case.controller.outputs), self.start)

    def blobs(self) -> dict[str, bytes]:
        """The controller in every encoding that can express it."""
        controller = self.case.controller
        if self.canonical:
            return {name: pack(controller, name) for name in encodings(controller)}
        layout = Layout(controller)
        return {
            name: _pack(layout, encoding).data
            for name, encoding in ENCODINGS.items()
            if encoding.applies(shape_of(layout))
        }


def encodings(controller: Controller) -> list[str]:
    """The encodings that can express a controller."""
    shape = shape_of(Layout(controller.canonical))
    return [name for name, encoding in ENCODINGS.items() if encoding.applies(shape)]


def features(controller: Controller) -> frozenset[str]:
    """What the runtime and the two styles do differently for controllers with it, alone and in pairs."""
    canonical = controller.canonical
    layout = Layout(canonical)
    found = {
        f"shifts {layout.has_shifts}",
        f"bias {layout.has_ternary_bias} {layout.has_general_bias}",
        f"delays {bool(layout.delayed)}",
        f"map {layout.has_output_map}",
        f"record {layout.record_bytes}",
        *(f"delayed {index < len(canonical.inputs)}" for index in layout.delayed),
    }
    if layout.has_empty_node:
        found.add("empty")
    for encoding in encodings(canonical):
        blob = pack_blob(canonical, encoding)
        word = "unsigned" if fits_unsigned(canonical, encoding) else "uint32_t"
        view = specialized_view(canonical, blob, "p", word)  # type: ignore[arg-type]
        varying = ("step" if view.gain_from is not None else "branch") if view.varying_gain else "fixed"
        sign = (view.fixed_gain > 0) - (view.fixed_gain < 0)
        respond = "expression" if view.response else "single" if view.single_activation else "several"
        found |= {
            f"{encoding} {word} {respond} {varying} {view.clip} {view.saturates}",
            f"{encoding} fields {view.has_fields} bias {view.has_general_bias} gain {varying} {sign}",
            f"{encoding} start {view.start != '0'}",
        }
    found |= {f"activation {node.activation} {min(1, max(-1, node.gain))}" for node in canonical.nodes}
    return frozenset(found)


def _vectors(controller: Controller, seed: int, count: int = VECTORS) -> Signals:
    steps = STEPS if controller.is_recurrent else 1
    rows = [
        *input_vectors(controller, random.Random(seed), count // 2),
        *random_vectors(controller, seed, count - count // 2).tolist(),
    ]
    return np.array(rows, np.int16).reshape(count // steps, steps, len(controller.inputs))


def _subject(controller: Controller, seed: int, **options: object) -> Subject:
    case = Case(controller, _vectors(controller, seed))
    return Subject(case, reference_outputs(case).astype(np.int16), **options)  # type: ignore[arg-type]


def _guarded(controller: Controller, seed: int, start: int | None = None) -> Subject:
    """Inputs of all of int16, -32768 too; what is right is what the clamped ones give."""
    raw = _vectors(controller, seed)
    rng = np.random.Generator(np.random.PCG64(seed))
    wild = rng.integers(-32768, 32767, size=raw.shape, endpoint=True).astype(np.int16)
    wild[0] = -32768
    wild[1] = 32767
    inputs = np.where(rng.random(raw.shape) < 0.5, raw, wild)
    limits = np.array([entry.limit for entry in controller.inputs])
    clamped = np.clip(inputs.astype(np.int64), -limits, limits).astype(np.int16)
    expected = reference_outputs(Case(controller, clamped)).astype(np.int16)
    return Subject(Case(controller, inputs), expected, guard=True, start=start)


def _drawn(count: int) -> Iterable[tuple[int, Controller]]:
    """Random controllers, each with a feature that those before it lack."""
    known: set[str] = set()
    for seed in range(count):
        rng = random.Random(seed)
        options = {
            "activations": rng.choice(
                (ACTIVATION_NAMES, ("clamped",), ("clamped", "identity"), ("tanh",), ("identity",), ("relu", "gauss"))
            )
        }
        controller = random_controller(rng, size="small", **options)  # type: ignore[arg-type]
        if all(isinstance(output, Constant) for output in controller.canonical.outputs):
            continue
        new = features(controller) - known
        if new:
            known |= new
            yield seed, controller


def _by_hand() -> dict[str, Controller]:
    """What random controllers seldom have."""
    one = 256
    wide = tuple(Input(0, 32767) for _ in range(70))
    return {
        # Sums at the very ends of the accumulator, with every gain.
        "largest sums": Controller(
            (Input(), Input()),
            tuple(
                Node(
                    (Link(0, 0, 7, 1), Link(1, 0, 7, -1)),
                    sign * ((2**31 - 1 >> max(gain, 0)) - 2 * (32767 << 7)),
                    gain,
                    activation,
                )
                for gain, activation in (
                    (-7, "identity"),
                    (-1, "identity"),
                    (0, "clamped"),
                    (1, "tanh"),
                    (7, "identity"),
                )
                for sign in (1, -1)
                if (2**31 - 1 >> max(gain, 0)) > 2 * (32767 << 7)
            ),
            tuple(Signal(2 + i) for i in range(8)),
        ),
        "largest sums of every activation": Controller(
            (Input(), Input()),
            tuple(
                Node((Link(0, 0, 7, 1), Link(1, 0, 7, 1)), bias, gain, activation)
                for activation in ACTIVATION_NAMES
                for bias, gain in ((2**31 - 1 - 2 * (32767 << 7), 0), (-(2**24 - 1 - 2 * (32767 << 7)), 7))
            ),
            tuple(Signal(2 + i) for i in range(2 * len(ACTIVATION_NAMES))),
        ),
        "every shift and sign": Controller(
            (Input(0, 300), Input(0, 300)),
            tuple(
                Node((Link(0, 0, shift, 1), Link(1, 0, shift, -1), Link(0, 0, (shift + 3) % 8, -1)), 0, 0, "identity")
                for shift in range(8)
            ),
            tuple(Signal(2 + i) for i in range(8)),
        ),
        "every gain": Controller(
            (Input(0, 255), Input(0, 255)),
            tuple(Node((Link(0), Link(1, sign=-1)), 0, gain, "identity") for gain in range(-7, 8)),
            tuple(Signal(2 + i) for i in range(15)),
        ),
        "two-byte records": Controller(
            wide,
            (
                Node((Link(0), Link(69, sign=-1), Link(35)), one, 0, "clamped"),
                Node((Link(70), Link(64, sign=-1)), -one, -2, "clamped"),
                Node((Link(71, 1), Link(1), Link(63)), 0, 0, "clamped"),
            ),
            (Signal(71), Signal(72)),
        ),
        "two-byte records with shifts": Controller(
            tuple(Input(0, 900) for _ in range(20)),
            (
                Node((Link(19, shift=7), Link(3, shift=2, sign=-1)), 1234567, -3, "identity"),
                Node((Link(20, shift=1), Link(0, 1, 3, -1), Link(20, 1, 0, 1)), -7, 0, "relu"),
            ),
            (Signal(21), Signal(20), Signal(3), Constant(-32767)),
        ),
        "words of sixteen bits": Controller(
            (Input(0, 1000), Input(0, 2000), Input(0, 1500)),
            (
                Node((Link(0), Link(1, sign=-1), Link(2)), 0, 0, "clamped"),
                Node((Link(3), Link(0, sign=-1)), one, -1, "identity"),
                Node((Link(4), Link(3, sign=-1), Link(1)), 0, 1, "clamped"),
            ),
            (Signal(4), Signal(5)),
        ),
        "sixteen bits and memory": Controller(
            (Input(0, 4000), Input(0, 3000)),
            (
                Node((Link(0), Link(3, 1), Link(1, 1, sign=-1)), 0, -1, "clamped"),
                Node((Link(2), Link(1), Link(0, sign=-1)), -one, -3, "clamped"),
            ),
            (Signal(2), Signal(3)),
        ),
        "slots of six bits": Controller(
            tuple(Input(0, 100 + i) for i in range(40)),
            tuple(
                Node((Link(i), Link(39 - i, sign=-1), Link(32 + i), *((Link(39 + i),) if i else ())), one * (i % 2), 0)
                for i in range(8)
            ),
            tuple(Signal(44 + i) for i in range(4)),
        ),
        "inputs as outputs": Controller((Input(0, 7), Input(3, 32767)), (), (Signal(1), Signal(0), Constant(5)), 6),
        "a node of nothing": Controller(
            (Input(0, 500),),
            (
                Node((), 0, 0, "sigmoid"),
                Node((), 0, 0, "identity"),
                Node((Link(1, 1), Link(0), Link(2, 1)), 0, 0, "identity"),
            ),
            (Signal(3), Signal(2)),
        ),
        "remembered inputs in order": Controller(
            (Input(0, 100), Input(0, 200), Input(0, 300)),
            (Node((Link(2, 1), Link(0, 1, sign=-1), Link(1, 1)), 0, 0, "identity"),),
            (Signal(3), Signal(0), Signal(2)),
        ),
    }


def _choice(outputs: int, frac_bits: int = 8) -> Controller:
    """As many outputs as actions, which differ by little and often are equal."""
    nodes = tuple(
        Node((Link(i % 3), Link((i + 1) % 3, sign=-1)), 0, -7 if i % 2 else 0, "identity") for i in range(outputs)
    )
    return Controller((Input(), Input(), Input(0, 40)), nodes, tuple(Signal(3 + i) for i in range(outputs)), frac_bits)


ARGUMENTS = np.arange(-32767, 32768, dtype=np.int16)


def _activations() -> Iterable[Subject]:
    """Every activation at all its arguments: alone at F = 8 as C is generated for it, and all of them for the runtime."""
    for frac_bits in (4, 8, 12):
        nodes = tuple(Node((Link(0),), activation=name) for name in ACTIVATION_NAMES)
        whole = Controller((Input(),), nodes, tuple(Signal(1 + i) for i in range(len(nodes))), frac_bits)
        inputs = ARGUMENTS.reshape(-1, 1, 1)
        case = Case(whole, inputs)
        yield Subject(case, reference_outputs(case).astype(np.int16), styles=frac_bits == 8)


def _many_slots() -> Controller:
    """Records of three bytes: more slots than a slot, a shift and two marks leave room for in two."""
    inputs = tuple(Input(0, 50 + i % 7) for i in range(2100))
    links = (Link(0, shift=2), Link(2099, shift=1, sign=-1), Link(1500), Link(1023, sign=-1), Link(1024, shift=7))
    nodes = (Node(links, 0, 0, "identity"), Node((Link(2100), Link(2047, shift=3)), 0, 0, "relu"))
    return Controller(inputs, nodes, (Signal(2101), Signal(2100)))


def _many_slots_without_shifts() -> Controller:
    """As many in records of two bytes: bits of the slot are where others have the shift's."""
    inputs = tuple(Input(0, 50 + i % 7) for i in range(2100))
    nodes = (
        Node((Link(2099), Link(2048, sign=-1), Link(5)), activation="identity"),
        Node((Link(2100), Link(2060), Link(1024, sign=-1)), activation="identity"),
    )
    return Controller(inputs, nodes, (Signal(2101), Signal(2100)))


def _much_of_everything() -> Controller:
    """More inputs, kinds of inputs, nodes, delayed signals and outputs than a byte can count, and blobs of over 64 KB."""
    count = 360
    inputs = tuple(Input(i % 16 - 8, 40 + i) for i in range(count))
    nodes = tuple(
        Node((Link(i), Link(count + i, 1, sign=-1), *((Link(count - 1 + i),) if i else ())), activation="identity")
        for i in range(count)
    )
    return Controller(inputs, nodes, tuple(Signal(2 * count - 1 - i) for i in range(300)))


def _as_it_is() -> Controller:
    """A node of nothing, which a controller without state has only where it is not canonical; and a constant One beside it."""
    nodes = (
        Node(activation="identity"),
        Node((Link(0), Link(2)), 256, 0, "identity"),
        Node((Link(3), Link(2, sign=-1), Link(1, sign=-1)), -256, 0, "identity"),
        Node((), 256, 0, "identity"),
    )
    return Controller((Input(0, 3000), Input(0, 500)), nodes, (Signal(3), Signal(2), Signal(4), Signal(5)))


@cache
def subjects() -> tuple[Subject, ...]:
    """All of them, always the same."""
    found = [_subject(controller, seed) for seed, controller in _drawn(400)]
    by_hand = _by_hand()
    found += [_subject(controller, 7) for controller in by_hand.values()]
    found += [
        _guarded(by_hand["words of sixteen bits"], 1),
        _guarded(by_hand["remembered inputs in order"], 2),
        _guarded(by_hand["inputs as outputs"], 3),
        _guarded(Controller((Input(0, 9), Input(0, 9)), (Node((Link(0), Link(1))),), (Signal(2),)), 4),
    ]
    found += [
        _subject(_choice(5), 5, start=-3),
        _subject(_choice(2), 6, start=0),
        _subject(_choice(1), 7, start=40000),
        _guarded(_choice(3), 8, start=1),
    ]
    for many in (_many_slots(), _many_slots_without_shifts(), _much_of_everything()):
        few = Case(many, _vectors(many, 9, STEPS))
        found.append(Subject(few, reference_outputs(few).astype(np.int16), styles=False))
    found.append(_subject(_as_it_is(), 10, styles=False, canonical=False))
    found += _activations()
    return tuple(found)


def _without_delays_after_all() -> bytes:
    """A header that says that there are delayed signals, and then that there are 0."""
    writer = BitWriter()
    for value, width in ((1, 3), (0, 3), (4, 4), (0, 2), (0, 1), (1, 1), (0, 1), (0, 1), (0, 1)):
        writer.put(value, width)
    for count in (1, 1, 1):
        writer.put_count(count)
    for value, width in ((0, 1), (1, 4), (7, 4), (0, 3)):
        writer.put(value, width)
    writer.put_count(0)
    writer.align()
    writer.put(0x80, 8)
    return writer.to_bytes()


def _many_links() -> list[bytes]:
    """More links into one node than 16 bits count; and after 65,536 the mark of a node that has none."""
    links = tuple(Link(i, shift=shift) for i in range(8192) for shift in range(8))
    inputs = tuple(Input(0, 1) for _ in range(8193))
    many = (*links, Link(8192))
    good = pack(Controller(inputs, (Node(many, activation="identity"),), (Signal(8193),)), "rice")
    nodes = (Node(activation="identity"), Node(links, activation="identity"))
    layout = Layout(Controller(inputs[1:], nodes, (Signal(8193), Signal(8192))))
    packed = _pack(layout, ENCODINGS["bytes"])
    mark = packed.data[packed.body_offset : packed.body_offset + layout.record_bytes]
    last = packed.data[-1]
    assert last & 0x80
    return [good, packed.data[:-1] + bytes([last & 0x7F]) + mark]


@cache
def blobs() -> tuple[list[bytes], list[bool | None]]:
    """Blobs of all kinds, and for each whether Python refuses it; None where it only objects to another form of the same."""
    rng = random.Random(22)
    good = valid_blobs(range(120))
    found = [*good, *(mutated(rng.choice(good), rng) for _ in range(4000))]
    found += [bytes([rng.randrange(5) << 3 | 1]) + rng.randbytes(rng.randint(0, 40)) for _ in range(1000)]
    # One bit away from sums that just fit, and from each feature of a header.
    most = 2**31 - 1 - 2 * 32767
    for controller in (
        Controller((Input(), Input()), (Node((Link(0), Link(1, sign=-1)), most, 0, "tanh"),), (Signal(2),)),
        Controller((Input(1, 5), Input()), (Node((Link(0), Link(2, 1))), Node((), 256)), (Signal(3), Constant(-9))),
        Controller(
            (Input(), Input(2, 9)), (Node((Link(0, shift=3), Link(1, 1, 1)), 77, -2, "abs"),), (Signal(2), Signal(0))
        ),
        Controller((Input(), Input()), (Node(), Node((Link(0, shift=1), Link(2, 1, 1)))), (Signal(3),)),
    ):
        for name in encodings(controller):
            blob = pack(controller, name)
            number = int.from_bytes(blob, "little")
            found += [(number ^ 1 << bit).to_bytes(len(blob), "little") for bit in range(8 * len(blob))]
    found += [b"", _without_delays_after_all(), *_many_links()]
    refused: list[bool | None] = []
    for blob in found:
        try:
            unpack(blob)
            refused.append(False)
        except PackedFormatError as error:
            refused.append(None if "canonical" in str(error) else True)
    return found, refused
