# SPDX-License-Identifier: MIT
"""The page's tables as rows of text; what comes from a file may be anything, and is shown as far as it can be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from bitneat.report.page.charts import number
from bitneat.verify.size import PackedBits, SizeReport, device_of

MAX_ROWS = 80
MAX_TEXT = 200
NONE = "–"


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the packed blob: where its bar begins and how wide it is, of 1000."""

    name: str
    bits: int
    start: float
    width: float


def byte_parts(packed: PackedBits) -> list[Part]:
    """Where the bits of a blob go."""
    fields = (
        ("header", packed.header),
        ("topology", packed.topology),
        ("weights", packed.weights),
        ("activations, gains, biases", packed.fields),
    )
    parts, start = [], 0.0
    for name, bits in fields:
        width = round(1000 * bits / (8 * packed.num_bytes), 2)
        parts.append(Part(name, bits, round(start, 2), width))
        start += width
    return parts


def size_rows(sizes: SizeReport) -> list[tuple[str, ...]]:
    """Target, style, flash, RAM, stack, instructions, cycles, compiler."""
    rows = []
    for entry in sizes.compiled:
        report = entry.report
        instructions = None if report.timing is None else report.timing.step.instructions[1]
        cycles = None if report.timing is None else report.timing.cycles
        figures = (report.examination.flash, report.examination.ram, report.stack, instructions, cycles)
        rows.append((device_of(entry), report.style, *map(shown, figures), report.compiler))
    return rows


def encoding_rows(sizes: SizeReport) -> list[tuple[str, ...]]:
    """Encoding, bytes, and the bits of header, topology, weights, fields."""
    return [
        (one.encoding, *map(shown, (one.num_bytes, one.header, one.topology, one.weights, one.fields)))
        for one in sizes.packed
    ]


def verify_facts(verification: Mapping[str, Any], code_sha256: str) -> str:
    """How much was compared, in a line; and of which file, if not of the C with this SHA-256."""
    reward = verification.get("reward")
    mean = f", mean reward {shown(reward.get('mean'))}" if isinstance(reward, Mapping) else ""
    episodes = verification.get("episodes")
    verified = verification.get("c_sha256")
    other = (
        "" if verified == code_sha256 else f"; of another C file than the one below (SHA-256 {shown(verified)[:12]})"
    )
    return (
        f"{shown(episodes)} episode{'' if episodes == 1 else 's'} of {shown(verification.get('environment'))}, "
        f"{shown(verification.get('steps'))} steps{mean}{other}"
    )


def verify_failures(verification: Mapping[str, Any]) -> list[str]:
    """What did not hold."""
    failures = verification.get("failures")
    return [shown(failure) for failure in failures[:5]] if isinstance(failures, list) else []


def verify_rows(verification: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Target, style, steps compared, differing outputs, whether what it executes depends on data."""
    rows = []
    targets = verification.get("targets")
    for entry in targets if isinstance(targets, list) else []:
        if not isinstance(entry, Mapping):
            continue
        trace = entry.get("trace")
        independent = trace.get("data_independent") if isinstance(trace, Mapping) else NONE
        words = {True: "the same for every input", None: "the same count", False: "DEPENDS ON DATA"}
        timing = words.get(independent, NONE) if independent is None or isinstance(independent, bool) else NONE
        rows.append((*(shown(entry.get(key)) for key in ("name", "style", "steps_compared", "mismatches")), timing))
    return rows[:MAX_ROWS]


def flat_rows(data: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The values of nested plain data, each with the path to it."""
    rows: list[tuple[str, str]] = []
    for row in _flat("", data):
        if len(rows) == MAX_ROWS:
            rows.append(("…", "more in the file"))
            break
        rows.append(row)
    return rows


def _flat(path: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(f"{path}.{key}" if path else str(key), item)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _flat(f"{path}[{index}]", item)
    else:
        yield path, shown(value)


def provenance_rows(provenance: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The entries that are short enough for a table; the rest is below it."""
    rows = []
    for key, value in provenance.items():
        if isinstance(value, Mapping):
            if all(not isinstance(item, (Mapping, list)) for item in value.values()):
                rows.append((str(key), ", ".join(f"{name} {plain(item)}" for name, item in value.items())))
        elif not isinstance(value, list) and len(str(value)) <= MAX_TEXT:
            rows.append((str(key), plain(value)))
    return rows[:MAX_ROWS]


def plain(value: Any) -> str:
    """As `shown`, but an integer without commas: it may be a seed."""
    return str(value)[:MAX_TEXT] if type(value) is int else shown(value)


def shown(value: Any) -> str:
    """A value as a cell of a table."""
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) < 2**31 else f"{value}"[:MAX_TEXT]
    if isinstance(value, float):
        return number(value)
    return str(value)[:MAX_TEXT]
