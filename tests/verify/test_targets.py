# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.native import compiler
from bitneat.native.compiler import CompilerError
from bitneat.verify import targets as under_test
from bitneat.verify.targets import TARGETS, select


@pytest.fixture
def no_tools(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine without any compiler."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "zig_compiler", lambda target=None: None)
    monkeypatch.setattr(under_test, "zig_compiler", lambda target=None: None)


def test_by_default_the_host_and_every_chip_whose_tools_are_there() -> None:
    names = [ready.target.name for ready in select(None)]
    assert names == ["host-unrolled", "host-table", "cortex-m0"]


def test_all_is_every_target() -> None:
    assert [ready.target.name for ready in select(["all"])] == list(TARGETS)


def test_an_unknown_target_lists_the_known() -> None:
    with pytest.raises(BitneatError, match="host-unrolled, host-table, cortex-m0, or all"):
        select(["cortex-m99"])


def test_without_a_host_compiler_nothing_can_be_verified(no_tools: None) -> None:
    with pytest.raises(CompilerError, match="no C compiler found; install one"):
        select(None)


@pytest.mark.parametrize("names", [["cortex-m0"], ["all"]])
def test_a_chip_that_is_asked_for_and_missing_is_bad_input(names: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, "identify", lambda command: None)
    monkeypatch.setattr(under_test, "zig_compiler", lambda target=None: None)
    with pytest.raises(BitneatError, match="cortex-m0: its tools are missing; install a cross compiler"):
        select(names)
    assert [ready.target.name for ready in select(None)] == ["host-unrolled", "host-table"]


def test_without_gcc_a_chip_is_served_by_ziglang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, "identify", lambda command: None)
    (ready,) = select(["cortex-m0"])
    assert ready.toolchain.compiler.family == "zig"


def test_a_list_without_names_is_refused() -> None:
    with pytest.raises(BitneatError, match="names no target"):
        select([])
