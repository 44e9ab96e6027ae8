# SPDX-License-Identifier: MIT
import shutil
from pathlib import Path

import pytest

from bitneat.native import host_compiler, identify, zig_compiler
from bitneat.native.compiler import CompilerError


@pytest.fixture
def tools(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is the whole PATH, with no CC set."""
    folder = tmp_path / "tools"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.delenv("CC", raising=False)
    return folder


def script(path: Path, text: str) -> None:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def test_the_host_compiler_names_itself_in_one_line() -> None:
    compiler = host_compiler()
    assert Path(compiler.command[0]).is_absolute()
    assert compiler.title
    assert "\n" not in compiler.title


def test_cc_is_tried_before_gcc_and_gcc_before_clang(tools: Path) -> None:
    script(tools / "clang", "echo clang version 1")
    assert host_compiler().title == "clang version 1"
    script(tools / "gcc", "echo 'gcc 2 Free Software Foundation'")
    host_compiler.__globals__["_host_compiler"].cache_clear()
    host_compiler.__globals__["_identify"].cache_clear()
    assert host_compiler().family == "gcc"
    script(tools / "cc", "echo strange 3")
    host_compiler.__globals__["_host_compiler"].cache_clear()
    host_compiler.__globals__["_identify"].cache_clear()
    assert host_compiler().family == "other"


def test_the_cc_variable_wins_and_may_carry_arguments(tools: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script(tools / "cc", "echo plain")
    script(tools / "mine", 'echo "mine $*"')
    monkeypatch.setenv("CC", "mine --wrapped")
    compiler = host_compiler()
    assert compiler.command == (str(tools / "mine"), "--wrapped")
    assert compiler.title == "mine --wrapped --version"


@pytest.mark.parametrize("named", ["nowhere", "false", "'"])
def test_a_cc_variable_that_does_not_work_is_an_error_that_names_it(
    named: str, tools: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script(tools / "false", "exit 1")
    script(tools / "cc", "echo plain")
    monkeypatch.setenv("CC", named)
    with pytest.raises(CompilerError, match=rf"CC={named}: not a working C compiler"):
        host_compiler()


def test_without_a_system_compiler_the_ziglang_package_is_one(tools: Path) -> None:
    assert host_compiler().family == "zig"


def test_without_any_compiler_the_error_says_what_to_install(tools: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bitneat.native.compiler.find_spec", lambda name: None)
    host_compiler.__globals__["_host_compiler"].cache_clear()
    with pytest.raises(CompilerError, match=r"apt install gcc.*pip install ziglang"):
        host_compiler()
    host_compiler.__globals__["_host_compiler"].cache_clear()


def test_a_program_that_is_missing_or_says_nothing_is_no_compiler(tools: Path) -> None:
    script(tools / "silent", "true")
    assert identify(["silent"]) is None
    assert identify(["absent"]) is None
    (tools / "garbage").write_bytes(b"\x7fELF\0\0")
    (tools / "garbage").chmod(0o755)
    assert identify(["garbage"]) is None


def test_zig_for_a_target_is_a_compiler_of_its_own() -> None:
    compiler = zig_compiler("thumb-freestanding-eabi")
    assert compiler is not None
    assert compiler.command[-2:] == ("-target", "thumb-freestanding-eabi")
    assert shutil.which(compiler.command[0])
