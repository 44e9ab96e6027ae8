# SPDX-License-Identifier: MIT
"""From a sensor map and a controller to integer maps: one for each mapped input and output."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

from bitneat.codegen.sensor.affine import ExactMap, IntegerMap, NoFit, active, fit
from bitneat.codegen.sensor.read import ConstantInput, MappedInput, MappedOutput, SensorMap, SensorMapError, UnusedInput
from bitneat.controller import Action, BoxAction, Constant, Controller, DiscreteAction
from bitneat.controller.interval import Interval, intervals


@dataclass(frozen=True, slots=True)
class Channel:
    """One mapped input or output: its number, its name, and the map."""

    index: int
    name: str
    exact: ExactMap
    integer: IntegerMap
    takes: Interval | None = None
    """All values that can come in; None if that is whatever the type holds."""


@dataclass(frozen=True, slots=True)
class SensorPlan:
    """Everything that the C says: maps of inputs, inputs that are constants, maps of outputs."""

    inputs: tuple[Channel, ...]
    constants: tuple[tuple[int, int], ...]
    """(input, signal); unused inputs are 0."""
    outputs: tuple[Channel, ...]
    decides: bool
    """Whether the action is a choice, so that there are no outputs to map."""


def plan(controller: Controller, action: Action | None, sensor_map: SensorMap) -> SensorPlan:
    """Find the integer maps.

    Raises:
        SensorMapError: if an input that is read is called unused, a range is impossible, or a tolerance cannot be met.
    """
    canonical = controller.canonical
    read = {link.source for node in canonical.nodes for link in node.links}
    read |= {output.index for output in canonical.outputs if not isinstance(output, Constant)}
    inputs: list[Channel] = []
    constants: list[tuple[int, int]] = []
    for index, entry in enumerate(sensor_map.inputs):
        unit = Fraction(2) ** (canonical.frac_bits + canonical.inputs[index].scale)
        limit = canonical.inputs[index].limit
        match entry:
            case UnusedInput():
                if index in read:
                    raise SensorMapError(
                        f"{sensor_map.path}: unused_inputs: the controller reads input {index}; map it"
                    )
                constants.append((index, 0))
            case ConstantInput(value):
                # Fraction rounds ties to even, as the encoder does.
                constants.append((index, min(max(round(value * unit), -limit), limit)))
            case MappedInput():  # pragma: no branch - there is no other InputMap, as mypy checks
                exact = ExactMap(entry.scale * unit, entry.offset * unit, entry.counts, Interval(-limit, limit))
                where = f"{sensor_map.path}: input {index} ({entry.name})"
                inputs.append(Channel(index, entry.name, exact, _fit(exact, entry.tolerance, where, "signals")))
    decides = isinstance(action, DiscreteAction)
    reached = intervals(canonical).signals
    outputs = []
    for index, mapped in enumerate(sensor_map.outputs):
        where = f"{sensor_map.path}: output {index} ({mapped.name})"
        output = canonical.outputs[index]
        takes = Interval(output.value, output.value) if isinstance(output, Constant) else reached[output.index]
        exact = _output_map(canonical, action, index, mapped, where)
        integer = _fit(exact, mapped.tolerance, where, "counts")
        outputs.append(Channel(index, mapped.name, exact, integer, takes))
    return SensorPlan(tuple(inputs), tuple(constants), tuple(outputs), decides)


def _output_map(
    controller: Controller, action: Action | None, index: int, mapped: MappedOutput, where: str
) -> ExactMap:
    """Counts of a signal y: the action's value ``low + (clip(y / One, -1, 1) + 1) / 2 · (high - low)`` on the given line."""
    low, high = Fraction(-1), Fraction(1)
    if isinstance(action, BoxAction):
        low, high = Fraction(action.low[index]), Fraction(action.high[index])
    if low == high:
        raise SensorMapError(f"{where}: the action is always {float(low)}, there is nothing to map")
    one = controller.one
    value_slope, value_middle = (high - low) / 2 / one, (high + low) / 2
    count_slope = Fraction(mapped.counts[1] - mapped.counts[0]) / (mapped.values[1] - mapped.values[0])
    return ExactMap(
        slope=count_slope * value_slope,
        intercept=mapped.counts[0] + count_slope * (value_middle - mapped.values[0]),
        domain=Interval(-one, one),
        image=Interval(min(mapped.counts), max(mapped.counts)),
    )


def _fit(exact: ExactMap, tolerance: Fraction, where: str, unit: str) -> IntegerMap:
    moving = active(exact)
    if moving is None:
        ends = sorted(float(exact.real(x)) for x in exact.domain)
        raise SensorMapError(
            f"{where}: impossible range: it gives {ends[0]:.6g} to {ends[1]:.6g} {unit},"
            f" all at or beyond the limits {exact.image.low} and {exact.image.high}"
        )
    found = fit(exact, tolerance)
    if isinstance(found, NoFit):
        # Most of a wide range may be clipped: the sums then fit if counts are clipped to where the map moves.
        found = fit(replace(exact, domain=moving), tolerance)
    if not isinstance(found, NoFit):
        return found
    if found.nearest is None:
        raise SensorMapError(f"{where}: too steep for 32 bits: {float(abs(exact.slope)):.6g} {unit} for a step of one")
    raise SensorMapError(
        f"{where}: no integer map is within the tolerance {float(tolerance):.6g} {unit};"
        f" the nearest is within {float(found.nearest):.6g}"
    )
