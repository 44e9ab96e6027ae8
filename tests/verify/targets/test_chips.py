# SPDX-License-Identifier: MIT
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from bitneat.champion import Champion, load
from bitneat.cli.main import main
from bitneat.codegen import STYLES, Style
from bitneat.controller import Controller, Reference
from bitneat.errors import BitneatError
from bitneat.verify.cfile import CFile
from bitneat.verify.check import Settings, verify
from bitneat.verify.implementation import ImplementationError, entries
from bitneat.verify.loop import Comparison, Lane
from bitneat.verify.machine import OBJECT_FLAGS, examine
from bitneat.verify.targets import TARGETS, chip, select
from bitneat.verify.targets.chips import CHIPS
from bitneat.verify.targets.emulated import EmulatedC
from bitneat.verify.vectors import random_vectors
from tests.verify.champions import champion, plain_champion, written
from tests.verify.targets.chips import BY_NAME, emulated, ready

CHIP_NAMES = [one.name for one in CHIPS]
STEPS = 40
CHAMPIONS = Path(__file__).parents[3] / "examples" / "champions"


def answers(controller: Controller, inputs: np.ndarray) -> np.ndarray:
    return np.array(Reference(controller).run(inputs.tolist()))


@dataclass(frozen=True)
class Built:
    """One champion's C, linked and loaded once for all tests of a chip and style."""

    name: str
    code: CFile
    whose: Champion
    step: EmulatedC
    inputs: np.ndarray
    expected: np.ndarray


@pytest.fixture(scope="module", params=list(product(CHIP_NAMES, STYLES)), ids=lambda param: f"{param[0]}-{param[1]}")
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Built]:
    name, style = request.param
    whose = champion(seed=3, recurrent=True)
    code = written(whose, tmp_path_factory.mktemp(name), style)
    inputs = random_vectors(whose.controller, 1, STEPS)
    one = emulated(name, code)
    yield Built(name, code, whose, one, inputs, answers(whose.controller, inputs))
    one.close()


def test_a_chip_computes_what_the_reference_computes(built: Built) -> None:
    for entry in entries(built.code):
        one = built.step if entry == "step" else emulated(built.name, built.code, entry)
        one.reset()
        assert (one.run(built.inputs) == built.expected).all()
        one.reset()
        assert [one.step(row).tolist() for row in built.inputs[:5]] == built.expected[:5].tolist()


@pytest.mark.parametrize("name", CHIP_NAMES)
def test_a_chip_chooses_as_the_action_space_says(name: str, tmp_path: Path) -> None:
    whose = champion("CartPole-v1", seed=2)
    outputs = np.array([[1, 2], [2, 1], [-5, -5], [32767, -32767]], dtype=np.int16)
    one = emulated(name, written(whose, tmp_path))
    expected = [whose.action.decode(row, 8) for row in outputs]
    assert one.decisions(outputs)[:, 0].tolist() == expected
    assert one.decide(outputs[0]) == expected[0]
    (ready,) = select([name])
    for style in STYLES:  # of two actions, the choice is so short that compilers see a skip in it
        assert examine(written(whose, tmp_path, style, stem=style), ready.toolchain).violations == ()


def test_one_instruction_that_a_compiler_got_wrong_is_caught(built: Built) -> None:
    faults = built.step.faults(built.inputs)
    assert len(faults) >= 3
    tried = faults[:: max(len(faults) // 4, 1)]
    lanes = [Lane(faulty) for _, faulty in tried]
    comparison = Comparison(built.whose.controller, built.whose.action, [Lane(built.step), *lanes])
    comparison.vectors(built.inputs, STEPS)
    assert comparison.lanes[0].mismatches == 0
    missed = [what for (what, _), lane in zip(tried, lanes, strict=True) if lane.first is None]
    # An addition may be one of zero, for these inputs or for all.
    assert len(missed) <= len(tried) // 4, missed
    for _, faulty in tried:
        faulty.close()


def test_the_addresses_executed_and_touched_are_those_of_every_input(built: Built) -> None:
    trace = built.step.trace(built.inputs, STEPS)
    assert trace.steps == STEPS
    assert trace.same_code
    assert trace.same_data
    assert trace.first_difference is None
    assert int(trace.instructions[0]) == len(trace.path) or not trace.addresses


BRANCH = "if (observation[0] > 3) { volatile int16_t stop = observation[1]; (void)stop; }"


@pytest.mark.parametrize("name", CHIP_NAMES)
def test_a_branch_on_an_observation_shows_in_the_trace(name: str, tmp_path: Path) -> None:
    whose = plain_champion()
    code = with_line(written(whose, tmp_path), BRANCH)
    trace = emulated(name, code).trace(np.array([[0, 1, 2], [9, 1, 2], [0, 3, 3]], dtype=np.int16), 3)
    assert not trace.same_code
    assert trace.first_difference == 1


@pytest.mark.parametrize("name", [one.name for one in CHIPS if one.name != "wasm32"])
def test_an_address_that_depends_on_an_observation_shows_in_the_trace(name: str, tmp_path: Path) -> None:
    whose = plain_champion()
    code = with_line(
        written(whose, tmp_path), "{ volatile int16_t slots[4]; slots[(uint16_t)observation[0] & 3U] = 1; }"
    )
    trace = emulated(name, code).trace(np.array([[0, 1, 2], [1, 1, 2]], dtype=np.int16), 2)
    assert not trace.same_data


def with_line(code: CFile, line: str) -> CFile:
    code.path.write_text(code.source.replace("    action[0]", f"    {line}\n    action[0]", 1))
    return CFile.read(code.path)


@pytest.mark.parametrize("name", ["cortex-m0", "rv32imc", "avr", "x86-64", "ppc", "wasm32"])
def test_what_does_not_come_back_is_stopped(name: str, tmp_path: Path) -> None:
    code = with_line(written(plain_champion(), tmp_path), "{ volatile int on = 1; while (on) { } }")
    one = emulated(name, code)
    with pytest.raises(ImplementationError, match="did not come back"):
        one.step(np.zeros(3, dtype=np.int16))


@pytest.mark.parametrize("name", ["cortex-m0", "rv32imc", "x86-64", "ppc", "wasm32"])
def test_what_strays_crashes_and_can_be_restarted(name: str, tmp_path: Path) -> None:
    line = "if (observation[0] == 7) { *(volatile int *)(uintptr_t)0xf0000000U = 1; }"
    one = emulated(name, with_line(written(plain_champion(), tmp_path), line))
    with pytest.raises(ImplementationError, match="crashed"):
        one.step(np.array([7, 0, 0], dtype=np.int16))
    one.restart()
    assert one.step(np.array([6, 0, 0], dtype=np.int16)).shape == (1,)


def test_wasm_that_strays_needs_no_signal_handler(tmp_path: Path) -> None:
    line = "if (observation[0] == 7) { *(volatile int *)(uintptr_t)0xf0000000U = 1; }"
    code = with_line(written(plain_champion(), tmp_path), line)
    program = f"""
import signal
from pathlib import Path
import numpy as np
from bitneat.verify.cfile import CFile
from bitneat.verify.implementation import ImplementationError
from tests.verify.targets.chips import emulated
one = emulated("wasm32", CFile.read(Path({str(code.path)!r})))
one.step(np.array([6, 0, 0], dtype=np.int16))
signal.signal(signal.SIGSEGV, signal.SIG_DFL)
try:
    one.step(np.array([7, 0, 0], dtype=np.int16))
except ImplementationError as error:
    print(error)
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith("crashed")


@pytest.mark.parametrize("name", ["cortex-m33", "rv32ec", "avr", "i386"])
def test_ziglang_serves_where_there_is_no_gcc(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chip, "identify", lambda command: None)
    whose = champion(seed=3)
    inputs = random_vectors(whose.controller, 1, STEPS)
    for style in STYLES:
        one = emulated(name, written(whose, tmp_path, style))
        assert (one.run(inputs) == answers(whose.controller, inputs)).all()


@pytest.mark.parametrize("style", STYLES)
def test_what_zigs_clang_makes_for_avr_does_not_depend_on_data(
    style: Style, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chip, "identify", lambda command: None)
    whose = load(CHAMPIONS / "tiny.pkl")
    code = written(whose, tmp_path, style)
    target, toolchain = ready("avr")
    assert toolchain.compiler.family == "zig"
    inputs = random_vectors(whose.controller, 1, STEPS)
    expected = answers(whose.controller, inputs)
    for entry in entries(code):
        one = target.implementation(code, toolchain, entry)
        assert (one.run(inputs) == expected).all()
        trace = one.trace(inputs, STEPS)
        assert trace.same_code
        assert trace.same_data
        one.close()


def test_verify_fails_where_the_trace_depends_on_data(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path, "table")
    line = "if (observation[0] > 3) { volatile int16_t stop = 0; (void)stop; }"
    code.path.write_text(code.source.replace("    int16_t signals[", f"    {line}\n    int16_t signals[", 1))
    report = verify(whose, CFile.read(code.path), select(["cortex-m0"]), Settings(1, max_steps=5, compare_text=False))
    assert any("the addresses executed depend on the inputs" in failure for failure in report.failures)
    entry = next(target for target in report.to_data()["targets"] if target["style"] == "table")
    assert entry["trace"]["data_independent"] is False
    assert entry["cycles_per_step"] is None


def test_the_report_says_what_a_step_takes(tmp_path: Path) -> None:
    whose = plain_champion()
    settings = Settings(episodes=1, max_steps=5)
    report = verify(whose, written(whose, tmp_path), select(["cortex-m0", "cortex-m3", "wasm32"]), settings)
    assert report.failures == ()
    first, *others = [target for target in report.to_data()["targets"] if target["style"] == "unrolled"]
    least = first["instructions_per_step"]["min"]
    assert 0 < least == first["instructions_per_step"]["max"] < first["cycles_per_step"]
    assert first["steps_compared"] == 2005
    assert first["loop_steps"] == 5
    assert first["trace"]["inputs"] == 2000
    assert "WCET = BCET" in first["trace"]["entries"]["step"]["timing"]
    assert [other["cycles_per_step"] for other in others] == [None, None]
    assert [other["trace"]["data_independent"] for other in others] == [True, None]
    assert others[0]["trace"]["entries"]["step"]["timing"] == "data-independent trace"


@pytest.mark.parametrize("environment", ["BipedalWalker-v3", "Pendulum-v1"])
def test_the_measured_stack_on_avr_is_the_one_that_gcc_computes(environment: str, tmp_path: Path) -> None:
    target, toolchain = ready("avr")
    if toolchain.compiler.family != "gcc":
        pytest.skip("no gcc to compare with")
    whose = champion(environment, seed=1)
    code = written(whose, tmp_path)
    inputs = np.zeros((1, len(whose.controller.inputs)), np.int16)
    measured = target.implementation(code, toolchain, "step").trace(inputs, 1).stack
    flags = [*toolchain.flags, *OBJECT_FLAGS, "-fstack-usage", "-c", str(code.path), "-o", str(tmp_path / "legs.o")]
    subprocess.run([*toolchain.compiler.command, *flags], check=True)
    # A line for each function: its place, bytes with the return address, and whether that is all. Activations call nothing.
    usage = [line.split("\t") for line in (tmp_path / "legs.su").read_text().splitlines()]
    assert {kind for _, _, kind in usage} == {"static"}
    (step,) = [int(size) for place, size, _ in usage if place.endswith(":legs_step")]
    assert measured == step + max((int(size) for place, size, _ in usage if not place.endswith("_step")), default=0)


@pytest.mark.parametrize("name", ["cortex-m0", "rv32imc"])
def test_the_measured_stack_is_the_one_that_gcc_computes(name: str, tmp_path: Path) -> None:
    from bitneat.verify.machine import examine

    target, toolchain = ready(name)
    if toolchain.compiler.family != "gcc":
        pytest.skip("no gcc to compare with")
    code = written(champion("BipedalWalker-v3", seed=1), tmp_path, "table")
    trace = target.implementation(code, toolchain, "step").trace(np.zeros((1, 24), dtype=np.int16), 1)
    assert trace.stack == examine(code, toolchain).stack


def big_champion() -> Champion:
    """One whose signals do not fit into 2 KB."""
    from bitneat.controller import Link, Node, Signal

    whose = plain_champion()
    nodes = [Node((Link(0, sign=1), Link(1, sign=-1)), 0, 0, "identity")]
    nodes += [Node((Link(2 + at, sign=1), Link(at % 3, sign=1)), 0, 0, "clamped") for at in range(1, 1100)]
    controller = Controller(whose.controller.inputs, tuple(nodes), (Signal(3 + len(nodes) - 1),), 8)
    return Champion(controller, whose.action, whose.environment)


def test_a_controller_too_large_for_the_chip_is_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TARGETS, "rv32ec", replace(BY_NAME["rv32ec"], ram=16))
    code = written(plain_champion(), tmp_path, "table")
    with pytest.raises(BitneatError, match=r"--targets rv32ec: legs.c .* needs \d+ bytes of RAM .*the CH32V003 has 16"):
        verify(plain_champion(), code, select(["host-table", "rv32ec"]), Settings(1, max_steps=3))


@pytest.mark.long
def test_a_controller_of_two_thousand_bytes_of_signals_is_too_large_for_the_ch32v003(tmp_path: Path) -> None:
    whose = big_champion()
    code = written(whose, tmp_path, "table")
    with pytest.raises(
        BitneatError, match=r"--targets rv32ec: legs.c \(style .*\) needs \d+ bytes of .*the CH32V003 has"
    ):
        verify(whose, code, select(["host-table", "rv32ec"]), Settings(1, max_steps=3))


@pytest.mark.long
def test_the_committed_walker_is_the_same_on_every_target(tmp_path: Path) -> None:
    """With 100,000 vectors and three episodes: what the acceptance of the targets asks for."""
    result = tmp_path / "out.json"
    assert (
        main(["verify", str(CHAMPIONS / "walker.pkl"), "--targets", "all", "--episodes", "3", "--json", str(result)])
        == 0
    )
    report = json.loads(result.read_text())
    assert report["verdict"] == "pass"
    assert {target["name"] for target in report["targets"]} == set(TARGETS)
    assert len(report["targets"]) == 2 + 2 * len(CHIPS)
    for target in report["targets"]:
        assert target["mismatches"] == 0, target["name"]
        assert target["steps_compared"] >= 100_000, target["name"]
        assert target["trace"] is None or target["trace"]["data_independent"] is not False, target["name"]
