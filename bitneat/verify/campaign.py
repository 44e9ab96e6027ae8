# SPDX-License-Identifier: MIT
"""Judging planted faults: one by a whole verify, many by a replay of the episodes.

Replaying what the reference was asked and answered is the same as running the loop again: the simulator never sees the outputs
of the code under test.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from bitneat.champion import Champion
from bitneat.controller import Reference
from bitneat.native.compiler import Compiler, CompilerError
from bitneat.verify.cfile import CFile, CFileError
from bitneat.verify.check import (
    Report,
    Settings,
    domain_vectors,
    environment_of,
    generated_weights,
    require_run,
    table_fault,
    verify,
)
from bitneat.verify.faults import Fault, choose, plant
from bitneat.verify.implementation import HostC, ImplementationError, entries
from bitneat.verify.loop import Episode, Progress
from bitneat.verify.targets import ReadyTarget
from bitneat.verify.vectors import SEQUENCE, random_vectors

MORE_VECTORS = 100_000
"""Random vectors that tell a fault which changes nothing from one that verify's inputs did not reach."""
_BATCH = 10_000
_VECTORS_SEED = 1

Int16Rows = npt.NDArray[np.int16]


def verify_fault(
    champion: Champion,
    code: CFile,
    number: int,
    targets: Sequence[ReadyTarget],
    settings: Settings,
    *,
    progress: Progress | None = None,
) -> tuple[Fault, Report]:
    """Verify a copy of a file with one fault in it. That its text differs does not count, only what follows from it."""
    require_run(code, targets)
    fault = choose(code, number)
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        faulty = plant(code, fault, Path(folder))
        try:
            report = verify(champion, faulty, targets, replace(settings, compare_text=False), progress=progress)
        except (CompilerError, CFileError) as error:
            spec = environment_of(champion, settings)
            report = Report(champion.controller, faulty, True, spec.id, failures=(str(error),))
        return fault, replace(report, code=replace(faulty, path=code.path, header_path=code.header_path))


def run_campaign(
    champion: Champion, code: CFile, episodes: Sequence[Episode], compiler: Compiler, count: int
) -> Iterator[FaultResult]:
    """Judge the faults 0 .. count-1, one after the other; the arguments are those of `Campaign`."""
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        campaign = Campaign(champion, code, episodes, compiler, Path(folder))
        for number in range(count):
            yield campaign.judge(number)


Outcome = Literal["loop", "vectors", "crash", "table", "compile", "equivalent", "unreached"]


@dataclass(frozen=True, slots=True)
class FaultResult:
    """What became of one fault.

    ``outcome`` is what gave it away first: the compiler, a difference in the loop or on the vectors besides, a crash or hang, or
    the table, which no longer held the controller. What survives is ``unreached`` if other inputs do show it, and then
    ``counterexample`` is one (with state, the last of a sequence from reset), and else ``equivalent`` as far as can be seen.
    """

    number: int
    fault: Fault
    outcome: Outcome
    detail: str
    counterexample: tuple[int, ...] | None = None

    @property
    def caught(self) -> bool:
        """Whether verify fails on it."""
        return self.outcome not in ("equivalent", "unreached")

    def to_data(self) -> dict[str, Any]:
        """Plain data for reports."""
        return {
            "number": self.number,
            "fault": self.fault.to_data(),
            "outcome": self.outcome,
            "detail": self.detail,
            "counterexample": None if self.counterexample is None else list(self.counterexample),
        }


class Campaign:
    """Judges faults in one file by the episodes that its original went through.

    Args:
        champion: whose C it is.
        code: the file, which has passed.
        episodes: of the loop, with their inputs and outputs recorded.
        compiler: the host's.
        folder: for the copies.
    """

    def __init__(
        self, champion: Champion, code: CFile, episodes: Sequence[Episode], compiler: Compiler, folder: Path
    ) -> None:
        self._controller = champion.controller
        self._action = champion.action
        self._code = code
        self._episodes = episodes
        self._compiler = compiler
        self._folder = folder
        self._weights = generated_weights(champion, code)

    def judge(self, number: int) -> FaultResult:
        """Plant fault ``number`` and see what notices."""
        fault = choose(self._code, number)
        faulty = plant(self._code, fault, self._folder)
        with ExitStack() as stack:
            implementations = []
            try:
                for entry in entries(faulty):
                    implementation = stack.enter_context(HostC(faulty, entry, compiler=self._compiler))
                    stack.callback(implementation.binary.unlink, missing_ok=True)
                    implementations.append(implementation)
            except (CompilerError, CFileError) as error:
                return FaultResult(number, fault, "compile", str(error))
            outcomes: tuple[tuple[Outcome, Sequence[_Batch]], ...] = (("loop", self._loop), ("vectors", self._vectors))
            try:
                for outcome, batches in outcomes:
                    seen = self._difference(implementations, batches)
                    if seen is not None:
                        return FaultResult(number, fault, outcome, seen.text)
            except ImplementationError as error:
                return FaultResult(number, fault, "crash", str(error))
            wrong = table_fault(faulty, self._weights)
            if wrong is not None:
                return FaultResult(number, fault, "table", wrong)
            return self._survivor(number, fault, implementations)

    def _survivor(self, number: int, fault: Fault, implementations: Sequence[HostC]) -> FaultResult:
        """Tell a fault that changes nothing from one that was not reached."""
        try:
            seen = self._difference(implementations, self._more_vectors)
        except ImplementationError as error:
            return FaultResult(number, fault, "unreached", f"not reached by these inputs: on others it {error}")
        if seen is None:
            detail = f"no difference on {MORE_VECTORS} random vectors: equivalent or unreachable"
            return FaultResult(number, fault, "equivalent", detail)
        return FaultResult(number, fault, "unreached", "not reached by these inputs: it takes others", seen.inputs)

    def _difference(self, implementations: Sequence[HostC], batches: Sequence[_Batch]) -> _Difference | None:
        """The first one of any implementation."""
        for implementation in implementations:
            for batch in batches:
                implementation.reset()
                seen = batch.compare(implementation.run(batch.inputs), batch.outputs, "output")
                if seen is None and self._code.has_decide:
                    # Judged by themselves, so that a wrong output is not a wrong decision, too.
                    seen = batch.compare(implementation.decisions(batch.outputs), batch.decisions, "decision")
                if seen is not None:
                    return seen
        return None

    @cached_property
    def _loop(self) -> list[_Batch]:
        """What the episodes asked."""
        batches = []
        for index, episode in enumerate(self._episodes):
            assert episode.inputs is not None
            assert episode.outputs is not None
            where = f"episode {index} (seed {episode.seed}), step"
            batches.append(self._batch(where, 0, episode.inputs, episode.outputs))
        return batches

    @cached_property
    def _vectors(self) -> list[_Batch]:
        """What verify asks besides."""
        reference = Reference(self._controller)
        return [
            self._batch("vector", start, rows, np.array(reference.run(rows.tolist()), dtype=np.int16))
            for start, rows in _sequences(*domain_vectors(self._controller))
        ]

    @cached_property
    def _more_vectors(self) -> list[_Batch]:
        """More than verify asks; answered by the file without a fault, which is fast and has passed."""
        vectors = random_vectors(self._controller, _VECTORS_SEED, MORE_VECTORS)
        with HostC(self._code, compiler=self._compiler) as original:
            batches = []
            for start, rows in _sequences(vectors, SEQUENCE if self._controller.is_recurrent else _BATCH):
                original.reset()
                batches.append(self._batch("vector", start, rows, original.run(rows)))
        return batches

    def _batch(self, where: str, start: int, inputs: Int16Rows, outputs: Int16Rows) -> _Batch:
        decisions = None
        if self._code.has_decide:
            choices = [self._action.decode(row, self._controller.frac_bits) for row in outputs]
            decisions = np.array(choices, dtype=np.int32).reshape(-1, 1)
        return _Batch(where, start, inputs, outputs, decisions)


@dataclass(frozen=True, slots=True)
class _Difference:
    text: str
    inputs: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Batch:
    """Successive steps from reset, and what the controller answers."""

    where: str
    start: int
    inputs: Int16Rows
    outputs: Int16Rows
    decisions: npt.NDArray[np.int32] | None

    def compare(self, got: npt.NDArray[Any], expected: npt.NDArray[Any] | None, what: str) -> _Difference | None:
        wrong = np.argwhere(got != expected)
        if not len(wrong):
            return None
        assert expected is not None
        row, column = (int(i) for i in wrong[0])
        which = f"output {column}" if what == "output" else "the decision"
        text = f"{self.where} {self.start + row}: {which} is {got[row, column]}, expected {expected[row, column]}"
        return _Difference(text, tuple(int(x) for x in self.inputs[row]))


def _sequences(rows: Int16Rows, length: int) -> list[tuple[int, Int16Rows]]:
    return [(start, rows[start : start + length]) for start in range(0, len(rows), length)]
