# SPDX-License-Identifier: MIT
"""The process that runs C under test, without the process: what it answers, and what it says of code that does not load."""

from __future__ import annotations

import io
import json
import resource
import signal
import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from bitneat.verify import child
from bitneat.verify.binary import Interface
from bitneat.verify.child import DECISIONS, READY, REQUEST, RESET, STEPS
from bitneat.verify.implementation import HostC
from tests.verify.champions import plain_champion, written

INTERFACE = Interface(
    "nowhere.so", "legs", "step", num_inputs=2, num_outputs=3, num_signals=0, num_state=1, has_decide=True
)


class Adder:
    """Three outputs of two inputs; remembers how often it was called since the last reset."""

    interface = INTERFACE

    def __init__(self) -> None:
        self.calls = 100

    def reset(self) -> None:
        self.calls = 0

    def step(self, inputs: bytes) -> bytes:
        x, y = struct.unpack("=hh", inputs)
        self.calls += 1
        return struct.pack("=hhh", x + y, x - y, self.calls)

    def decide(self, outputs: bytes) -> int:
        return max(struct.unpack("=hhh", outputs)) * 100_000


def answers(requests: bytes) -> bytes:
    out = io.BytesIO()
    child.serve(Adder(), 5, io.BytesIO(requests), out)  # type: ignore[arg-type]
    return out.getvalue()


def test_steps_are_answered_in_order_and_a_reset_forgets() -> None:
    steps = REQUEST.pack(STEPS, 2) + struct.pack("=hhhh", 5, 3, -1, 4)
    said = answers(steps + REQUEST.pack(RESET, 0) + steps)
    assert struct.unpack("=12h", said) == (8, 2, 101, 3, -5, 102, 8, 2, 1, 3, -5, 2)


def test_decisions_are_32_bit_numbers_of_rows_of_outputs() -> None:
    said = answers(REQUEST.pack(DECISIONS, 2) + struct.pack("=6h", 1, 2, 3, -7, -9, -8))
    assert struct.unpack("=2i", said) == (300_000, -700_000)


def test_the_end_of_requests_is_the_end() -> None:
    assert answers(b"") == b""
    assert answers(REQUEST.pack(RESET, 0)[:2]) == b""


def test_time_runs_only_while_code_under_test_does(monkeypatch: pytest.MonkeyPatch) -> None:
    left = []

    class Watched(Adder):
        def step(self, inputs: bytes) -> bytes:
            left.append(signal.getitimer(signal.ITIMER_REAL)[0])
            return super().step(inputs)

        def decide(self, outputs: bytes) -> int:
            left.append(signal.getitimer(signal.ITIMER_REAL)[0])
            return super().decide(outputs)

    monkeypatch.setattr(sys.modules[__name__], "Adder", Watched)
    answers(
        REQUEST.pack(STEPS, 1) + struct.pack("=hh", 1, 1) + REQUEST.pack(DECISIONS, 1) + struct.pack("=3h", 1, 2, 3)
    )
    assert signal.alarm(0) == 0
    assert len(left) == 2
    assert all(4 < seconds <= 5 for seconds in left)


def run_main(
    monkeypatch: pytest.MonkeyPatch, interface: Interface, requests: bytes
) -> tuple[bytes, dict[object, object]]:
    """What `main` writes, and what it asks of the operating system."""
    asked: dict[object, object] = {}
    out = io.BytesIO()
    monkeypatch.setattr(sys, "argv", ["child", json.dumps(interface.to_data()), "20"])
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(requests)))
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=out))
    monkeypatch.setattr(signal, "signal", asked.__setitem__)
    monkeypatch.setattr(resource, "setrlimit", asked.__setitem__)
    child.main()
    return out.getvalue(), asked


def test_what_does_not_load_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    said, _ = run_main(monkeypatch, INTERFACE, b"")
    assert said.startswith(b"cannot load library 'nowhere.so'")
    assert said.count(b"\n") == 1
    assert said.endswith(b"\n")


def test_what_loads_is_served_without_interrupts_or_core_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whose = plain_champion()
    with HostC(written(whose, tmp_path)) as host:
        interface = Interface(str(host.binary), "legs", "step", 3, 1, 0, None, has_decide=False)
    request = REQUEST.pack(STEPS, 1) + struct.pack("=hhh", 10, 3, 5)
    said, asked = run_main(monkeypatch, interface, request)
    expected = whose.controller.step([10, 3, 5])
    assert said == READY + struct.pack("=h", *expected)
    assert asked == {signal.SIGINT: signal.SIG_IGN, resource.RLIMIT_CORE: (0, 0)}
