# SPDX-License-Identifier: MIT
"""Where a controller's bytes are, packed and compiled in each style on each target, and what a step takes there."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bitneat.champion import Champion
from bitneat.codegen import STYLES, Style, generate
from bitneat.controller import Controller
from bitneat.controller.packing import ENCODINGS, Layout, PackedFormatError, pack_blob
from bitneat.errors import BitneatError
from bitneat.verify.cfile import CFile
from bitneat.verify.check import TargetReport, controller_data
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.machine import Examination, examine
from bitneat.verify.targets import ReadyTarget
from bitneat.verify.targets.chip import Chip
from bitneat.verify.timing import Timing, entry_timing, excess
from bitneat.verify.vectors import random_vectors

_STEPS = 8
"""How many steps are counted: the addresses executed are those of any others, which verify shows for thousands."""
_SEED = 2


@dataclass(frozen=True, slots=True)
class PackedBits:
    """The bits of one blob.

    ``weights`` are the signs, and the shifts where there are any; ``fields`` the activations, gains and general biases of the
    nodes; ``topology`` is what says where links come from and where lists end, with the padding to whole bytes; the header has
    the counts, scales, limits and outputs. A ternary bias is a link.
    """

    encoding: str
    num_bytes: int
    header: int
    topology: int
    weights: int
    fields: int

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {
            "encoding": self.encoding,
            "bytes": self.num_bytes,
            "bits": {
                "header": self.header,
                "topology": self.topology,
                "weights": self.weights,
                "fields": self.fields,
            },
        }


def packed_bits(controller: Controller) -> list[PackedBits]:
    """Every encoding that can express the controller, the smallest first."""
    layout = Layout(controller.canonical)
    num_links = sum(len(links) for links in layout.node_links)
    weights = num_links * (4 if layout.has_shifts else 1)
    results = []
    for encoding in ENCODINGS:
        try:
            blob = pack_blob(controller, encoding)
        except PackedFormatError:
            continue  # dense encodings have no shifts
        header = 8 * blob.body_offset
        topology = 8 * len(blob.data) - header - blob.field_bits - weights
        results.append(PackedBits(encoding, len(blob.data), header, topology, weights, blob.field_bits))
    return sorted(results, key=lambda bits: bits.num_bytes)


@dataclass(frozen=True, slots=True)
class CompiledSize:
    """One style on one target; ``table_bytes`` are those of its weight table or blob."""

    report: TargetReport
    table_bytes: int
    encoding: str | None

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {**self.report.to_data(), "table_bytes": self.table_bytes, "encoding": self.encoding}


@dataclass(frozen=True)
class SizeReport:
    """All sizes of one controller."""

    controller: Controller
    packed: tuple[PackedBits, ...]
    compiled: tuple[CompiledSize, ...]

    @property
    def smallest(self) -> dict[str, Style]:
        """For each device the style that takes less flash; the host is one device."""
        best: dict[str, CompiledSize] = {}
        for entry in self.compiled:
            device = device_of(entry)
            if device not in best or entry.report.examination.flash < best[device].report.examination.flash:
                best[device] = entry
        return {device: entry.report.style for device, entry in best.items()}

    @property
    def fastest(self) -> dict[str, Style]:
        """For each device on which every style was counted the one that takes less: cycles, else instructions."""
        devices: dict[str, list[CompiledSize]] = {}
        for entry in self.compiled:
            devices.setdefault(device_of(entry), []).append(entry)
        best: dict[str, Style] = {}
        for device, entries in devices.items():
            timings = {entry.report.style: entry.report.timing for entry in entries}
            known = {style: timing for style, timing in timings.items() if timing is not None}
            if len(known) < len(STYLES):
                continue
            cycles = {style: timing.cycles for style, timing in known.items() if timing.cycles is not None}
            counts = cycles if len(cycles) == len(known) else {s: one.step.instructions[1] for s, one in known.items()}
            best[device] = min(counts, key=counts.__getitem__)
        return best

    def to_data(self) -> dict[str, Any]:
        """The content of ``size --json``."""
        return {
            "controller": controller_data(self.controller),
            "packed": [bits.to_data() for bits in self.packed],
            "targets": [entry.to_data() for entry in self.compiled],
            "smallest": self.smallest,
            "fastest": self.fastest,
        }


def device_of(entry: CompiledSize) -> str:
    """The target's name without a style: ``host-table`` is the device ``host``."""
    return entry.report.name.removesuffix(f"-{entry.report.style}")


def measure_sizes(champion: Champion, targets: Sequence[ReadyTarget], *, speed: bool = False) -> SizeReport:
    """Generate both styles, compile them for every target, and measure.

    Args:
        champion: whose controller.
        targets: from `bitneat.verify.targets.select`.
        speed: whether to count the instructions of some steps too, where an emulator is there.

    Raises:
        BitneatError: if the controller cannot be generated, a compiler refuses it, or its code crashes.
    """
    compiled = []
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        for style in STYLES:
            code = generate(
                champion.controller,
                "controller",
                style,
                action=champion.action,
                environment_id=champion.environment.id if champion.environment else "",
                header_name=f"{style}.h",
            )
            file = CFile.write(code, Path(folder), style)
            for ready in targets:
                if style in ready.target.styles:
                    examination = examine(file, ready.toolchain)
                    report = TargetReport(
                        name=ready.target.name,
                        compiler=ready.toolchain.compiler.title,
                        style=style,
                        steps_compared=None,
                        mismatches=None,
                        examination=examination,
                        timing=_count(champion.controller, file, ready, examination) if speed else None,
                    )
                    compiled.append(CompiledSize(report, code.table_bytes, code.encoding))
    names = [ready.target.name for ready in targets]
    compiled.sort(key=lambda entry: names.index(entry.report.name))
    return SizeReport(champion.controller, tuple(packed_bits(champion.controller)), tuple(compiled))


def _count(controller: Controller, code: CFile, ready: ReadyTarget, examination: Examination) -> Timing | None:
    """What ``name_step`` takes; None without an emulator, or of code that is not fit to be run there."""
    target = ready.target
    if not isinstance(target, Chip) or target.missing_to_run() is not None or examination.violations:
        return None
    if excess(target, code, examination.flash, examination.ram, examination.stack) is not None:
        return None
    emulated = target.implementation(code, ready.toolchain, "step")
    try:
        trace = emulated.trace(random_vectors(controller, _SEED, _STEPS), _STEPS)
    except ImplementationError as error:
        raise BitneatError(f"{emulated.title}: {error}") from error
    finally:
        emulated.close()
    return Timing({"step": entry_timing(target, emulated.image, trace)}, _STEPS)
