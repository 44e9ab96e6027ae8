# SPDX-License-Identifier: MIT
"""What the interpreter's template needs to know: of one controller, or of any.

The two views have the same fields. For one controller the expressions are literals and absent features leave no code; for the
general interpreter of the runtime they read the open controller ``c``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from bitneat.codegen.kernels import Kernel, kernel
from bitneat.controller.activation import ACTIVATION_CODES, ACTIVATION_NAMES
from bitneat.controller.interval import intervals
from bitneat.controller.ir import ACCUMULATOR_MAX, SIGNAL_MAX, Controller
from bitneat.controller.packing import ENCODINGS, Blob, Layout

NARROW_CLIP_MAX = 2**31 - 1 - SIGNAL_MAX
"""Up to this magnitude a sum and the largest signal together stay within 32 bits."""

WORD_SUM_MAX = 2**15 - 1
"""The largest magnitude of a sum, and of a sum and a limit together, where the word is an ``unsigned`` of 16 bits."""

Word = Literal["uint32_t", "unsigned"]
"""The C type of sums: ``unsigned`` where 16 bits are enough, so that each chip takes the width that suits it."""


@dataclass(frozen=True, slots=True)
class RecordByte:
    """A further byte of a link record: where its bits go, and the condition under which there is one (None: always)."""

    shift: int
    condition: str | None


@dataclass(frozen=True, slots=True)
class Case:
    """One activation of the dispatch: its code and the call that evaluates it."""

    code: int
    call: str


@dataclass(frozen=True)
class InterpreterView:
    """The features of an interpreter and the C expressions of its numbers; the template only lays them out."""

    prefix: str
    general: bool
    encodings: tuple[str, ...]
    first_node: str
    num_slots: str
    body: str
    trits_body: str
    has_shifts: bool
    has_fields: bool
    field_bits: str
    fields_byte: str
    """The fields of a node where they have a byte of their own."""
    has_general_bias: bool
    bias_width: str
    bias_sign: str
    slot_mask: str
    sign_position: str
    last_position: str
    record_shift: str
    shift_width: str
    more_record_bytes: tuple[RecordByte, ...]
    rice_step: str
    count_k: str
    gap_k: str
    locals: Mapping[str, tuple[str, ...]]
    """Declarations before the loop over the nodes, by encoding."""
    varying_gain: bool
    fixed_gain: int
    gain: str
    clip: str
    single_activation: str | None
    activation: str
    cases: tuple[Case, ...]
    kernels: tuple[Kernel, ...]
    word: Word = "uint32_t"
    start: str = "0"
    """What a sum starts from where there are no general biases."""
    response: str | None = None
    """The whole of gain, saturation and activation as one expression, or None: then it is a function."""
    saturates: bool = True
    """Whether a sum can be beyond the largest signal, so that it must be clipped before a choice of activations."""
    gain_from: int | None = None
    """The first bit of the gain field where each sum is shifted up by that field and down by ``gain_offset``; else None."""
    gain_offset: int = 0

    @property
    def macro(self) -> str:
        """The prefix of macros."""
        return self.prefix.upper()

    @property
    def next_byte(self) -> str:
        """The byte at ``next``, which moves on."""
        return "bn_byte(next++)" if self.general else f"{self.prefix}_next(&next)"

    @property
    def has_small_records(self) -> bool:
        """Whether the links are records of one byte, without shifts and general biases: the usual case, printed shortest."""
        return (
            not self.general
            and self.encodings == ("bytes",)
            and not (self.has_shifts or self.has_general_bias or self.more_record_bytes)
        )

    @property
    def reads_whole_bytes(self) -> bool:
        """Whether anything is read byte by byte."""
        return bool({"bytes", "trits"} & set(self.encodings))

    @property
    def bytes_use_cursor(self) -> bool:
        """Whether the encoding ``bytes`` reads its fields as bits: only general biases need that."""
        return self.has_general_bias

    @property
    def uses_cursor(self) -> bool:
        """Whether anything is read bit by bit."""
        return any(self.reads_bits(encoding) for encoding in self.encodings)

    def reads_bits(self, encoding: str) -> bool:
        """Whether this encoding's nodes are read bit by bit; of trits just the fields are, if there are any."""
        if encoding == "bytes":
            return self.bytes_use_cursor
        return encoding != "trits" or self.has_fields or self.has_general_bias

    @cached_property
    def helpers(self) -> frozenset[str]:
        """The arithmetic functions that are called."""
        names = {"signal"}.union(*(k.helpers for k in self.kernels))
        texts = [self.response or self.single_activation or "", *(case.call for case in self.cases)]
        names |= {name for name in ("clip", "clip_raised", "clip_wide") if any(f"_{name}(" in text for text in texts)}
        if self.single_activation is None and self.response is None:
            if self.saturates:
                names.add(self.clip)
            if not self.general:
                names.add("opaque")
        if self.gain_from is not None:
            names.add("floor_shift_by_sign")
        elif self.varying_gain or self.fixed_gain < 0:
            names.add("floor_shift")
        return with_mask(names)


def with_mask(helpers: Iterable[str]) -> frozenset[str]:
    """The arithmetic functions in use, and the mask that most of them call."""
    names = frozenset(helpers)
    if "clip" in names:
        names |= {"clip_raised"}
    return names | {"mask"} if names & _MASKING else names


_MASKING = frozenset({"min", "max", "copysign", "clip_raised", "clip_wide", "floor_shift_by_sign"})


def general_view() -> InterpreterView:
    """The interpreter with every feature, for blobs that are opened at run time."""
    kernels = tuple(kernel(name, "bn", None) for name in ACTIVATION_NAMES if name != "identity")
    return InterpreterView(
        prefix="bn",
        general=True,
        encodings=tuple(ENCODINGS),
        first_node="c->first_node",
        num_slots="c->num_slots",
        body="c->body",
        trits_body="c->body + ((c->num_nodes * node_bits + 7U) >> 3)",
        has_shifts=True,
        has_fields=True,
        field_bits="(unsigned)(c->activation_bits + c->gain_bits)",
        fields_byte="",
        has_general_bias=True,
        bias_width="c->bias_width",
        bias_sign="c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U)",
        slot_mask="c->slot_mask",
        sign_position="(record_bits - 2U)",
        last_position="(record_bits - 1U)",
        record_shift="(unsigned)(record >> (record_bits - 5U)) & shift_mask",
        shift_width="(c->has_shifts ? 3U : 0U)",
        more_record_bytes=(RecordByte(8, "record_bits > 8"), RecordByte(16, "record_bits > 16")),
        rice_step="(c->has_shifts ? 0U : 1U)",
        count_k="count_k",
        gap_k="gap_k",
        locals={
            "bytes": (
                "const unsigned record_bits = 8U * c->record_bytes;",
                "const unsigned shift_mask = c->has_shifts ? 7U : 0U;",
            ),
            "trits": ("const uint32_t node_bits = (uint32_t)(c->activation_bits + c->gain_bits + c->bias_width);",),
            "rice": (
                "const unsigned count_k = (unsigned)bn_take(&at, 3);",
                "const unsigned gap_k = (unsigned)bn_take(&at, 3);",
            ),
        },
        varying_gain=True,
        fixed_gain=0,
        gain="c->min_gain + (int)(fields >> c->activation_bits)",
        clip="clip_wide",
        single_activation=None,
        activation="c->activations[fields & ((1U << c->activation_bits) - 1U)]",
        cases=(
            *(
                Case(ACTIVATION_CODES[k.name], f"bn_act_{k.name}(sum{', c->frac_bits' if k.takes_frac_bits else ''})")
                for k in kernels
            ),
            Case(ACTIVATION_CODES["identity"], "sum"),
        ),
        kernels=kernels,
    )


def small_view() -> InterpreterView:
    """The general interpreter's loop for one-byte records without shifts and general biases."""
    return replace(
        general_view(),
        has_shifts=False,
        has_general_bias=False,
        fields_byte="has_fields ? bn_byte(next++) : 0U",
        slot_mask="63U",
        sign_position="6",
        last_position="7",
        more_record_bytes=(),
        locals={"bytes": ("const int has_fields = c->activation_bits + c->gain_bits != 0;",)},
    )


def specialized_view(controller: Controller, blob: Blob, prefix: str, word: Word = "uint32_t") -> InterpreterView:
    """The interpreter that can run just the body of the blob of this canonical controller.

    Args:
        controller: canonical.
        blob: its blob.
        prefix: what every name starts with.
        word: the type of sums; ``unsigned`` only if `fits_unsigned` says so.
    """
    layout = Layout(controller)
    activations = layout.activations
    record_bits = 8 * layout.record_bytes
    gains = {node.gain for node in controller.nodes}
    clip = "clip" if _largest_sum(controller) <= NARROW_CLIP_MAX else "clip_wide"
    activation_mask = (1 << layout.activation_bits) - 1
    field_bits = layout.activation_bits + layout.gain_bits
    all_field_bits = (field_bits + layout.bias_width) * layout.num_nodes
    single = _single(prefix, activations[0], clip, controller.one) if len(activations) == 1 else None
    response, start = None, "0"
    if activations == ("clamped",) and gains == {0} and clip == "clip" and not layout.has_general_bias:
        # The clip starts by adding the limit, which a sum can as well start from.
        start, response = f"{controller.one}U", f"{prefix}_clip_raised(sum, {controller.one}U)"
    elif single is not None and gains == {0}:
        response = single
    first_byte = blob.data[blob.body_offset] if controller.nodes else 0  # of rice the two parameters
    has_step_gain = len(gains) > 1 and layout.min_gain < 0 and _can_shift_up(controller, word)
    return InterpreterView(
        prefix=prefix,
        general=False,
        encodings=(blob.encoding,) if controller.nodes else (),
        first_node=str(layout.first_node),
        num_slots=str(layout.num_slots),
        body=f"{prefix}_body",
        trits_body=f"{prefix}_body + {-(-all_field_bits // 8)}",
        has_shifts=layout.has_shifts,
        has_fields=field_bits > 0,
        field_bits=f"{field_bits}",
        fields_byte=f"{prefix}_next(&next)",
        has_general_bias=layout.has_general_bias,
        bias_width=f"{layout.bias_width}",
        bias_sign=f"UINT32_C({1 << layout.bias_width >> 1})",
        slot_mask=f"{(1 << (record_bits - 2 - 3 * layout.has_shifts)) - 1}U",
        sign_position=f"{record_bits - 2}",
        last_position=f"{record_bits - 1}",
        record_shift=f"(unsigned)(record >> {record_bits - 5}) & 7U",
        shift_width="3",
        more_record_bytes=tuple(RecordByte(8 * i, None) for i in range(1, layout.record_bytes)),
        rice_step="0U" if layout.has_shifts else "1U",
        count_k=str(first_byte & 7),
        gap_k=str(first_byte >> 3 & 7),
        locals={},
        varying_gain=len(gains) > 1,
        fixed_gain=layout.min_gain,
        gain=f"(int)(fields >> {layout.activation_bits}) - {-layout.min_gain}"
        if layout.min_gain < 0
        else f"(int)(fields >> {layout.activation_bits}) + {layout.min_gain}",
        clip=clip,
        single_activation=single,
        activation=f"fields & {activation_mask}U",
        cases=tuple(Case(code, _call(prefix, name, clip, controller.one)) for code, name in enumerate(activations))
        if single is None
        else (),
        kernels=tuple(
            kernel(name, prefix, controller.frac_bits) for name in activations if name not in ("identity", "clamped")
        ),
        word=word,
        start=start,
        response=response,
        saturates=_saturates(controller, clip),
        gain_from=layout.activation_bits if has_step_gain else None,
        gain_offset=-layout.min_gain,
    )


def fits_unsigned(controller: Controller, encoding: str) -> bool:
    """Whether the interpreter's sums may be of type ``unsigned``, even where that has 16 bits.

    Only activations that need no constants beyond One are printed that way, and only the encoding that reads no bits: the
    others would gain little on the small chips whose int is that narrow.
    """
    layout = Layout(controller)
    if encoding != "bytes" or layout.has_general_bias or set(layout.activations) - {"identity", "clamped"}:
        return False
    if "clamped" not in layout.activations:
        return False  # identities alone are clipped to a signal, whose range takes more than 16 bits
    clamped = controller.one
    for node, bounds in zip(controller.nodes, intervals(controller).nodes, strict=True):
        largest = WORD_SUM_MAX if node.activation == "identity" else WORD_SUM_MAX - clamped
        if bounds.scaled.magnitude > largest or bounds.accumulator.magnitude > WORD_SUM_MAX:
            return False
    return layout.min_gain >= 0 or _can_shift_up(controller, "unsigned")


def _can_shift_up(controller: Controller, word: Word) -> bool:
    """Whether every sum can be shifted by its gain above the lowest of all, and stays within the word."""
    low, high = min(node.gain for node in controller.nodes), max(node.gain for node in controller.nodes)
    largest = max(bounds.accumulator.magnitude for bounds in intervals(controller).nodes)
    return largest << (high - low) <= (WORD_SUM_MAX if word == "unsigned" else ACCUMULATOR_MAX)


def _saturates(controller: Controller, clip: str) -> bool:
    """Whether some sum has to be clipped to a signal before its activation; a clamp does that itself, if it can take the sum."""
    return clip == "clip_wide" or any(
        bounds.scaled.magnitude > SIGNAL_MAX
        for node, bounds in zip(controller.nodes, intervals(controller).nodes, strict=True)
        if node.activation != "clamped"
    )


def _call(prefix: str, activation: str, clip: str, one: int) -> str:
    if activation == "clamped":
        return f"{prefix}_{clip}(sum, {one}U)"
    return "sum" if activation == "identity" else f"{prefix}_act_{activation}(sum)"


def _single(prefix: str, activation: str, clip: str, one: int) -> str:
    """Saturation and activation in one expression; a clamp swallows the saturation before it."""
    if activation == "clamped":
        return f"{prefix}_{clip}(sum, {one}U)"
    saturated = f"{prefix}_{clip}(sum, {SIGNAL_MAX}U)"
    return saturated if activation == "identity" else f"{prefix}_act_{activation}({saturated})"


def _largest_sum(controller: Controller) -> int:
    """A bound on every node's sum after its gain, for inputs within their limits."""
    return max(
        (
            (abs(node.bias) + sum(controller.signal_limit(link.source) << link.shift for link in node.links))
            << max(node.gain, 0)
            for node in controller.nodes
        ),
        default=0,
    )
