# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.native import compiler
from bitneat.native.compiler import CompilerError
from bitneat.verify.targets import TARGETS, chip, select, simavr_emulator, style_for, unicorn_emulator


@pytest.fixture
def no_tools(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine without any compiler."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "zig_compiler", lambda target=None: None)
    monkeypatch.setattr(chip, "zig_compiler", lambda target=None: None)


@pytest.fixture
def no_unicorn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unicorn_emulator, "find_spec", lambda name: None)


def test_ten_targets_and_a_big_endian_one_need_nothing_from_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chip, "identify", lambda command: None)
    served = [name for name in TARGETS if not name.startswith("host-") and name != "avr"]
    ready = select(served)
    assert len(ready) >= 10
    assert all(one.runs and one.toolchain.compiler.family == "zig" for one in ready)
    assert "ppc" in served


def test_by_default_the_host_and_every_chip_whose_tools_are_there() -> None:
    names = [ready.target.name for ready in select(None)]
    assert names == list(TARGETS)  # ziglang is a dependency, so there is a compiler for all


def test_all_is_every_target(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simavr_emulator.SimavrEmulator, "missing", lambda emulator: None)
    assert [ready.target.name for ready in select(["all"])] == list(TARGETS)


def test_an_unknown_target_lists_the_known() -> None:
    with pytest.raises(BitneatError, match=r"host-unrolled, host-table, cortex-m0, .*wasm32, or all"):
        select(["cortex-m99"])
    with pytest.raises(BitneatError, match="--targets cortex-m99: no such target"):
        select(["all", "cortex-m99"])


def test_without_a_host_compiler_nothing_can_be_verified(no_tools: None) -> None:
    with pytest.raises(CompilerError, match="no C compiler found; install one"):
        select(None)


@pytest.mark.parametrize("names", [["cortex-m0"], ["host-table", "cortex-m0"]])
def test_a_chip_that_is_asked_for_and_missing_is_bad_input(names: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chip, "identify", lambda command: None)
    monkeypatch.setattr(chip, "zig_compiler", lambda target=None: None)
    with pytest.raises(BitneatError, match="cortex-m0: its tools are missing; install a cross compiler"):
        select(names)
    assert [ready.target.name for ready in select(None)] == ["host-unrolled", "host-table"]


def test_a_missing_emulator_is_bad_input_where_code_is_to_run(no_unicorn: None) -> None:
    with pytest.raises(BitneatError, match=r"cortex-m0: its tools are missing; install .*pip install unicorn"):
        select(["cortex-m0"])
    assert [ready.runs for ready in select(["cortex-m0"], run=False)] == [False]
    assert {ready.target.name: ready.runs for ready in select(None)}["cortex-m0"] is False


def test_a_missing_simavr_names_debians_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simavr_emulator.ctypes.util, "find_library", lambda name: None)
    with pytest.raises(BitneatError, match=r"avr: its tools are missing; install .*apt install libsimavr-dev"):
        select(["avr"])


def test_without_gcc_a_chip_is_served_by_ziglang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chip, "identify", lambda command: None)
    (ready,) = select(["cortex-m0"])
    assert ready.toolchain.compiler.family == "zig"


@pytest.mark.parametrize(
    ("names", "style"),
    [
        (None, "auto"),
        (["host-table"], "table"),
        (["host-unrolled"], "unrolled"),
        (["host-unrolled", "host-table"], "auto"),
        (["host-unrolled", "cortex-m0"], "auto"),
        (["cortex-m0"], "auto"),
    ],
)
def test_the_style_is_the_only_one_that_the_targets_run(names: list[str] | None, style: str) -> None:
    assert style_for(names) == style


def test_the_host_is_a_chip_without_bounds_or_cycles() -> None:
    host = TARGETS["host-table"]
    assert (host.chip, host.ram, host.flash, host.cycles_source) == ("host", None, None, None)
    assert host.cycles(b"", 0, ()) is None
    assert "apt install gcc" in host.needs
    assert host.missing_to_run() is None


def test_a_list_without_names_is_refused() -> None:
    with pytest.raises(BitneatError, match="names no target"):
        select([])
