# SPDX-License-Identifier: MIT
"""The CMake build: the runtime for this machine, installed and found by a stranger, and for chips."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bitneat.version import __version__

ROOT = Path(__file__).resolve().parents[1]
TOOLCHAINS = ROOT / "cmake" / "toolchains"
COMPILER_OF = {
    "arm-none-eabi-cortex-m0": "arm-none-eabi-gcc",
    "avr-atmega328p": "avr-gcc",
    "riscv32": "riscv64-unknown-elf-gcc",
    "zig-cortex-m0": None,
    "zig-riscv32": None,
    "zig-avr": None,
}
"""The program that each toolchain file needs in the PATH; zig comes with the ziglang package."""

ELF_MACHINE_OF = {"arm-none-eabi-cortex-m0": 40, "zig-cortex-m0": 40, "avr-atmega328p": 83, "zig-avr": 83}
EM_RISCV = 243

CONSUMER = f"""
cmake_minimum_required(VERSION 3.21)
project(stranger LANGUAGES C)
find_package(bitneat_runtime {__version__.rpartition(".")[0]} REQUIRED)
add_executable(stranger main.c)
target_link_libraries(stranger PRIVATE bitneat::runtime)
"""

CONSUMER_MAIN = """
#include <bitneat/runtime.h>
int main(void)
{
    struct bn_controller c;
    const uint8_t nonsense[1] = {255};
    return bn_open(&c, nonsense, sizeof nonsense) == BN_OK;
}
"""


def cmake(program: str, *arguments: str | Path, cwd: Path | None = None) -> None:
    """Run cmake or ctest of the Python environment, else of the system, and show all it said if it fails."""
    beside = Path(sys.executable).parent / program
    command = [str(beside if beside.is_file() else program), *map(str, arguments)]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, env={**os.environ, "PATH": path}
    )
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"


def configure_and_build(source: Path, build: Path, *options: str) -> None:
    cmake("cmake", "-S", source, "-B", build, *options)
    cmake("cmake", "--build", build)


def test_the_build_for_this_machine_passes_its_own_tests(tmp_path: Path) -> None:
    configure_and_build(ROOT, tmp_path / "build", "-DCMAKE_BUILD_TYPE=Release")
    cmake("ctest", "--output-on-failure", cwd=tmp_path / "build")


def test_an_installed_runtime_is_found_and_linked_by_another_project(tmp_path: Path) -> None:
    configure_and_build(ROOT / "runtime_c", tmp_path / "build", "-DBUILD_TESTING=OFF")
    cmake("cmake", "--install", tmp_path / "build", "--prefix", tmp_path / "prefix")
    stranger = tmp_path / "stranger"
    stranger.mkdir()
    (stranger / "CMakeLists.txt").write_text(CONSUMER)
    (stranger / "main.c").write_text(CONSUMER_MAIN)
    configure_and_build(stranger, stranger / "build", f"-DCMAKE_PREFIX_PATH={tmp_path / 'prefix'}")
    subprocess.run([stranger / "build" / "stranger"], check=True)


@pytest.mark.parametrize("toolchain", COMPILER_OF)
def test_a_toolchain_file_builds_the_runtime_for_its_chip(toolchain: str, tmp_path: Path) -> None:
    compiler = COMPILER_OF[toolchain]
    if compiler is not None and shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed; the zig toolchain file of the same chip is tested")
    configure_and_build(ROOT, tmp_path, "--toolchain", str(TOOLCHAINS / f"{toolchain}.cmake"))
    objects = [*tmp_path.rglob("*.o"), *tmp_path.rglob("*.obj")]
    assert objects
    for built in objects:
        header = built.read_bytes()[:20]
        assert header[:5] == b"\x7fELF\x01", f"{built} is no 32-bit object"
        assert int.from_bytes(header[18:20], "little") == ELF_MACHINE_OF.get(toolchain, EM_RISCV)


def test_every_toolchain_file_is_tested() -> None:
    shared = {"zig", "freestanding"}
    assert {path.stem for path in TOOLCHAINS.glob("*.cmake")} - shared == set(COMPILER_OF)
