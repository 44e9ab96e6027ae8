# SPDX-License-Identifier: MIT
"""The whole of verify: the file's claims, its text and table, its object code, and the closed loop on every target."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import Champion, EnvironmentSpec
from bitneat.codegen import Style
from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.native.compiler import CompilerError
from bitneat.sim.environment import inspect
from bitneat.verify.cfile import CFile, CFileError
from bitneat.verify.implementation import HOST_FLAGS
from bitneat.verify.loop import Comparison, Lane, LoopResult, Mismatch, Progress, closed_loop
from bitneat.verify.machine import Examination, examine, loading_violations
from bitneat.verify.targets import ReadyTarget
from bitneat.verify.vectors import SEQUENCE, random_vectors
from bitneat.version import __version__

VECTORS = 2000
"""Random vectors from the whole declared domain that every implementation answers besides the loop, which sees a part of it."""
_VECTORS_SEED = 2

HARDCORE = EnvironmentSpec("BipedalWalkerHardcore-v3")


@dataclass(frozen=True, slots=True)
class TargetReport:
    """One target and style: what was compared, and what the object takes."""

    name: str
    compiler: str
    style: Style
    steps_compared: int | None
    mismatches: int | None
    examination: Examination

    def to_data(self) -> dict[str, Any]:
        """The entry of ``targets`` in the report; None where nothing was measured."""
        return {
            "name": self.name,
            "compiler": self.compiler,
            "style": self.style,
            "steps_compared": self.steps_compared,
            "mismatches": self.mismatches,
            "flash_bytes": self.examination.flash,
            "ram_bytes": self.examination.ram,
            "stack_bytes": self.examination.stack,
            "instructions_per_step": None,
            "cycles_per_step": None,
        }


@dataclass(frozen=True)
class Report:
    """The verdict and all that it rests on. It passes iff there is no failure."""

    controller: Controller
    code: CFile
    handed_out: bool
    """False if the C was generated for this check alone, as there was none."""
    environment_id: str
    failures: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    loop: LoopResult | None = None
    targets: tuple[TargetReport, ...] = ()
    mismatch: Mismatch | None = None

    @property
    def passed(self) -> bool:
        """The verdict."""
        return not self.failures

    def to_data(self) -> dict[str, Any]:
        """The content of ``verify --json``."""
        data: dict[str, Any] = {
            "verdict": "pass" if self.passed else "fail",
            "controller": controller_data(self.controller),
            "c_file": str(self.code.path) if self.handed_out else None,
            "c_sha256": self.code.content_sha256,
            "environment": self.environment_id,
            "episodes": 0,
            "steps": 0,
            "reward": None,
            "inputs": [],
            "saturated_outputs": None,
            "targets": [target.to_data() for target in self.targets],
        }
        if self.loop is not None:
            rewards = np.array([episode.reward for episode in self.loop.episodes])
            data |= {
                "episodes": len(rewards),
                "steps": self.loop.steps,
                "reward": {
                    "mean": float(rewards.mean()),
                    "std": float(rewards.std()),
                    "min": float(rewards.min()),
                    "max": float(rewards.max()),
                },
                "inputs": [
                    {"min": _finite(entry.min), "max": _finite(entry.max), "clipped": entry.clipped}
                    for entry in self.loop.inputs
                ],
                "saturated_outputs": self.loop.saturated_outputs,
            }
        if not self.passed:
            data["mismatch"] = None if self.mismatch is None else self.mismatch.to_data()
            data["failures"] = list(self.failures)
        return data


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def controller_data(controller: Controller) -> dict[str, Any]:
    """The entry ``controller`` of reports; all of it is of the canonical form."""
    canonical = controller.canonical
    return {
        "sha256": controller.sha256,
        "ternary": canonical.is_ternary,
        "nodes": len(canonical.nodes),
        "links": canonical.num_links,
        "packed_bytes": len(pack(canonical)),
        "paper_bytes": paper_bytes(canonical),
    }


def paper_bytes(controller: Controller) -> int:
    """The Bit-Pedal Walker paper's own figure: 1.5 bits a link. It leaves out which nodes the links connect."""
    return math.ceil(controller.num_links * 1.5 / 8)


@dataclass(frozen=True)
class Settings:
    """How much is checked.

    ``environment`` stands in for the champion's own; ``max_steps`` cuts episodes short. ``compare_text`` says whether a file
    must be what codegen writes, ``record`` whether the report's episodes keep what the reference was asked
    and answered.
    """

    episodes: int = 5
    seed: int = 0
    environment: EnvironmentSpec | None = None
    max_steps: int | None = None
    compare_text: bool = True
    record: bool = False

    @property
    def seeds(self) -> range:
        """A seed for each episode."""
        return range(self.seed, self.seed + self.episodes)


def environment_of(champion: Champion, settings: Settings) -> EnvironmentSpec:
    """Where the loop runs.

    Raises:
        BitneatError: if there is none, or it does not fit the champion's inputs and action.
    """
    spec = settings.environment or champion.environment
    if spec is None:
        raise BitneatError("champion: names no environment, so there is no loop to verify it in")
    info = inspect(spec)
    if info.num_inputs != len(champion.controller.inputs):
        raise BitneatError(
            f"environment {spec.id}: has {info.num_inputs} observations, the controller {len(champion.controller.inputs)}"
        )
    if info.action != champion.action:
        raise BitneatError(f"environment {spec.id}: its action space is not the champion's")
    return spec


def verify(
    champion: Champion,
    code: CFile,
    targets: Sequence[ReadyTarget],
    settings: Settings | None = None,
    *,
    handed_out: bool = True,
    progress: Progress | None = None,
) -> Report:
    """Check a generated C file against its champion.

    Args:
        champion: what the C claims to be.
        code: the file that is handed out. On targets that judge the other style too, that is generated for the purpose.
        targets: from `bitneat.verify.targets.select`.
        settings: how much to check.
        handed_out: False if ``code`` was made for this check alone.
        progress: told of each episode.

    Raises:
        BitneatError: if the file cannot be compiled although nobody edited it, none of the targets runs it, or the
            environment cannot be used.
    """
    settings = settings or Settings()
    spec = environment_of(champion, settings)
    report = Report(champion.controller, code, handed_out, spec.id, failures=())
    stale = stale_claims(champion, code)
    if stale:
        return replace(report, failures=tuple(stale))
    require_run(code, targets)
    wrong = _wrong_shape(champion, code)
    if wrong is not None:
        return replace(report, failures=(wrong,))
    check = _Check(champion, code)
    check.text(compare=settings.compare_text)
    try:
        return _run(check, report, spec, targets, settings=settings, progress=progress)
    except (CompilerError, CFileError) as error:
        if not check.failures:
            raise
        return replace(report, failures=(*check.failures, str(error)), warnings=tuple(check.warnings))


def _run(
    check: _Check,
    report: Report,
    spec: EnvironmentSpec,
    targets: Sequence[ReadyTarget],
    *,
    settings: Settings,
    progress: Progress | None,
) -> Report:
    """Examine every object, and run those that are fit to be loaded."""
    champion, code = check.champion, check.code
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder, ExitStack() as stack:
        examined = [(ready, one, check.examine(ready, one)) for ready, one in check.pairs(targets, Path(folder))]
        work = []
        for ready, one, examination in examined:
            lanes: list[Lane] = []
            work.append((ready, one, examination, lanes))
            if examination.violations or not ready.target.runs:
                continue
            for implementation in ready.target.implementations(one, ready.toolchain):
                stack.callback(implementation.close)
                lanes.append(Lane(implementation))
        all_lanes = [lane for *_, lanes in work for lane in lanes]
        if not any(lanes for _, one, _, lanes in work if one is code):
            # It would be no news that the rest of it works.
            return replace(
                report,
                failures=tuple(check.failures),
                warnings=tuple(check.warnings),
                targets=tuple(_target_report(ready, one, examination, ()) for ready, one, examination, _ in work),
            )
        comparison = Comparison(champion.controller, champion.action, all_lanes)
        loop = closed_loop(
            comparison,
            spec,
            settings.seeds,
            max_steps=settings.max_steps,
            record=settings.record,
            progress=progress,
        )
        comparison.vectors(*domain_vectors(champion.controller))
    first = [lane.first for lane in all_lanes if lane.first is not None]
    check.failures = [*(str(mismatch) for mismatch in first), *check.failures]
    return replace(
        report,
        failures=tuple(check.failures),
        warnings=tuple(check.warnings),
        loop=loop,
        targets=tuple(_target_report(*entry) for entry in work),
        mismatch=first[0] if first else None,
    )


def stale_claims(champion: Champion, code: CFile) -> list[str]:
    """What is wrong with the fingerprints in the opening comments of source and header."""
    sha256 = champion.controller.sha256
    return [
        f"{path}: stale: generated for controller {claimed[:12]}, not {sha256[:12]}; generate it again"
        for path, claimed in ((code.path, code.sha256), (code.header_path, code.header_sha256 or "unknown"))
        if claimed != sha256
    ]


def table_fault(code: CFile, weights: bytes | None) -> str | None:
    """What is wrong with the table in a file.

    It must be ``weights``, the one that codegen writes: a fault in a bit that is not read would not show in any output.
    """
    where = code.path.name
    table = None if code.table is None else code.table[0]
    what = "weight table" if code.style == "unrolled" else "table of links"
    return None if table == weights else f"{where}: its {what} is not the one that codegen writes"


def generated_weights(champion: Champion, code: CFile) -> bytes | None:
    """The weight table, or the table of links, that codegen writes into a file of these options."""
    table = replace(code, source=code.regenerated(champion).source).table
    return None if table is None else table[0]


def require_run(code: CFile, targets: Sequence[ReadyTarget]) -> None:
    """Nothing can be said of a file that is not run, however well its other style does.

    Raises:
        BitneatError: if none of the targets runs it.
    """
    if not any(ready.target.runs and code.style in ready.target.styles for ready in targets):
        raise BitneatError(
            f"--targets: no target of these runs {code.path} (style {code.style}); add host-{code.style}"
        )


def _wrong_shape(champion: Champion, code: CFile) -> str | None:
    controller = champion.controller
    expected = (len(controller.inputs), len(controller.outputs), controller.frac_bits)
    found = (code.num_inputs, code.num_outputs, code.frac_bits)
    if found != expected:
        return (
            f"{code.header_path}: edited: says {found[0]} inputs, {found[1]} outputs, {found[2]} fractional bits; the"
            f" controller has {expected[0]}, {expected[1]}, {expected[2]}"
        )
    return None


@dataclass
class _Check:
    """Collects what is found on the way."""

    champion: Champion
    code: CFile
    failures: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def text(self, *, compare: bool) -> None:
        """Judge the table, and compare the text with what codegen writes."""
        code = self.code
        same_version = code.version == __version__
        # Another version may order the weights or lay out the table differently; then the loop alone judges them.
        if same_version:
            wrong = table_fault(code, generated_weights(self.champion, code))
            self.failures += [] if wrong is None else [wrong]
        if not compare:
            return
        if not same_version:
            self.warnings.append(
                f"{code.path}: written by bitneat {code.version}, this is {__version__}: only its behaviour is judged"
            )
            return
        expected = code.regenerated(self.champion)
        for path, found, wanted in (
            (code.path, code.source, expected.source),
            (code.header_path, code.header, expected.header),
        ):
            if found != wanted:
                line = _first_differing_line(found, wanted)
                self.failures.append(f"{path}: edited: line {line} is not what codegen writes for this controller")

    def pairs(self, targets: Sequence[ReadyTarget], folder: Path) -> list[tuple[ReadyTarget, CFile]]:
        """Each target with each of its styles: the file itself in its own style, generated in the other."""
        files: dict[Style, CFile] = {self.code.style: self.code}
        pairs = []
        for ready in targets:
            for style in ready.target.styles:
                if style not in files:
                    other = self.code.regenerated(self.champion, style)
                    files[style] = CFile.write(other, folder, self.code.path.stem)
                pairs.append((ready, files[style]))
        return pairs

    def examine(self, ready: ReadyTarget, code: CFile) -> Examination:
        """Look at the object, before anything of it is run."""
        examination = examine(code, ready.toolchain)
        if ready.target.runs:
            found = loading_violations(code, ready.toolchain.compiler, (*ready.toolchain.flags, *HOST_FLAGS))
            violations = dict.fromkeys((*examination.violations, *found))
            examination = replace(examination, violations=tuple(violations))
        where = ready.target.name if len(ready.target.styles) == 1 else f"{ready.target.name} ({code.style})"
        self.failures += [f"{where}: {violation}" for violation in examination.violations]
        return examination


def _target_report(ready: ReadyTarget, code: CFile, examination: Examination, lanes: Sequence[Lane]) -> TargetReport:
    return TargetReport(
        name=ready.target.name,
        compiler=ready.toolchain.compiler.title,
        style=code.style,
        steps_compared=min((lane.steps for lane in lanes), default=None),
        mismatches=sum(lane.mismatches for lane in lanes) if lanes else None,
        examination=examination,
    )


def domain_vectors(controller: Controller) -> tuple[npt.NDArray[np.int16], int]:
    """The vectors besides the loop, and how many of them follow each other from reset."""
    return random_vectors(controller, _VECTORS_SEED, VECTORS), SEQUENCE if controller.is_recurrent else VECTORS


def _first_differing_line(found: str, wanted: str) -> int:
    lines, others = found.splitlines(), wanted.splitlines()
    pairs = zip(lines, others, strict=False)
    return next((number for number, (a, b) in enumerate(pairs, 1) if a != b), min(len(lines), len(others)) + 1)
