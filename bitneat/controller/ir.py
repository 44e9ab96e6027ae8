# SPDX-License-Identifier: MIT
"""The controller: a small, frozen, validated value that everything else speaks about.

It knows nothing of neat-python, Gymnasium or C. Signals are numbered: the inputs first, ``0 .. len(inputs)-1``, then the
nodes in topological order. ``docs/semantics.md`` says what a controller computes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from bitneat.controller.activation import ACTIVATION_NAMES, output_limit
from bitneat.errors import BitneatError

SIGNAL_MAX = 32767
"""Largest magnitude of a signal; -32768 never occurs, so that negation is always exact."""

ACCUMULATOR_MAX = 2**31 - 1
"""Largest magnitude that a node's sum may reach before it is clipped."""

FRAC_BITS_RANGE = (4, 12)
SCALE_RANGE = (-16, 15)
GAIN_RANGE = (-7, 7)
SHIFT_RANGE = (0, 7)
MAX_SIGNALS = 16383
"""Most inputs and nodes together; keeps every index of the packed form in 16 bits."""
MAX_OUTPUTS = 1024


class ControllerError(BitneatError):
    """A controller, or the plain data of one, breaks a rule of the IR."""


@dataclass(frozen=True, slots=True)
class Input:
    """One input: the encoder multiplies the observation by 2^(F+scale) and clips it to ±limit."""

    scale: int = 0
    limit: int = SIGNAL_MAX


@dataclass(frozen=True, slots=True, order=True)
class Link:
    """One signed power-of-two connection, worth ``sign * 2**shift`` times its source.

    ``delay`` 1 reads the value that the source had at the end of the previous step (0 after reset). The field order is the
    canonical sort order.
    """

    source: int
    delay: int = 0
    shift: int = 0
    sign: int = 1


@dataclass(frozen=True, slots=True)
class Node:
    """One node: the sum of its links and bias, times 2^gain (floor), clipped, through the activation."""

    links: tuple[Link, ...] = ()
    bias: int = 0
    gain: int = 0
    activation: str = "clamped"


@dataclass(frozen=True, slots=True)
class Signal:
    """An output that is the value of an input or a node."""

    index: int


@dataclass(frozen=True, slots=True)
class Constant:
    """An output that never changes."""

    value: int


Output = Signal | Constant


def _require_int(value: object, low: int, high: int, where: str) -> int:
    if type(value) is not int:
        raise ControllerError(f"{where}: expected an integer, got {_shown(value)}")
    if not low <= value <= high:
        raise ControllerError(f"{where}: {_shown(value)} is outside {low}..{high}")
    return value


def _require_elements(values: object, types: type | tuple[type, ...], where: str, what: str) -> None:
    if not isinstance(values, tuple):
        raise ControllerError(f"{where}: expected a tuple, got {_shown(values)}")
    for index, value in enumerate(values):
        if not isinstance(value, types):
            raise ControllerError(f"{where}[{index}]: expected {what}, got {_shown(value)}")


def _shown(value: object) -> str:
    """A short, single-line picture of a foreign value for an error message."""
    if type(value) is int and value.bit_length() > 200:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value) if isinstance(value, (bool, int, float, str, type(None))) else type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."


@dataclass(slots=True)
class State:
    """What a controller with delayed links remembers from one step to the next."""

    signals: list[int]
    """Every input and node of the step before; zeros after a reset."""


@dataclass(frozen=True)
class Controller:
    """A validated controller.

    Args:
        inputs: at least one.
        nodes: in topological order over their undelayed links.
        outputs: at least one; each an input, a node or a constant.
        frac_bits: F, the number of fractional bits of every signal, 4..12.

    Raises:
        ControllerError: if a field is out of range, a link points forward without a delay, a (source, delay, shift) repeats
            within a node, or a node's sum could leave the 32-bit accumulator.
    """

    inputs: tuple[Input, ...]
    nodes: tuple[Node, ...]
    outputs: tuple[Output, ...]
    frac_bits: int = 8

    def __post_init__(self) -> None:
        _validate(self)

    @property
    def one(self) -> int:
        """The signal that stands for 1.0: 2^F."""
        return 1 << self.frac_bits

    @property
    def num_signals(self) -> int:
        """Inputs and nodes together."""
        return len(self.inputs) + len(self.nodes)

    @property
    def num_links(self) -> int:
        """Links of all nodes; a bias is not counted."""
        return sum(len(node.links) for node in self.nodes)

    @property
    def is_ternary(self) -> bool:
        """True iff every weight is ±1 and every bias is 0 or ±1, that is a link from a constant one."""
        return all(
            node.bias in (0, self.one, -self.one) and all(link.shift == 0 for link in node.links) for node in self.nodes
        )

    @property
    def is_recurrent(self) -> bool:
        """True iff a link is delayed, so that the controller keeps state between steps."""
        return any(link.delay for node in self.nodes for link in node.links)

    def signal_limit(self, index: int) -> int:
        """Largest magnitude that signal ``index`` can have, from its input limit or its activation alone."""
        if index < len(self.inputs):
            return self.inputs[index].limit
        return output_limit(self.nodes[index - len(self.inputs)].activation, self.frac_bits)

    @cached_property
    def canonical(self) -> Controller:
        """The canonical form: pruned, constants folded, nodes and links in canonical order."""
        from bitneat.controller.canonical import canonicalize

        form = canonicalize(self)
        form.__dict__["canonical"] = form  # it is its own, and finding that out again would cost as much
        return form

    @cached_property
    def sha256(self) -> str:
        """SHA-256 (64 hexadecimal digits) of the numeric content of the canonical form."""
        from bitneat.controller.canonical import fingerprint

        return fingerprint(self.canonical)

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickles between our own processes: plain numbers, some ten times as fast as an object for every link."""
        inputs = tuple((entry.scale, entry.limit) for entry in self.inputs)
        nodes = tuple(
            (
                tuple((link.source, link.delay, link.shift, link.sign) for link in node.links),
                node.bias,
                node.gain,
                node.activation,
            )
            for node in self.nodes
        )
        outputs = tuple(
            (True, output.index) if isinstance(output, Signal) else (False, output.value) for output in self.outputs
        )
        is_canonical = self.__dict__.get("canonical") is self
        return _rebuilt, (inputs, nodes, outputs, self.frac_bits, (is_canonical, self.__dict__.get("sha256")))

    def new_state(self) -> State:
        """The state after a reset: every delayed link reads 0 next."""
        return State([0] * self.num_signals)

    def step(self, inputs: Sequence[int], state: State | None = None) -> list[int]:
        """One control step, in exact integers: what the generated C computes.

        Args:
            inputs: a signal for each input, within its limit; `Encoder` makes them of an observation.
            state: from `new_state`, which the step brings up to date; a controller without delayed links needs none.

        Returns:
            A signal for each output.

        Raises:
            BitneatError: if an input is missing or outside its limit, or the controller needs a state and none is given.
        """
        from bitneat.controller.reference import evaluate_signals, outputs_of

        if state is None:
            if self.is_recurrent:
                raise ControllerError("step: a controller with delayed links needs a state; make one with new_state()")
            state = self.new_state()
        elif len(state.signals) != self.num_signals:
            raise ControllerError(
                f"step: the state has {len(state.signals)} signals, the controller {self.num_signals}"
            )
        state.signals = evaluate_signals(self, inputs, state.signals)
        return outputs_of(self, state.signals)

    def to_data(self) -> dict[str, Any]:
        """The controller as dictionaries, lists, integers and strings, which `from_data` reads back without loss."""
        return {
            "frac_bits": self.frac_bits,
            "inputs": [{"scale": entry.scale, "limit": entry.limit} for entry in self.inputs],
            "nodes": [
                {
                    "activation": node.activation,
                    "gain": node.gain,
                    "bias": node.bias,
                    "links": [
                        {"source": link.source, "sign": link.sign, "shift": link.shift, "delay": link.delay}
                        for link in node.links
                    ],
                }
                for node in self.nodes
            ],
            "outputs": [
                {"signal": output.index} if isinstance(output, Signal) else {"constant": output.value}
                for output in self.outputs
            ],
        }

    @classmethod
    def from_data(cls, data: object) -> Controller:
        """Build a controller from plain data.

        Raises:
            ControllerError: naming the first field that is unknown, missing, of the wrong type or out of range.
        """
        fields = _fields(data, "controller", required=("frac_bits", "inputs", "nodes", "outputs"))
        inputs = tuple(
            Input(**_fields(entry, f"inputs[{i}]", optional=("scale", "limit")))
            for i, entry in enumerate(_list(fields["inputs"], "inputs"))
        )
        nodes = tuple(_node_from_data(entry, f"nodes[{i}]") for i, entry in enumerate(_list(fields["nodes"], "nodes")))
        outputs = tuple(
            _output_from_data(entry, f"outputs[{i}]") for i, entry in enumerate(_list(fields["outputs"], "outputs"))
        )
        return cls(inputs=inputs, nodes=nodes, outputs=outputs, frac_bits=fields["frac_bits"])


def _rebuilt(
    inputs: Iterable[tuple[int, int]],
    nodes: Iterable[tuple[Iterable[tuple[int, int, int, int]], int, int, str]],
    outputs: Iterable[tuple[bool, int]],
    frac_bits: int,
    known: tuple[bool, str | None],
) -> Controller:
    """What `Controller.__reduce__` took apart; it was valid, so it is not validated again.

    ``known`` says whether it is its own canonical form, and what its fingerprint is, if that has been computed.
    """
    is_canonical, sha256 = known
    controller = object.__new__(Controller)
    controller.__dict__.update(
        inputs=tuple(Input(*entry) for entry in inputs),
        nodes=tuple(
            Node(tuple(Link(*link) for link in links), bias, gain, activation)
            for links, bias, gain, activation in nodes
        ),
        outputs=tuple(Signal(value) if is_signal else Constant(value) for is_signal, value in outputs),
        frac_bits=frac_bits,
    )
    if is_canonical:
        controller.__dict__["canonical"] = controller
    if sha256 is not None:
        controller.__dict__["sha256"] = sha256
    return controller


def _fields(data: object, where: str, required: Sequence[str] = (), optional: Sequence[str] = ()) -> dict[str, Any]:
    if not isinstance(data, Mapping):
        raise ControllerError(f"{where}: expected a mapping, got {_shown(data)}")
    for key in data:
        if key not in required and key not in optional:
            raise ControllerError(f"{where}: unknown key {_shown(key)} (known: {', '.join((*required, *optional))})")
    for key in required:
        if key not in data:
            raise ControllerError(f"{where}: missing key {key!r}")
    return dict(data)


def _list(data: object, where: str) -> Iterable[object]:
    if not isinstance(data, (list, tuple)):
        raise ControllerError(f"{where}: expected a list, got {_shown(data)}")
    return data


def _node_from_data(data: object, where: str) -> Node:
    fields = _fields(data, where, required=("links",), optional=("activation", "gain", "bias"))
    fields["links"] = tuple(
        Link(**_fields(link, f"{where}.links[{j}]", required=("source", "sign"), optional=("shift", "delay")))
        for j, link in enumerate(_list(fields["links"], f"{where}.links"))
    )
    return Node(**fields)


def _output_from_data(data: object, where: str) -> Output:
    fields = _fields(data, where, optional=("signal", "constant"))
    if len(fields) != 1:
        raise ControllerError(f"{where}: expected one of 'signal' and 'constant'")
    return Signal(fields["signal"]) if "signal" in fields else Constant(fields["constant"])


def _validate(controller: Controller) -> None:
    _require_elements(controller.inputs, Input, "inputs", "an input")
    _require_elements(controller.nodes, Node, "nodes", "a node")
    _require_elements(controller.outputs, (Signal, Constant), "outputs", "a signal or a constant")
    _require_int(controller.frac_bits, *FRAC_BITS_RANGE, "frac_bits")
    _require_int(len(controller.inputs), 1, MAX_SIGNALS, "number of inputs")
    _require_int(controller.num_signals, 1, MAX_SIGNALS, "number of inputs and nodes")
    _require_int(len(controller.outputs), 1, MAX_OUTPUTS, "number of outputs")
    for i, entry in enumerate(controller.inputs):
        _require_int(entry.scale, *SCALE_RANGE, f"inputs[{i}].scale")
        _require_int(entry.limit, 1, SIGNAL_MAX, f"inputs[{i}].limit")
    for i, node in enumerate(controller.nodes):
        _validate_node(controller, i, node)
    for i, node in enumerate(controller.nodes):
        _validate_accumulator(controller, i, node)
    for i, output in enumerate(controller.outputs):
        if isinstance(output, Signal):
            _require_int(output.index, 0, controller.num_signals - 1, f"outputs[{i}].signal")
        else:
            _require_int(output.value, -SIGNAL_MAX, SIGNAL_MAX, f"outputs[{i}].constant")


def _validate_node(controller: Controller, index: int, node: Node) -> None:
    where = f"nodes[{index}]"
    if not isinstance(node.activation, str) or node.activation not in ACTIVATION_NAMES:
        known = ", ".join(ACTIVATION_NAMES)
        raise ControllerError(f"{where}.activation: {_shown(node.activation)} is not one of {known}")
    _require_elements(node.links, Link, f"{where}.links", "a link")
    _require_int(node.gain, *GAIN_RANGE, f"{where}.gain")
    _require_int(node.bias, -ACCUMULATOR_MAX, ACCUMULATOR_MAX, f"{where}.bias")
    first_not_earlier = len(controller.inputs) + index
    seen: set[tuple[int, int, int]] = set()
    for j, link in enumerate(node.links):
        here = f"{where}.links[{j}]"
        _require_int(link.delay, 0, 1, f"{here}.delay")
        _require_int(link.shift, *SHIFT_RANGE, f"{here}.shift")
        if link.sign not in (-1, 1) or type(link.sign) is not int:
            raise ControllerError(f"{here}.sign: {_shown(link.sign)} is not -1 or 1")
        if link.delay:
            _require_int(link.source, 0, controller.num_signals - 1, f"{here}.source")
        elif type(link.source) is not int or not 0 <= link.source < first_not_earlier:
            raise ControllerError(
                f"{here}.source: {_shown(link.source)} is not an input or an earlier node (0..{first_not_earlier - 1})"
            )
        key = (link.source, link.delay, link.shift)
        if key in seen:
            raise ControllerError(f"{here}: source {link.source} with this delay and shift is there already")
        seen.add(key)


def _validate_accumulator(controller: Controller, index: int, node: Node) -> None:
    total = abs(node.bias) + sum(controller.signal_limit(link.source) << link.shift for link in node.links)
    if total << max(node.gain, 0) > ACCUMULATOR_MAX:
        raise ControllerError(
            f"nodes[{index}]: its sum can reach {total} * 2^{max(node.gain, 0)}, beyond the accumulator's {ACCUMULATOR_MAX}"
        )
