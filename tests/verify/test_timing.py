# SPDX-License-Identifier: MIT
"""What is said of a trace, and of what fits into a chip, for traces and chips of known numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bitneat.verify.cfile import CFile
from bitneat.verify.targets.tracing import Trace
from bitneat.verify.timing import EntryTiming, Timing, dependence, entry_timing, excess
from tests.verify.champions import champion, written

VECTORS = np.array([[1, 2], [3, 4], [5, 6]], np.int16)


def words(*values: int) -> Any:
    return np.array(values, np.uint64)


SAME = Trace(words(1, 1, 1), words(2, 2, 2), words(9, 9, 9), words(11, 11, 11), (4, 6, 8), 12)
TARGET: Any = SimpleNamespace(
    cycles_source="a table", cycles=lambda code, start, path: 100 * len(code) + start + sum(path)
)
IMAGE: Any = SimpleNamespace(controller=b"xyz", code_range=range(1000, 1003))


def test_what_is_the_same_in_every_step_depends_on_nothing() -> None:
    assert dependence(SAME, VECTORS) == []
    assert dependence(replace(SAME, cycles=None), VECTORS) == []


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({"code": words(1, 1, 7)}, ["the addresses executed depend on the inputs: with (5, 6) it is otherwise than"]),
        (
            {"code": words(1, 7, 1), "addresses": False},
            ["the number of instructions executed depends on the inputs: with (3, 4) it is otherwise than"],
        ),
        (
            {"data": words(2, 5, 2)},
            ["the addresses read and written depend on the inputs: with (3, 4) it is otherwise"],
        ),
        (
            {"code": words(1, 1, 7), "data": words(2, 5, 2)},
            ["the addresses executed depend on the inputs: with (3, 4)", "the addresses read and written depend"],
        ),
        ({"cycles": words(11, 12, 11)}, ["the cycles depend on the inputs, although the addresses do not"]),
        ({"cycles": words(11, 12, 11), "code": words(1, 1, 7)}, ["the addresses executed depend"]),
    ],
)
def test_what_differs_is_said_with_the_first_input_that_shows_it(changed: dict[str, Any], found: list[str]) -> None:
    said = dependence(replace(SAME, **changed), VECTORS)
    assert len(said) == len(found)
    assert all(text.startswith(start) for text, start in zip(said, found, strict=True))


def test_cycles_are_those_measured_or_those_of_the_path_where_a_source_is_named() -> None:
    assert entry_timing(TARGET, IMAGE, SAME).cycles == 11
    assert entry_timing(TARGET, IMAGE, replace(SAME, cycles=None)).cycles == 300 + 1000 + 18
    assert entry_timing(TARGET, IMAGE, replace(SAME, cycles=words(11, 12, 11))).cycles is None
    assert entry_timing(TARGET, IMAGE, replace(SAME, code=words(1, 1, 7))).cycles is None
    silent: Any = SimpleNamespace(cycles_source=None)
    assert entry_timing(silent, IMAGE, SAME).cycles is None


def test_an_entry_holds_what_the_trace_showed() -> None:
    found = entry_timing(TARGET, IMAGE, replace(SAME, instructions=words(9, 7, 12), data=words(2, 2, 3)))
    assert found == EntryTiming((7, 12), 11, 12, True, False, f"{1:016x}{2:016x}", "a table", True)
    assert found.claim == "depends on data"
    assert found.to_data() == {
        "instructions_per_step": {"min": 7, "max": 12},
        "cycles_per_step": 11,
        "stack_bytes": 12,
        "same_addresses": True,
        "same_data_addresses": False,
        "fingerprint": found.fingerprint,
        "timing": "depends on data",
    }


@pytest.mark.parametrize(
    ("changed", "claim", "independent"),
    [
        ({}, "WCET = BCET = 11 cycles (a table)", True),
        ({"cycles": None}, "data-independent trace", True),
        ({"addresses": False}, "the same number of instructions in every step", None),
        ({"same_code": False}, "depends on data", False),
        ({"same_data": False, "addresses": False}, "depends on data", False),
    ],
)
def test_no_more_is_claimed_than_was_compared(changed: dict[str, Any], claim: str, independent: bool | None) -> None:
    step = entry_timing(TARGET, IMAGE, SAME)
    run = replace(step, **changed)
    assert run.claim == claim
    assert Timing({"step": step, "run": run}, 3).data_independent is independent
    if not run.addresses:
        assert {run.to_data()[key] for key in ("same_addresses", "same_data_addresses", "fingerprint")} == {None}


def test_a_timing_is_that_of_the_step() -> None:
    step = replace(entry_timing(TARGET, IMAGE, SAME), instructions=(7, 12))
    timing = Timing({"run": replace(step, cycles=1, stack=2, instructions=(3, 4)), "step": step}, 3)
    assert (timing.cycles, timing.stack, timing.instructions_per_step) == (11, 12, {"min": 7, "max": 12})
    assert timing.to_data()["inputs"] == 3
    assert set(timing.to_data()["entries"]) == {"step", "run"}


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> CFile:
    """Three inputs, one output, and as many signals on the stack as it has."""
    code = written(champion(seed=1), tmp_path_factory.mktemp("c"), "table")
    assert (code.num_inputs, code.num_outputs) == (3, 1)
    assert code.num_signals is not None
    return code


def chip(flash: int | None = None, ram: int | None = None) -> Any:
    return SimpleNamespace(flash=flash, ram=ram, chip="tiny chip")


def test_flash_is_full_when_the_last_byte_is_taken(table: CFile) -> None:
    assert excess(chip(flash=500), table, 500, 10**6, None) is None
    assert excess(chip(flash=500), table, 501, 0, 0) == "needs 501 bytes of flash, the tiny chip has 500"
    assert excess(chip(), table, 10**9, 10**9, 10**9) is None


def test_ram_is_state_arrays_of_the_caller_and_the_stack_as_far_as_it_is_known(table: CFile) -> None:
    arrays = 2 * 3 + 2 * 1
    assert excess(chip(ram=20 + arrays + 30), table, 0, 20, 30) is None
    assert (
        excess(chip(ram=20 + arrays + 29), table, 0, 20, 30)
        == "needs 58 bytes of RAM (state 20, inputs and outputs 8, stack 30), the tiny chip has 57"
    )
    signals = 2 * (table.num_signals or 0)
    assert excess(chip(ram=20 + arrays + signals), table, 0, 20, None) is None
    assert f"stack {signals})" in str(excess(chip(ram=20 + arrays + signals - 1), table, 0, 20, None))


def test_the_unrolled_style_has_no_signals_in_memory(tmp_path: Path) -> None:
    code = written(champion(seed=1), tmp_path)
    assert excess(chip(ram=28), code, 0, 20, None) is None
    assert "stack 0)" in str(excess(chip(ram=27), code, 0, 20, None))
