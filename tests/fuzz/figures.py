# SPDX-License-Identifier: MIT
"""How far each fuzzer is, and what was reached: notes in build/fuzz while it runs, `figures.json` here when it is done."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from bitneat.files import write_json
from tests.fuzz.target import WORK

FIGURES = Path(__file__).with_name("figures.json")


@dataclass
class Totals:
    """What the batches 0 .. ``batches`` - 1 of a fuzzer did."""

    batches: int = 0
    count: int = 0
    also: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0


def resumed(name: str) -> Totals:
    """The totals where the fuzzer stopped; zeros where it never ran."""
    path = _notes(name)
    return Totals(**json.loads(path.read_text())) if path.exists() else Totals()


def note(name: str, totals: Totals) -> None:
    """Remember the totals, so that the fuzzer can be stopped at any moment."""
    WORK.mkdir(parents=True, exist_ok=True)
    write_json(_notes(name), asdict(totals))


def forget(name: str) -> None:
    """Start from the first batch again."""
    _notes(name).unlink(missing_ok=True)


def _notes(name: str) -> Path:
    return WORK / f"{name}.json"


def committed() -> dict[str, dict[str, object]]:
    """The figures of `figures.json`, by fuzzer."""
    figures: dict[str, dict[str, object]] = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    return figures


def record(name: str, figure: dict[str, object]) -> None:
    """Write a fuzzer's figure into `figures.json`."""
    write_json(FIGURES, dict(sorted({**committed(), name: figure}.items())))


def table(figures: dict[str, dict[str, object]]) -> str:
    """The figures as the Markdown table of docs/verification.md."""
    lines = [
        "| `python -m tests.fuzz` | what | cases | under | findings left | processor time |",
        "|---|---|---|---|---|---|",
    ]
    for figure in figures.values():
        command = str(figure["command"]).removeprefix("python -m tests.fuzz ").removesuffix(" --record")
        also = figure["also"]
        assert isinstance(also, dict)
        cases = "; ".join(f"{value:,} {unit}" for unit, value in {figure["unit"]: figure["count"], **also}.items())
        seconds = figure["seconds"]
        assert isinstance(seconds, int)
        spent = f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"
        lines.append(
            f"| `{command}` | {figure['what']} | {cases} | {figure['under']} | {figure['findings']} | {spent} |"
        )
    return "\n".join(lines) + "\n"
