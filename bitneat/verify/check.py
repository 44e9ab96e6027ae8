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
from bitneat.controller.packing import PackedFormatError, pack, unpack
from bitneat.errors import BitneatError
from bitneat.native.compiler import CompilerError
from bitneat.sim.environment import inspect
from bitneat.verify.cfile import CFile, CFileError
from bitneat.verify.implementation import HOST_FLAGS, ImplementationError
from bitneat.verify.loop import Comparison, Lane, LoopResult, Mismatch, Note, Progress, closed_loop
from bitneat.verify.machine import Examination, examine, loading_violations
from bitneat.verify.targets import ReadyTarget
from bitneat.verify.targets.emulated import EmulatedC
from bitneat.verify.timing import Timing, dependence, entry_timing, excess
from bitneat.verify.vectors import SEQUENCE, random_vectors
from bitneat.version import __version__

VECTORS = 2000
"""Random vectors from the whole declared domain that every implementation answers besides the loop, which sees a part of it."""
_VECTORS_SEED = 2
THOROUGH_VECTORS = 100_000
"""As many for ``--targets all``."""
TRACED = 10_000
"""How many of the vectors are traced at most, where code runs in an emulator."""
_AT_A_TIME = 2000
"""Vectors in one request, of a controller without state."""
BRIEF_TRACED = 500
"""The same on targets that nobody asked for by name."""

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
    loop_steps: int | None = None
    """How many of the steps compared were taken in the loop."""
    timing: Timing | None = None

    @property
    def stack(self) -> int | None:
        """As measured, else as the compiler says."""
        return self.examination.stack if self.timing is None else self.timing.stack

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
            "stack_bytes": self.stack,
            "instructions_per_step": None if self.timing is None else self.timing.instructions_per_step,
            "cycles_per_step": None if self.timing is None else self.timing.cycles,
            "loop_steps": self.loop_steps,
            "trace": None if self.timing is None else self.timing.to_data(),
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
    vectors: int = 0
    """How many vectors were tried besides the loop."""

    @property
    def passed(self) -> bool:
        """The verdict."""
        return not self.failures

    def to_data(self) -> dict[str, Any]:
        """The content of ``verify --json``."""
        data: dict[str, Any] = {
            "command": "verify",
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
    must be what codegen writes, ``vectors`` is how many random inputs are tried besides, ``record`` whether the report's
    episodes keep what the reference was asked and answered.
    """

    episodes: int = 5
    seed: int = 0
    environment: EnvironmentSpec | None = None
    max_steps: int | None = None
    compare_text: bool = True
    record: bool = False
    vectors: int = VECTORS

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
    note: Note | None = None,
) -> Report:
    """Check a generated C file against its champion.

    Args:
        champion: what the C claims to be.
        code: the file that is handed out. On targets that judge the other style too, that is generated for the purpose.
        targets: from `bitneat.verify.targets.select`.
        settings: how much to check.
        handed_out: False if ``code`` was made for this check alone.
        progress: told of each episode.
        note: told what is done before and after them.

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
        return _run(check, report, spec, targets, settings=settings, progress=progress, note=note or _ignore)
    except (CompilerError, CFileError) as error:
        if not check.failures:
            raise
        return replace(report, failures=(*check.failures, str(error)), warnings=tuple(check.warnings))


def _ignore(text: str) -> None:
    del text


@dataclass
class _Work:
    """One target and style, and what came of it."""

    ready: ReadyTarget
    code: CFile
    examination: Examination
    lanes: list[Lane] = field(default_factory=list)
    timing: Timing | None = None

    @property
    def where(self) -> str:
        """For messages."""
        name = self.ready.target.name
        return name if len(self.ready.target.styles) == 1 else f"{name} ({self.code.style})"

    def report(self) -> TargetReport:
        """What is to be said of it."""
        lanes = self.lanes
        return TargetReport(
            name=self.ready.target.name,
            compiler=self.ready.toolchain.compiler.title,
            style=self.code.style,
            # name_run takes fewer vectors, as name_step calls it.
            steps_compared=lanes[0].steps + lanes[0].vectors if lanes else None,
            mismatches=sum(lane.mismatches for lane in lanes) if lanes else None,
            examination=self.examination,
            loop_steps=min((lane.steps for lane in lanes), default=None),
            timing=self.timing,
        )


def _run(
    check: _Check,
    report: Report,
    spec: EnvironmentSpec,
    targets: Sequence[ReadyTarget],
    *,
    settings: Settings,
    progress: Progress | None,
    note: Note,
) -> Report:
    """Examine every object, and run those that are fit to be run."""
    champion, code = check.champion, check.code
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder, ExitStack() as stack:
        work = []
        for ready, one in check.pairs(targets, Path(folder)):
            note(f"compiling for {ready.target.name}, style {one.style}")
            work.append(_Work(ready, one, check.examine(ready, one)))
        for item in work:
            if item.examination.violations or not item.ready.runs or not check.fits(item):
                continue
            brief = not item.ready.asked and not item.ready.target.loads_on_host
            for implementation in item.ready.target.implementations(item.code, item.ready.toolchain):
                stack.callback(implementation.close)
                inner = settings.vectors if not item.lanes else max(settings.vectors // 10, VECTORS)
                item.lanes.append(Lane(implementation, max_vectors=inner, max_episodes=1 if brief else None))
        all_lanes = [lane for item in work for lane in item.lanes]
        if not any(item.lanes for item in work if item.code is code):
            # It would be no news that the rest of it works.
            return replace(
                report,
                failures=tuple(check.failures),
                warnings=tuple(check.warnings),
                targets=tuple(item.report() for item in work),
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
        vectors, sequence = domain_vectors(champion.controller, settings.vectors)
        comparison.vectors(vectors, sequence, lambda title: note(f"{len(vectors)} vectors on {title}"))
        for item in work:
            traced = vectors[: TRACED if item.ready.asked else BRIEF_TRACED]
            check.trace(item, traced, min(sequence, len(traced)), note)
    first = [lane.first for lane in all_lanes if lane.first is not None]
    check.failures = [*(str(mismatch) for mismatch in first), *check.failures]
    return replace(
        report,
        failures=tuple(check.failures),
        warnings=tuple(check.warnings),
        loop=loop,
        targets=tuple(item.report() for item in work),
        mismatch=first[0] if first else None,
        vectors=len(vectors),
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


def _is_packed(blob: bytes, controller: Controller) -> bool:
    """Whether a blob of any encoding unpacks to the controller."""
    try:
        return unpack(blob) == controller.canonical
    except PackedFormatError:
        return False


def generated_weights(champion: Champion, code: CFile) -> bytes | None:
    """The weight table, or the table of links, that codegen writes into a file of these options."""
    table = replace(code, source=code.regenerated(champion).source).table
    return None if table is None else table[0]


def require_run(code: CFile, targets: Sequence[ReadyTarget]) -> None:
    """Nothing can be said of a file that is not run, however well its other style does.

    Raises:
        BitneatError: if none of the targets runs it.
    """
    if not any(ready.runs and code.style in ready.target.styles for ready in targets):
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
        elif code.blob is not None and not _is_packed(code.blob, self.champion.controller):
            self.failures.append(f"{code.path.name}: its blob is not this controller, packed")
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
        if ready.target.loads_on_host:
            found = loading_violations(code, ready.toolchain.compiler, (*ready.toolchain.flags, *HOST_FLAGS))
            violations = dict.fromkeys((*examination.violations, *found))
            examination = replace(examination, violations=tuple(violations))
        where = ready.target.name if len(ready.target.styles) == 1 else f"{ready.target.name} ({code.style})"
        self.failures += [f"{where}: {violation}" for violation in examination.violations]
        return examination

    def fits(self, item: _Work) -> bool:
        """Whether the chip's memory holds it.

        Raises:
            BitneatError: if it does not, and the target was asked for.
        """
        wrong = excess(item.ready.target, item.code, item.examination.flash, item.examination.ram, item.report().stack)
        if wrong is None:
            return True
        if item.ready.asked:
            raise BitneatError(
                f"--targets {item.ready.target.name}: {item.code.path.name} (style {item.code.style}) {wrong}"
            )
        self.warnings.append(f"{item.where}: not run: {wrong}")
        return False

    def trace(self, item: _Work, vectors: npt.NDArray[np.int16], sequence: int, note: Note) -> None:
        """Look at every instruction that is executed, where an emulator can."""
        entries = {}
        for lane in item.lanes:
            emulated = lane.implementation
            if not isinstance(emulated, EmulatedC) or lane.lost:
                continue
            note(f"{len(vectors)} vectors traced on {emulated.title}")
            try:
                trace = emulated.trace(vectors, sequence)
            except ImplementationError as error:
                self.failures.append(f"{emulated.title}: when it was traced, it {error}")
                continue
            entries[emulated.image.entry] = entry_timing(item.ready.target, emulated.image, trace)
            self.failures += [f"{emulated.title}: {wrong}" for wrong in dependence(trace, vectors)]
        if "step" in entries:
            item.timing = Timing(entries, len(vectors))
            self.fits(item)


def domain_vectors(controller: Controller, count: int = VECTORS) -> tuple[npt.NDArray[np.int16], int]:
    """The vectors besides the loop, and how many of them follow each other from reset."""
    return random_vectors(controller, _VECTORS_SEED, count), SEQUENCE if controller.is_recurrent else _AT_A_TIME


def _first_differing_line(found: str, wanted: str) -> int:
    lines, others = found.splitlines(), wanted.splitlines()
    pairs = zip(lines, others, strict=False)
    return next((number for number, (a, b) in enumerate(pairs, 1) if a != b), min(len(lines), len(others)) + 1)
