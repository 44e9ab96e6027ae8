# SPDX-License-Identifier: MIT
"""Reading a sensor map: a TOML file that says what counts mean. `docs/sensor-maps.md` is its schema."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

from bitneat.codegen.names import CNameError, check_member_name
from bitneat.controller.interval import Interval
from bitneat.errors import BitneatError
from bitneat.files import read_capped

MAX_FILE_BYTES = 1 << 20
MAX_LINE_LENGTH = 1 << 14
"""Characters: the time that tomllib takes for a dotted key goes with the square of its length."""
MAX_COUNT = 2**24
MAX_EXPONENT = 30
"""Physical values are 0, or at least 10^-30 and less than 10^31: more is a slip, and would only take time."""

DEFAULT_TOLERANCE = Fraction(1)


class SensorMapError(BitneatError):
    """A sensor map cannot be used: the message names the file, the key and what was expected."""


@dataclass(frozen=True, slots=True)
class MappedInput:
    """An input that a sensor gives: ``value = scale · count + offset``, in the observation's unit."""

    name: str
    counts: Interval
    scale: Fraction
    offset: Fraction
    tolerance: Fraction


@dataclass(frozen=True, slots=True)
class ConstantInput:
    """An input that is always the same value."""

    value: Fraction


@dataclass(frozen=True, slots=True)
class UnusedInput:
    """An input that the controller does not read."""


@dataclass(frozen=True, slots=True)
class MappedOutput:
    """An output that drives an actuator: the first of ``values`` is the first of ``counts``, the second the second."""

    name: str
    values: tuple[Fraction, Fraction]
    counts: tuple[int, int]
    tolerance: Fraction


InputMap = MappedInput | ConstantInput | UnusedInput


@dataclass(frozen=True, slots=True)
class SensorMap:
    """A map file as read: an entry for each input and each output, in their order. ``path`` is for messages."""

    path: str
    inputs: tuple[InputMap, ...]
    outputs: tuple[MappedOutput, ...]


def read_sensor_map(path: Path, num_inputs: int, num_outputs: int) -> SensorMap:
    """Read a map file for a controller of so many inputs; ``num_outputs`` is 0 where it chooses among actions.

    Raises:
        SensorMapError: in one line, with the file, the key and what was expected.
    """
    try:
        text = read_capped(path, MAX_FILE_BYTES).decode()
        if max(map(len, text.splitlines()), default=0) > MAX_LINE_LENGTH:
            raise SensorMapError(f"{path}: a line has more than {MAX_LINE_LENGTH} characters")
        data = tomllib.loads(text, parse_float=Decimal)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SensorMapError(f"{path}: not TOML: {' '.join(str(error).split())}") from None
    except ValueError as error:  # an integer of too many digits
        raise SensorMapError(f"{path}: {' '.join(str(error).split())}") from None
    return _Reader(path).read(data, num_inputs, num_outputs)


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, key: str, expected: str) -> SensorMapError:
        return SensorMapError(f"{self.path}: {key}: {expected}")

    def read(self, data: Mapping[str, Any], num_inputs: int, num_outputs: int) -> SensorMap:
        self.check_keys(data, "the file", {"inputs"} if num_inputs else set(), {"outputs", "unused_inputs"})
        inputs: dict[int, InputMap] = {}
        for position, index in enumerate(self.list_of(data.get("unused_inputs", []), "unused_inputs")):
            inputs[self.index(index, f"unused_inputs[{position}]", num_inputs, inputs)] = UnusedInput()
        for position, entry in enumerate(self.tables(data.get("inputs", []), "inputs")):
            key = f"inputs[{position}]"
            index = self.index(self.required(entry, key, "input"), f"{key}.input", num_inputs, inputs)
            inputs[index] = self.input(entry, key, index)
        outputs: dict[int, MappedOutput] = {}
        if num_outputs == 0 and "outputs" in data:
            raise self.fail("outputs", "the controller chooses among actions, so there is no output to map; remove it")
        for position, entry in enumerate(self.tables(data.get("outputs", []), "outputs")):
            key = f"outputs[{position}]"
            index = self.index(self.required(entry, key, "output"), f"{key}.output", num_outputs, outputs)
            outputs[index] = self.output(entry, key, index)
        for index in range(num_inputs):
            if index not in inputs:
                raise self.fail("inputs", f"nothing maps input {index}; add [[inputs]] with input = {index}")
        for index in range(num_outputs):
            if index not in outputs:
                raise self.fail("outputs", f"nothing maps output {index}; add [[outputs]] with output = {index}")
        self.check_names([entry.name for entry in inputs.values() if isinstance(entry, MappedInput)], "inputs")
        self.check_names([entry.name for entry in outputs.values()], "outputs")
        return SensorMap(
            str(self.path),
            tuple(inputs[index] for index in range(num_inputs)),
            tuple(outputs[index] for index in range(num_outputs)),
        )

    def input(self, entry: Mapping[str, Any], key: str, index: int) -> InputMap:
        if "constant" in entry:
            self.check_keys(entry, key, {"input", "constant"}, {"name"})
            if "name" in entry:
                self.name(entry, key, "")
            return ConstantInput(self.number(entry["constant"], f"{key}.constant"))
        if "points" in entry:
            self.check_keys(entry, key, {"input", "counts", "points"}, {"name", "tolerance"})
            scale, offset = self.line(entry["points"], f"{key}.points")
        else:
            self.check_keys(entry, key, {"input", "counts", "scale", "offset"}, {"name", "tolerance"})
            scale = self.number(entry["scale"], f"{key}.scale")
            offset = self.number(entry["offset"], f"{key}.offset")
            if scale == 0:
                raise self.fail(f"{key}.scale", "expected a number other than 0 (or constant = VALUE)")
        low, high = self.pair(entry["counts"], f"{key}.counts")
        if low >= high:
            raise self.fail(f"{key}.counts", f"expected [lowest, highest], got [{low}, {high}]")
        return MappedInput(
            self.name(entry, key, f"input_{index}"), Interval(low, high), scale, offset, self.tolerance(entry, key)
        )

    def output(self, entry: Mapping[str, Any], key: str, index: int) -> MappedOutput:
        self.check_keys(entry, key, {"output", "values", "counts"}, {"name", "tolerance"})
        values = self.list_of(entry["values"], f"{key}.values")
        if len(values) != 2:
            raise self.fail(f"{key}.values", "expected two numbers, the lower first")
        first, second = (self.number(value, f"{key}.values[{i}]") for i, value in enumerate(values))
        if first >= second:
            raise self.fail(f"{key}.values", "expected two numbers, the lower first")
        counts = self.pair(entry["counts"], f"{key}.counts")
        if counts[0] == counts[1]:
            raise self.fail(f"{key}.counts", "expected two different counts")
        return MappedOutput(
            self.name(entry, key, f"output_{index}"), (first, second), counts, self.tolerance(entry, key)
        )

    def line(self, points: object, key: str) -> tuple[Fraction, Fraction]:
        """Scale and offset of the straight line through two points ``[count, value]``."""
        expected = "expected two points [count, value] at different counts with different values"
        pairs = [self.list_of(point, f"{key}[{i}]") for i, point in enumerate(self.list_of(points, key))]
        if len(pairs) != 2 or any(len(pair) != 2 for pair in pairs):
            raise self.fail(key, expected)
        (c0, v0), (c1, v1) = (
            (self.number(pair[0], f"{key}[{i}][0]"), self.number(pair[1], f"{key}[{i}][1]"))
            for i, pair in enumerate(pairs)
        )
        if c0 == c1 or v0 == v1:
            raise self.fail(key, expected)
        scale = (v1 - v0) / (c1 - c0)
        return scale, v0 - scale * c0

    def check_keys(self, entry: Mapping[str, Any], where: str, required: set[str], optional: set[str]) -> None:
        known = ", ".join(sorted(required | optional))
        for key in entry:
            if key not in required | optional:
                shown = key if len(key) <= 40 and key.isprintable() else repr(key[:40])
                raise self.fail(where, f"unknown key {shown}; expected {known}")
        for key in sorted(required):
            if key not in entry:
                raise self.fail(where, f"{key} is missing; expected {known}")

    def required(self, entry: Mapping[str, Any], where: str, key: str) -> Any:
        if key not in entry:
            raise self.fail(where, f"{key} is missing; expected the number of one, from 0")
        return entry[key]

    def tables(self, value: object, key: str) -> Sequence[Mapping[str, Any]]:
        if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
            raise self.fail(key, f"expected tables, each under [[{key}]]")
        return value

    def list_of(self, value: object, key: str) -> Sequence[Any]:
        if not isinstance(value, list):
            raise self.fail(key, "expected a list")
        return value

    def index(self, value: object, key: str, count: int, taken: Mapping[int, object]) -> int:
        if type(value) is not int or not 0 <= value < count:
            raise self.fail(key, f"expected a whole number in 0..{count - 1}")
        if value in taken:
            raise self.fail(key, f"{value} was given before")
        return value

    def number(self, value: object, key: str) -> Fraction:
        if type(value) is int and abs(value) < 10 ** (MAX_EXPONENT + 1):
            return Fraction(value)
        if isinstance(value, Decimal) and value.is_finite():
            if value.is_zero():
                return Fraction(0)
            # The exponent is looked at first: a fraction of 10^999999999 would never end.
            if abs(value.adjusted()) <= MAX_EXPONENT and len(value.as_tuple().digits) <= 2 * MAX_EXPONENT:
                return Fraction(value)
        raise self.fail(key, f"expected a finite number, 0 or 1e-{MAX_EXPONENT} to 1e{MAX_EXPONENT} in magnitude")

    def pair(self, value: object, key: str) -> tuple[int, int]:
        counts = self.list_of(value, key)
        if len(counts) != 2 or not all(type(count) is int and abs(count) <= MAX_COUNT for count in counts):
            raise self.fail(key, f"expected two whole numbers in -{MAX_COUNT}..{MAX_COUNT}")
        return counts[0], counts[1]

    def tolerance(self, entry: Mapping[str, Any], key: str) -> Fraction:
        if "tolerance" not in entry:
            return DEFAULT_TOLERANCE
        tolerance = self.number(entry["tolerance"], f"{key}.tolerance")
        if tolerance <= Fraction(1, 2):
            raise self.fail(f"{key}.tolerance", "expected more than 0.5, which rounding to an integer costs already")
        return tolerance

    def name(self, entry: Mapping[str, Any], key: str, default: str) -> str:
        name = entry.get("name", default)
        if not isinstance(name, str):
            raise self.fail(f"{key}.name", "expected a string")
        try:
            return check_member_name(name, f"{self.path}: {key}.name") if name != default else default
        except CNameError as error:
            raise SensorMapError(str(error)) from None

    def check_names(self, names: Sequence[str], key: str) -> None:
        for name in names:
            if names.count(name) > 1:
                raise self.fail(key, f"two are named {name}")
