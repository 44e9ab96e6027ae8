# SPDX-License-Identifier: MIT
import ctypes
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bitneat.native import Compiler, compile_object, host_compiler, shared_library, zig_compiler
from bitneat.native import build as build_module
from bitneat.native.build import cache_dir
from bitneat.native.compiler import CompilerError

SOURCE = """
#include "answer.h"
int answer(void);
int answer(void) { return ANSWER; }
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BITNEAT_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def source(tmp_path: Path) -> Path:
    (tmp_path / "src").mkdir()
    (tmp_path / "include").mkdir()
    (tmp_path / "include" / "answer.h").write_text("#define ANSWER 42\n")
    path = tmp_path / "src" / "answer.c"
    path.write_text(SOURCE)
    return path


def build(source: Path, *flags: str, compiler: Compiler | None = None, **defines: str) -> Path:
    include = source.parent.parent / "include"
    return shared_library(
        [source], name="answer", include_dirs=[include], flags=flags, defines=defines, compiler=compiler
    )


def answer(library: Path) -> int:
    return int(ctypes.CDLL(str(library)).answer())


def test_a_built_library_works_and_is_found_the_second_time(
    source: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = build(source, "-std=c99", "-O2")
    assert answer(library) == 42
    assert library.parent == cache
    assert os.listdir(cache) == [library.name]
    host_compiler()
    monkeypatch.setattr(build_module, "_build", None)
    assert build(source, "-std=c99", "-O2") == library


@pytest.mark.parametrize("edited", ["src/answer.c", "include/answer.h", "src/beside.h", "include/deep/in.h"])
def test_an_edited_source_or_header_gives_another_library(source: Path, edited: str) -> None:
    before = build(source)
    path = source.parent.parent / edited
    path.parent.mkdir(exist_ok=True)
    path.write_text((path.read_text() if path.exists() else "") + "\n")
    assert build(source) != before


def test_flags_and_definitions_give_another_library(source: Path) -> None:
    libraries = {build(source), build(source, "-O1"), build(source, "-O2"), build(source, OTHER="1")}
    assert len(libraries) == 4


def test_another_compiler_or_version_gives_another_library(source: Path) -> None:
    one = host_compiler()
    other = Compiler(one.command, one.family, one.version + "\nupgraded")
    assert build(source, compiler=one) != build(source, compiler=other)


def test_other_processor_features_matter_only_to_native_code(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gcc = Compiler(host_compiler().command, "gcc", "1")
    portable, native = (build(source, *flags, compiler=gcc) for flags in ((), ("-march=native",)))
    monkeypatch.setattr(build_module, "_processor_features", lambda: "another machine")
    assert build(source, compiler=gcc) == portable
    assert build(source, "-march=native", compiler=gcc) != native


def test_the_place_of_the_checkout_does_not_matter(source: Path, tmp_path: Path) -> None:
    before = build(source)
    (tmp_path / "moved").mkdir()
    for part in ("src", "include"):
        (tmp_path / part).rename(tmp_path / "moved" / part)
    assert build(tmp_path / "moved" / "src" / "answer.c") == before


def test_the_compilers_first_error_is_the_message(source: Path, cache: Path) -> None:
    source.write_text("int answer(void) { return nothing; }\nint more(void) { return nothing2; }\n")
    with pytest.raises(CompilerError, match=r"answer\.c: .* failed: .*error: .*nothing") as caught:
        build(source)
    assert "\n" not in str(caught.value)
    assert "nothing2" not in str(caught.value)
    assert os.listdir(cache) == []


def test_a_program_that_is_no_compiler_is_said_to_have_made_nothing(source: Path) -> None:
    with pytest.raises(CompilerError, match=r"answer\.c: true ended well and made no file: expected a C compiler"):
        build(source, compiler=Compiler(("true",), "gcc", "true 1"))


def test_a_missing_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(CompilerError, match=r"gone\.c: cannot read: No such file"):
        shared_library([tmp_path / "gone.c"], name="gone")


def test_processes_that_build_at_the_same_time_all_get_a_working_library(source: Path, cache: Path) -> None:
    code = (
        "import sys, ctypes, pathlib\n"
        "from bitneat.native import shared_library\n"
        "source = pathlib.Path(sys.argv[1])\n"
        "library = shared_library([source], name='answer', include_dirs=[source.parent.parent / 'include'])\n"
        "print(ctypes.CDLL(str(library)).answer())\n"
    )
    processes = [
        subprocess.Popen([sys.executable, "-c", code, str(source)], stdout=subprocess.PIPE, text=True) for _ in range(6)
    ]
    assert [process.communicate()[0] for process in processes] == ["42\n"] * 6
    assert len(os.listdir(cache)) == 1


def test_a_cache_that_cannot_be_written_gives_way_to_a_private_temporary_folder(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("BITNEAT_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    library = build(source)
    assert answer(library) == 42
    assert library.parent.parent == tmp_path / "temporary"
    assert library.parent.stat().st_mode & 0o777 == 0o700


def test_a_temporary_folder_that_others_may_write_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planted = tmp_path / f"bitneat-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    monkeypatch.setenv("BITNEAT_CACHE_DIR", "/dev/null/cache")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    build_module._cache_dir.cache_clear()
    assert cache_dir() != planted
    assert cache_dir().parent == tmp_path
    build_module._cache_dir.cache_clear()


def test_the_xdg_cache_folder_is_the_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BITNEAT_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_dir() == tmp_path / "xdg" / "bitneat"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache_dir() == tmp_path / "home" / ".cache" / "bitneat"


def test_libraries_unused_for_a_month_are_dropped_and_used_ones_kept(source: Path) -> None:
    month_ago = time.time() - 31 * 24 * 3600
    unused, used = build(source, "-O0"), build(source, "-O1")
    os.utime(unused, (month_ago, month_ago))
    os.utime(used, (month_ago, month_ago))
    build(source, "-O1")
    build(source, "-O2")
    assert used.exists()
    assert not unused.exists()


def test_zig_builds_the_same_library(source: Path) -> None:
    compiler = zig_compiler()
    assert compiler is not None
    assert answer(build(source, "-std=c99", "-O2", compiler=compiler)) == 42


def test_an_object_for_another_machine_is_compiled_where_it_is_asked_for(source: Path, tmp_path: Path) -> None:
    compiler = zig_compiler("thumb-freestanding-eabi")
    assert compiler is not None
    out = tmp_path / "answer.o"
    include = source.parent.parent / "include"
    compile_object(source, compiler, ["-mcpu=cortex_m0", "-Os", f"-I{include}"], out)
    assert out.read_bytes()[:5] == b"\x7fELF\x01"
    with pytest.raises(CompilerError, match=r"answer\.h"):
        compile_object(source, compiler, [], tmp_path / "other.o")
    assert not (tmp_path / "other.o").exists()


def test_what_is_named_like_a_header_and_is_no_file_is_left_alone(source: Path) -> None:
    os.mkfifo(source.parent / "pipe.h")
    (source.parent / "folder.h").mkdir()
    (source.parent.parent / "include" / "broken.h").symlink_to("nowhere")
    assert answer(build(source)) == 42


def test_a_library_that_is_cut_off_or_changed_is_built_again(source: Path) -> None:
    library = build(source)
    content = library.read_bytes()
    for bad in (b"", content[:64], content[:-1], content[:2000] + bytes([content[2000] ^ 1]) + content[2001:]):
        library.unlink()  # a library that is loaded must not change under those who use it
        library.write_bytes(bad)
        assert build(source) == library
        assert answer(library) == 42
