# SPDX-License-Identifier: MIT
"""What the templates of the header and the two styles print: everything about meaning is decided here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from bitneat.codegen.interpreter import (
    NARROW_CLIP_MAX,
    WORD_SUM_MAX,
    InterpreterView,
    Word,
    fits_unsigned,
    specialized_view,
    with_mask,
)
from bitneat.codegen.kernels import Kernel, kernel
from bitneat.codegen.recombined import recombined
from bitneat.controller import Action, BoxAction, Constant, Controller, DiscreteAction, Input, Link, Node
from bitneat.controller.interval import NodeIntervals, intervals
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.controller.packing import Blob, Layout

BYTES_PER_LINE = 16
WEIGHTS_PER_BYTE = 4


@dataclass(frozen=True, slots=True)
class Run:
    """Consecutive inputs or outputs that share one line of the header."""

    first: int
    last: int
    text: str

    @property
    def indices(self) -> str:
        """The index, or the first and last one."""
        return f"[{self.first}]" if self.first == self.last else f"[{self.first}..{self.last}]"


@dataclass(frozen=True)
class Interface:
    """What header and source share in every style.

    ``controller`` is canonical; ``packed_bytes`` is the length of its smallest blob, whatever the style holds.
    """

    name: str
    controller: Controller
    action: Action | None
    environment: str
    packed_bytes: int
    guard: bool
    version: str

    @property
    def macro(self) -> str:
        """The prefix of macros."""
        return self.name.upper()

    @property
    def sha256(self) -> str:
        """The controller's fingerprint."""
        return self.controller.sha256

    @property
    def num_inputs(self) -> int:
        """Inputs of a step."""
        return len(self.controller.inputs)

    @property
    def num_outputs(self) -> int:
        """Outputs of a step."""
        return len(self.controller.outputs)

    @property
    def has_state(self) -> bool:
        """Whether a step takes a state, which depends on the controller alone and not on the style."""
        return self.controller.is_recurrent

    @property
    def kind(self) -> str:
        """``ternary``, or what it is else."""
        return "ternary" if self.controller.is_ternary else "power-of-two weights"

    @property
    def state_parameter(self) -> str:
        """The first parameter of a step with state."""
        return f"struct {self.name}_state *state, " if self.has_state else ""

    @property
    def state_argument(self) -> str:
        """The first argument of a step with state."""
        return "&state, " if self.has_state else ""

    @cached_property
    def input_runs(self) -> list[Run]:
        """How each observation becomes a signal."""
        factor = self.controller.frac_bits
        return _runs(
            [
                f"x = clip(rint(observation * 2^{factor + entry.scale}), -{entry.limit}, {entry.limit})"
                for entry in self.controller.inputs
            ]
        )

    @cached_property
    def output_runs(self) -> list[Run]:
        """What each output stands for."""
        one = self.controller.one
        if isinstance(self.action, BoxAction):
            return _runs(
                [
                    f"{low!r} + (clip(y / {one}, -1, 1) + 1) / 2 * ({high!r} - {low!r})"
                    for low, high in zip(self.action.low, self.action.high, strict=True)
                ]
            )
        if isinstance(self.action, DiscreteAction):
            return _runs(["the largest output wins, the lowest index of equals"] * self.num_outputs)
        return _runs([f"y / {one}"] * self.num_outputs)

    @cached_property
    def decision(self) -> Decision | None:
        """How to choose among discrete actions, or None."""
        if not isinstance(self.action, DiscreteAction):
            return None
        return Decision(tuple(range(1, self.num_outputs)), self.action.start)

    @property
    def decision_helpers(self) -> set[str]:
        """The arithmetic functions that the choice calls."""
        return {"mask"} if self.decision and self.decision.others else set()


@dataclass(frozen=True, slots=True)
class Decision:
    """A branch-free argmax over the outputs 0 and ``others``, counted from ``start``."""

    others: tuple[int, ...]
    start: int


def _runs(texts: Sequence[str]) -> list[Run]:
    runs: list[Run] = []
    for index, text in enumerate(texts):
        if runs and runs[-1].text == text:
            runs[-1] = Run(runs[-1].first, index, text)
        else:
            runs.append(Run(index, index, text))
    return runs


def byte_lines(data: bytes) -> list[str]:
    """The bytes of a table, some to a line."""
    return [
        ", ".join(f"0x{byte:02x}" for byte in data[start : start + BYTES_PER_LINE]) + ","
        for start in range(0, len(data), BYTES_PER_LINE)
    ]


@dataclass(frozen=True, slots=True)
class Load:
    """A local variable and the expression it starts with."""

    name: str
    value: str


@dataclass(frozen=True, slots=True)
class UnrolledNode:
    """One node of the straight-line code: its sum starts at ``start``, each term is added, the result is ``value``."""

    name: str
    comment: str
    sum_name: str
    start: str
    terms: tuple[str, ...]
    value: str


@dataclass(frozen=True, slots=True)
class UnrolledView:
    """The body of an unrolled step."""

    weights: tuple[str, ...]
    num_weight_bytes: int
    loads: tuple[Load, ...]
    reads_observation: bool
    reads_state: bool
    nodes: tuple[UnrolledNode, ...]
    num_state: int
    """Remembered signals; at least 1 where there is a state, even if the passes left nothing to remember."""
    commits: tuple[Load, ...]
    outputs: tuple[Load, ...]
    kernels: tuple[Kernel, ...]
    helpers: frozenset[str]
    word: Word


def unrolled_view(interface: Interface, controller: Controller) -> UnrolledView:
    """Lay out a straight-line step.

    Args:
        interface: of the canonical controller.
        controller: what is printed: any controller with the same outputs for every input sequence.
    """
    return _Unroller(interface, controller).view()


class _Unroller:
    def __init__(self, interface: Interface, controller: Controller) -> None:
        self.interface = interface
        self.prefix = interface.name
        self.controller = controller
        self.layout = Layout(controller)
        self.bounds = intervals(controller)
        self.recombined = recombined(controller, self.bounds.nodes)
        self.helpers: set[str] = set()
        self.word: Word = "unsigned" if self.fits_unsigned() else "uint32_t"
        self.codes: list[int] = []

    def view(self) -> UnrolledView:
        nodes = tuple(
            self.node(index, node, bounds)
            for index, (node, bounds) in enumerate(zip(self.controller.nodes, self.bounds.nodes, strict=True))
        )
        used = {node.activation for node in self.controller.nodes} - {"identity", "clamped"}
        kernels = tuple(
            kernel(name, self.prefix, self.controller.frac_bits) for name in self.layout.activations if name in used
        )
        for k in kernels:
            self.helpers |= k.helpers
        loads = self.loads()
        packed = bytes(
            sum(code << 2 * i for i, code in enumerate(self.codes[start : start + WEIGHTS_PER_BYTE]))
            for start in range(0, len(self.codes), WEIGHTS_PER_BYTE)
        )
        commits = tuple(
            Load(f"state->delayed[{i}]", self.stored(signal)) for i, signal in enumerate(self.layout.delayed)
        )
        outputs = tuple(
            Load(f"action[{i}]", str(output.value) if isinstance(output, Constant) else self.stored(output.index))
            for i, output in enumerate(self.controller.outputs)
        )
        return UnrolledView(
            weights=tuple(byte_lines(packed)),
            num_weight_bytes=len(packed),
            loads=loads,
            reads_observation=bool(loads) or any("observation[" in term for node in nodes for term in node.terms),
            reads_state=any("state->" in term for node in nodes for term in node.terms),
            nodes=nodes,
            num_state=max(len(self.layout.delayed), 1),
            commits=commits,
            outputs=outputs,
            kernels=kernels,
            helpers=with_mask(self.helpers | self.interface.decision_helpers),
            word=self.word,
        )

    def fits_unsigned(self) -> bool:
        """Whether sums may be of type ``unsigned``, even where that has 16 bits.

        Only activations that need no constants beyond One are printed that way; what wraps on the way to a sum does no harm.
        """
        if self.interface.guard or self.interface.decision_helpers:
            return False
        for node, bounds in zip(self.controller.nodes, self.bounds.nodes, strict=True):
            if node.activation == "clamped":
                largest = WORD_SUM_MAX - self.controller.one
            elif node.activation == "identity":
                largest = WORD_SUM_MAX
            else:
                return False
            if bounds.scaled.magnitude > largest or bounds.accumulator.magnitude > WORD_SUM_MAX:
                return False
        return True

    def stored(self, index: int) -> str:
        """A signal as the int16_t that leaves the function."""
        self.helpers.add("signal")
        value = f"x{index}" if index < len(self.controller.inputs) else self.value(index)
        return f"{self.prefix}_signal({value})"

    def value(self, index: int) -> str:
        """A signal as a word."""
        first_node = len(self.controller.inputs)
        if index >= first_node:
            return f"n{index - first_node}"
        # Small chips do best to read an input where it is used: they could not keep all of them in registers, and what is
        # spilled must be written before it is read.
        return f"x{index}" if self.interface.guard else f"({self.word})observation[{index}]"

    def loads(self) -> tuple[Load, ...]:
        """The inputs that are kept in locals: those that are passed on, since outputs may be written over the observation.

        With a guard it is all that are read, so that each is clipped just once.
        """
        used = {output.index for output in self.controller.outputs if not isinstance(output, Constant)}
        used |= set(self.layout.delayed)
        if self.interface.guard:
            used |= {link.source for node in self.controller.nodes for link in node.links if not link.delay}
            self.helpers |= {"clip"} if any(index < len(self.controller.inputs) for index in used) else set()
        return tuple(
            Load(f"x{index}", self.guarded(f"observation[{index}]", entry))
            for index, entry in enumerate(self.controller.inputs)
            if index in used
        )

    def guarded(self, source: str, entry: Input) -> str:
        if not self.interface.guard:
            return f"({self.word}){source}"
        return f"{self.prefix}_clip((uint32_t)(int32_t){source}, {entry.limit}U)"

    def node(self, index: int, node: Node, bounds: NodeIntervals) -> UnrolledNode:
        sum_name = f"sum{index}"
        shifted = index in self.recombined.links
        # What is added goes first: a sum that starts with a subtraction costs a negation.
        terms = tuple(self.term(link, shifted) for link in sorted(node.links, key=lambda link: -link.sign))
        return UnrolledNode(
            name=f"n{index}",
            comment=self.describe(node),
            sum_name=sum_name,
            start=self.wrapped(node.bias),
            terms=terms,
            value=self.response(sum_name, index, bounds),
        )

    def wrapped(self, value: int) -> str:
        """An integer as a C expression of a sum's type, in two's complement."""
        if self.word == "unsigned":
            return f"{value}U" if value > 0 else f"0U - {-value}U" if value else "0"
        if value >= 0:
            return f"UINT32_C({value})" if value else "0"
        return f"UINT32_C(0) - UINT32_C({-value})"

    def local(self, link: Link) -> str:
        if link.delay:
            return f"({self.word})state->delayed[{self.layout.delayed.index(link.source)}]"
        return self.value(link.source)

    def name(self, link: Link) -> str:
        """A link's source as comments have it."""
        if link.delay:
            return f"d{self.layout.delayed.index(link.source)}"
        first_node = len(self.controller.inputs)
        return f"x{link.source}" if link.source < first_node else f"n{link.source - first_node}"

    def term(self, link: Link, shifted: bool) -> str:
        """One addition: the source, masked by both bits of its 2-bit weight; ``shifted`` as in `Recombined.links`."""
        at = len(self.codes)
        self.codes.append(1 if link.sign > 0 else 2)
        byte = f"({self.word}){self.prefix}_weights[{at // WEIGHTS_PER_BYTE}]"
        low = 2 * (at % WEIGHTS_PER_BYTE)
        x = self.local(link)
        if link.shift:
            x = f"({x} << {link.shift})"
            # A shift that is subtracted is a multiplication by -2^k to some compilers, as a sum of shifts is one by their sum.
            if shifted or link.sign < 0:
                self.helpers.add("opaque")
                x = f"{self.prefix}_opaque{x}"
        return f"({x} & (0U - ({byte} >> {low} & 1U))) - ({x} & (0U - ({byte} >> {low + 1} & 1U)))"

    def response(self, total: str, index: int, bounds: NodeIntervals) -> str:
        """Gain, saturation where it can happen, and activation, as one expression of a sum's type."""
        node = self.controller.nodes[index]
        value = total
        if node.gain > 0:
            if index in self.recombined.gains or all(link.sign < 0 for link in node.links):
                self.helpers.add("opaque")
                value = f"{self.prefix}_opaque({value})"
            value = f"{value} << {node.gain}"
        elif node.gain < 0:
            self.helpers.add("floor_shift")
            value = f"{self.prefix}_floor_shift({value}, {-node.gain})"
        # The clamp to ±One swallows the saturation before it.
        limit = self.controller.one if node.activation == "clamped" else SIGNAL_MAX
        if bounds.scaled.magnitude > limit:
            clip = "clip" if bounds.scaled.magnitude <= NARROW_CLIP_MAX else "clip_wide"
            self.helpers.add(clip)
            value = f"{self.prefix}_{clip}({value}, {limit}U)"
        if node.activation not in ("identity", "clamped"):
            value = f"{self.prefix}_act_{node.activation}({value})"
        return value

    def describe(self, node: Node) -> str:
        """The node as a formula, for a comment."""
        terms = [
            ("-" if link.sign < 0 else "+") + f" {self.name(link)}" + (f" * 2^{link.shift}" if link.shift else "")
            for link in sorted(node.links, key=lambda link: -link.sign)
        ]
        if node.bias:
            terms.append(("-" if node.bias < 0 else "+") + f" {abs(node.bias)}")
        text = " ".join(terms).removeprefix("+ ") or "0"
        text = text.replace("- ", "-", 1) if text.startswith("- ") else text
        if node.gain:
            text = f"({text}) * 2^{node.gain}"
        return f"{node.activation}({text})"


@dataclass(frozen=True, slots=True)
class TableView:
    """What surrounds the interpreter in the table style."""

    body: tuple[str, ...]
    num_bytes: int
    encoding: str
    interpreter: InterpreterView
    num_signals: int
    num_state: int
    presets: tuple[Load, ...]
    delays: tuple[Load, ...]
    commits: tuple[Load, ...]
    copies: tuple[Load, ...]
    limit: int | None
    """The limit that all inputs share, or None: then ``limits`` has one for each."""
    limits: tuple[str, ...]
    helpers: frozenset[str]


def table_view(interface: Interface, blob: Blob) -> TableView:
    """Lay out a step around the interpreter of one blob."""
    controller = interface.controller
    layout = Layout(controller)
    narrow = not (interface.guard or interface.decision_helpers) and fits_unsigned(controller, blob.encoding)
    view = specialized_view(controller, blob, interface.name, "unsigned" if narrow else "uint32_t")
    presets = []
    if layout.has_ternary_bias:
        presets.append(Load(f"signals[{layout.one_slot}]", f"{controller.one}"))
    if layout.has_empty_node:
        presets.append(Load(f"signals[{layout.zero_slot}]", "0"))
    limits = {entry.limit for entry in controller.inputs}
    helpers = set(view.helpers) if controller.nodes else set()
    if interface.guard:
        helpers |= {"clip", "signal"}
    return TableView(
        body=tuple(byte_lines(blob.data[blob.body_offset :])),
        num_bytes=len(blob.data) - blob.body_offset,
        encoding=blob.encoding,
        interpreter=view,
        num_signals=layout.workspace_length,
        num_state=len(layout.delayed),
        presets=tuple(presets),
        delays=tuple(
            Load(f"signals[{layout.first_delayed + i}]", f"state->delayed[{i}]") for i in range(len(layout.delayed))
        ),
        commits=tuple(
            Load(f"state->delayed[{i}]", f"signals[{layout.slot_of(signal)}]")
            for i, signal in enumerate(layout.delayed)
        ),
        copies=tuple(
            Load(
                f"signals[{layout.num_slots + i}]",
                str(output.value) if isinstance(output, Constant) else f"signals[{layout.slot_of(output.index)}]",
            )
            for i, output in enumerate(controller.outputs)
            if layout.has_output_map
        ),
        limit=limits.pop() if len(limits) == 1 else None,
        limits=tuple(str(entry.limit) for entry in controller.inputs),
        helpers=with_mask(helpers | interface.decision_helpers),
    )
