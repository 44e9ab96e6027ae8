# SPDX-License-Identifier: MIT
"""What an interrupted search leaves, and says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from bitneat.cli.main import main
from bitneat.evolve.evaluation import GymnasiumEvaluator

NOTHING_KEPT = "stopped before the first generation was complete; nothing is kept: the same command begins again"


def check_interrupted(
    command: str, arguments: Sequence[str], run: Path, generations: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Interrupt a run after so many generations, and again while it closes; then let it go on as it says.

    Args:
        command: that makes the run.
        arguments: of a new run, but for ``--generations``, ``--workers`` and ``-o``.
        run: a folder that is not there yet.
        generations: that are complete, 0 or 1.
        capsys: of the test.
    """

    def interrupt(self: object, *arguments: object) -> None:
        raise KeyboardInterrupt

    start = [command, *arguments, "--workers", "1", "-o", str(run)]
    expected = NOTHING_KEPT
    if generations:
        assert main([*start, "--generations", "1"]) == 0
        start = [command, "--resume", str(run), "--workers", "1"]
        expected = f"stopped; continue with: bitneat {command} --resume {run}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GymnasiumEvaluator, "evaluate", interrupt)
        patch.setattr(GymnasiumEvaluator, "close", interrupt)
        assert main([*start, "--generations", "2"]) == 130
    assert capsys.readouterr().err.splitlines()[-1] == f"bitneat: {expected}"
    assert main([*start, "--generations", "1"]) == 0
