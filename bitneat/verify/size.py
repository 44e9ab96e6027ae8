# SPDX-License-Identifier: MIT
"""Where a controller's bytes are: in the packed form part by part, and as compiled in each style on each target."""

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
from bitneat.verify.cfile import CFile
from bitneat.verify.check import TargetReport, controller_data
from bitneat.verify.machine import examine
from bitneat.verify.targets import ReadyTarget


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

    def to_data(self) -> dict[str, Any]:
        """The content of ``size --json``."""
        return {
            "controller": controller_data(self.controller),
            "packed": [bits.to_data() for bits in self.packed],
            "targets": [entry.to_data() for entry in self.compiled],
            "smallest": self.smallest,
        }


def device_of(entry: CompiledSize) -> str:
    """The target's name without a style: ``host-table`` is the device ``host``."""
    return entry.report.name.removesuffix(f"-{entry.report.style}")


def measure_sizes(champion: Champion, targets: Sequence[ReadyTarget]) -> SizeReport:
    """Generate both styles, compile them for every target, and measure.

    Raises:
        BitneatError: if the controller cannot be generated, or a compiler refuses it.
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
                    report = TargetReport(
                        name=ready.target.name,
                        compiler=ready.toolchain.compiler.title,
                        style=style,
                        steps_compared=None,
                        mismatches=None,
                        examination=examine(file, ready.toolchain),
                    )
                    compiled.append(CompiledSize(report, code.table_bytes, code.encoding))
    names = [ready.target.name for ready in targets]
    compiled.sort(key=lambda entry: names.index(entry.report.name))
    return SizeReport(champion.controller, tuple(packed_bits(champion.controller)), tuple(compiled))
