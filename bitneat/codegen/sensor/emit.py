# SPDX-License-Identifier: MIT
"""The text of ``name_sensors.h``, ``name_sensors.c`` and ``name_sensors_selftest.c``."""

from __future__ import annotations

import random
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

from bitneat.codegen.generate import GeneratedC
from bitneat.codegen.sensor.affine import ExactMap, IntegerMap, active
from bitneat.codegen.sensor.plan import Channel, SensorPlan
from bitneat.codegen.templating import environment
from bitneat.controller import Controller
from bitneat.controller.interval import Interval
from bitneat.version import __version__

SELFTEST_STEPS = 32
SELFTEST_SEED = 2

_TYPES = {
    "uint16_t": Interval(0, 65535),
    "int16_t": Interval(-32768, 32767),
    "int32_t": Interval(-(2**31), 2**31 - 1),
}
"""Types of struct members with their ranges, the first that holds a channel's counts is taken."""


@dataclass(frozen=True, slots=True)
class Member:
    """A member of a struct of counts."""

    type: str
    name: str
    counts: Interval
    meaning: str
    """What it stands for, for a comment."""

    @property
    def example(self) -> int:
        """A count that can be, for an example."""
        return self.counts.low


@dataclass(frozen=True, slots=True)
class SensorFiles:
    """The text of the three files, and the members of the structs of counts."""

    header: str
    source: str
    selftest: str
    inputs: tuple[Member, ...]
    outputs: tuple[Member, ...]


@dataclass(frozen=True, slots=True)
class Statement:
    """One map as C: the argument q, the sum's start and what is added to it or subtracted, and the result."""

    comment: str
    argument: str
    start: str
    terms: tuple[str, ...]
    target: str
    value: str


class _Emitter:
    """Collects the helper functions that the expressions call."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.helpers: set[str] = set()

    def call(self, helper: str, *arguments: str) -> str:
        self.helpers.add(helper)
        return f"{self.prefix}_{helper}({', '.join(arguments)})"

    def clamp(self, x: str, values: Interval, limits: Interval) -> str:
        """``x`` clipped, given that it is in ``values``; only the sides that can be exceeded."""
        if values.low < limits.low:
            # By subtraction where the difference keeps its sign in 32 bits.
            helper = (
                "at_least" if limits.low - values.low < 2**31 and values.high - limits.low < 2**31 else "at_least_any"
            )
            x = self.call(helper, x, _word(limits.low))
        if values.high > limits.high:
            helper = (
                "at_most" if values.high - limits.high < 2**31 and limits.high - values.low < 2**31 else "at_most_any"
            )
            x = self.call(helper, x, _word(limits.high))
        return x

    def statement(
        self, channel: Channel, *, source: str, source_range: Interval, target: str, target_type: str, unit: str
    ) -> Statement:
        integer = channel.integer
        argument = self.clamp(source, source_range, integer.domain)
        low = integer.domain.low
        if low:
            argument = f"{argument} {'-' if low > 0 else '+'} UINT32_C({abs(low)})"
        if integer.pre:
            argument = f"({argument}) >> {integer.pre}"
        value = "sum"
        if integer.post:
            value = self.call("floor_shift", value, str(integer.post))
        value = self.clamp(value, integer.unclipped, integer.image)
        return Statement(
            comment=f"{channel.name}: {formula(integer)}, within {bound(integer.error)} {unit}",
            argument=argument,
            start=_word(integer.bias),
            terms=tuple(self.term(integer, i) for i in range(len(integer.terms))),
            target=target,
            value=self.converted(value, target_type),
        )

    def term(self, integer: IntegerMap, index: int) -> str:
        """``+= q << shift``, hidden from a compiler that would make a multiplication of several of them."""
        term = integer.terms[index]
        shifted = f"q << {term.shift}" if term.shift else "q"
        if term.shift and (len(integer.terms) > 1 or term.sign < 0):
            shifted = self.call("opaque", shifted)
        return f"{'+' if term.sign > 0 else '-'}= {shifted}"

    def converted(self, value: str, target_type: str) -> str:
        if target_type == "int16_t":
            return self.call("signal", value)
        if target_type == "uint16_t":
            return f"(uint16_t)({value})"
        return self.call("wide", value)


def formula(integer: IntegerMap) -> str:
    """A map as text: ``floor((8 q - 1 q + 1234) / 2^9) where q = floor((x - 100) / 2^1)``."""
    low, parts = integer.domain.low, []
    for term in integer.terms:
        parts.append(f"{'+' if term.sign > 0 else '-'} {1 << term.shift} q")
    parts.append(f"{'-' if integer.bias < 0 else '+'} {abs(integer.bias)}")
    text = " ".join(parts).removeprefix("+ ")
    q = "x" if low == 0 else f"x {'-' if low > 0 else '+'} {abs(low)}"
    if integer.pre:
        q = f"floor(({q}) / 2^{integer.pre})" if low else f"floor({q} / 2^{integer.pre})"
    return f"floor(({text}) / 2^{integer.post}), q = {q}"


def bound(error: Fraction) -> str:
    """An error bound with four decimals, rounded up."""
    return f"{ceil(error * 10000) / 10000:.4f}"


def sensor_files(code: GeneratedC, controller: Controller, sensors: SensorPlan) -> SensorFiles:
    """The files of a plan for generated code, which they include by its header's name."""
    emitter = _Emitter(f"{code.name}_sensors")
    inputs = tuple(_member(c, c.exact.domain, "signals") for c in sensors.inputs)
    outputs = tuple(_member(c, c.integer.image, "counts") for c in sensors.outputs)
    reads = [
        emitter.statement(
            channel,
            source=f"(uint32_t){'(int32_t)' if member.type == 'int16_t' else ''}sensors->{member.name}",
            source_range=_TYPES[member.type],
            target=f"observation[{channel.index}]",
            target_type="int16_t",
            unit="signals",
        )
        for channel, member in zip(sensors.inputs, inputs, strict=True)
    ]
    writes = [
        emitter.statement(
            channel,
            source=f"(uint32_t)(int32_t)action[{channel.index}]",
            source_range=channel.takes or _TYPES["int16_t"],
            target=f"actuators->{member.name}",
            target_type=member.type,
            unit="counts",
        )
        for channel, member in zip(sensors.outputs, outputs, strict=True)
    ]
    if emitter.helpers & {"at_least", "at_most", "at_least_any", "at_most_any"}:
        emitter.helpers.add("mask")
    names = {
        "name": code.name,
        "macro": code.name.upper(),
        "stem": code.header_name.removesuffix(".h"),
        "version": __version__,
        "sha256": controller.sha256,
        "has_state": controller.canonical.is_recurrent,
        "decides": sensors.decides,
        "inputs": inputs,
        "outputs": outputs,
        "constants": sensors.constants,
    }
    template = environment().get_template
    header = template("sensor/sensors.h.j2").render(names)
    source = template("sensor/sensors.c.j2").render(names, reads=reads, writes=writes, helpers=emitter.helpers)
    return SensorFiles(header, source, _selftest(names, sensors), inputs, outputs)


def _member(channel: Channel, counts: Interval, unit: str) -> Member:
    chosen = next(name for name, held in _TYPES.items() if held.low <= counts.low and counts.high <= held.high)
    number = f"{'observation' if unit == 'signals' else 'action'}[{channel.index}]"
    meaning = f"{counts.low}..{counts.high}; {number}, within {bound(channel.integer.error)} {unit}"
    return Member(chosen, channel.name, counts, meaning)


def _selftest(names: dict[str, object], sensors: SensorPlan) -> str:
    rng = random.Random(SELFTEST_SEED)
    steps = range(SELFTEST_STEPS)
    counts = [_arguments([(c.exact.domain, c.exact) for c in sensors.inputs], step, rng) for step in steps]
    signals = [_arguments([(c.takes or c.exact.domain, c.exact) for c in sensors.outputs], step, rng) for step in steps]
    constants = dict(sensors.constants)
    width = len(sensors.inputs) + len(constants)
    observations = []
    for row in counts:
        known = constants | {c.index: c.integer(x) for c, x in zip(sensors.inputs, row, strict=True)}
        observations.append([known[index] for index in range(width)])
    commands = [[c.integer(y) for c, y in zip(sensors.outputs, row, strict=True)] for row in signals]
    return (
        environment()
        .get_template("sensor/selftest.c.j2")
        .render(
            names,
            steps=SELFTEST_STEPS,
            counts=_rows(counts),
            observations=_rows(observations),
            signals=_rows(signals),
            commands=_rows(commands),
        )
    )


def _arguments(channels: list[tuple[Interval, ExactMap]], step: int, rng: random.Random) -> list[int]:
    """One row of arguments: all lowest, all highest, then random ones, every second where the map moves."""
    if step < 2:
        return [whole[step] for whole, _ in channels]
    row = []
    for whole, exact in channels:
        moving = active(exact) or whole
        inside = Interval(max(whole.low, moving.low), min(whole.high, moving.high))
        row.append(rng.randint(*(inside if step % 2 and inside.low <= inside.high else whole)))
    return row


def _rows(table: list[list[int]]) -> list[str]:
    return [", ".join(map(str, row)) for row in table]


def _word(value: int) -> str:
    """An integer as a C expression of type uint32_t, in two's complement."""
    return f"UINT32_C({value})" if value >= 0 else f"(UINT32_C(0) - UINT32_C({-value}))"
