# SPDX-License-Identifier: MIT
"""Packages build in their ecosystems as they are, say what is true, and are written without harm."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import kconfiglib
import pytest
import yaml

from bitneat.champion import Champion, EnvironmentSpec, save_pickle
from bitneat.cli.codegen import KINDS as OFFERED
from bitneat.cli.main import main
from bitneat.codegen import generate
from bitneat.codegen.package import KINDS, view
from bitneat.codegen.package.view import Package, PackageError, flash_bytes
from bitneat.controller import BoxAction, Constant, Controller, DiscreteAction, Input, Link, Node, Signal
from bitneat.native.compiler import CompilerError
from bitneat.verify.cfile import CFile
from bitneat.version import __version__
from tests.strategies import random_controller

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")


def some_controller(*, feed_forward: bool) -> Controller:
    seed = 40
    while True:
        controller = random_controller(random.Random(seed), size="small", feed_forward=feed_forward, num_outputs=2)
        seed += 1
        if controller.canonical.is_recurrent != feed_forward and not any(
            isinstance(output, Constant) for output in controller.canonical.outputs
        ):
            return controller


FEED_FORWARD = Champion(
    some_controller(feed_forward=True), BoxAction((-1.0, 0.0), (1.0, 5.0), (2,), "float32"), EnvironmentSpec("Legs-v1")
)
RECURRENT = Champion(some_controller(feed_forward=False), DiscreteAction(2, 3), EnvironmentSpec('*/"${x}" `y`\n$(z)|'))
CHAMPIONS = {"feed-forward": FEED_FORWARD, "recurrent": RECURRENT}


def sensor_map(champion: Champion) -> str:
    """Every input from a 10-bit count over its whole range, every output to a PWM register."""
    lines = []
    for index, entry in enumerate(champion.controller.inputs):
        reach = min(entry.limit, 2000) / 2 ** (champion.controller.frac_bits + entry.scale)
        lines.append(
            f"[[inputs]]\ninput = {index}\ncounts = [0, 1023]\npoints = [[0, {-reach!r}], [1023, {reach!r}]]\n"
        )
        lines.append("tolerance = 4\n")
    if isinstance(champion.action, BoxAction):
        for index in range(len(champion.controller.outputs)):
            lines.append(f"[[outputs]]\noutput = {index}\nvalues = [0, 1]\ncounts = [1000, 2000]\ntolerance = 80\n")
    return "".join(lines)


@pytest.fixture(params=["feed-forward", "recurrent"])
def champion(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Champion:
    chosen = CHAMPIONS[request.param]
    monkeypatch.chdir(tmp_path)
    save_pickle(chosen, tmp_path / "champion.pkl")
    (tmp_path / "map.toml").write_text(sensor_map(chosen))
    return chosen


def package(kind: str, *options: str, folder: str = "legs") -> Path:
    assert main(["codegen", "champion.pkl", "-o", folder, "--package", kind, *options]) == 0
    return Path(folder).absolute()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def run(*command: str | Path, cwd: Path) -> str:
    """Run a tool of the Python environment or the system, and show all it said if it fails."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False, env={**os.environ, "PATH": path}
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


SENSORS = pytest.mark.parametrize("options", [(), ("--sensor", "map.toml")], ids=["signals", "counts"])


def test_every_kind_is_offered() -> None:
    assert tuple(KINDS) == OFFERED


@pytest.mark.parametrize("kind", OFFERED)
@SENSORS
def test_a_package_is_the_same_every_time_and_holds_what_its_manifest_says(
    champion: Champion, kind: str, options: tuple[str, ...]
) -> None:
    first = contents(package(kind, *options))
    assert contents(package(kind, *options)) == first
    assert contents(package(kind, *options, "--name", "legs", folder="elsewhere")) == first
    manifest = json.loads(first["bitneat-package.json"])
    assert manifest["files"] == sorted(first)
    assert manifest["controller"] == champion.controller.sha256
    everything = b"".join(first.values()).decode("ascii")
    assert "`y`" not in everything
    assert "${x}" not in everything
    assert str(Path.cwd()) not in everything


@pytest.mark.parametrize("kind", OFFERED)
def test_the_readme_tells_fingerprint_sizes_licence_and_selftest(champion: Champion, kind: str) -> None:
    folder = package(kind)
    page = (folder / "README.md").read_text()
    assert champion.controller.sha256 in page
    flash = re.search(r"\| (\d+) bytes on a Cortex-M0", page)
    assert flash is not None
    assert 20 < int(flash[1]) < 4000
    assert "0BSD" in page
    assert "legs_selftest()" in page
    assert "Permission to use" in (folder / "LICENSE").read_text()


@pytest.mark.parametrize("kind", OFFERED)
def test_the_source_can_be_verified_where_it_lies(champion: Champion, kind: str) -> None:
    code = CFile.read(package(kind) / "src" / "legs.c")
    assert code.sha256 == champion.controller.sha256
    assert code.regenerated(champion).source == code.source


@pytest.mark.parametrize("kind", OFFERED)
def test_the_sources_compile_as_c_and_as_cxx(champion: Champion, kind: str, tmp_path: Path) -> None:
    folder = package(kind, "--sensor", "map.toml")
    for source in sorted((folder / "src").glob("*.c")):
        run("cc", "-std=c99", *STRICT, "-Wconversion", "-c", source, "-o", tmp_path / "c.o", cwd=tmp_path)
        if shutil.which("g++"):
            run("g++", "-x", "c++", "-std=c++11", *STRICT, "-c", source, "-o", tmp_path / "c.o", cwd=tmp_path)


@SENSORS
def test_plain_builds_with_make_and_its_selftests_can_fail(champion: Champion, options: tuple[str, ...]) -> None:
    folder = package("plain", *options)
    run("make", cwd=folder)
    assert (folder / "liblegs.a").is_file()
    run("make", "check", cwd=folder)
    run("make", "clean", cwd=folder)
    source = folder / "src" / "legs_selftest.c"
    text = source.read_text()
    at = text.index("legs_test_outputs[64]")
    at = text.index("{", text.index("= {", at) + 3) + 1
    source.write_text(text[:at] + "1 + " + text[at:])
    failed = subprocess.run(["make", "check"], cwd=folder, capture_output=True, check=False)
    assert failed.returncode != 0


MINOR = __version__.rpartition(".")[0]

STRANGER = f"""
cmake_minimum_required(VERSION 3.21)
project(stranger LANGUAGES C CXX)
find_package(legs {MINOR} REQUIRED)
add_executable(stranger main.c)
target_link_libraries(stranger PRIVATE legs::legs)
add_executable(stranger_cxx main.cpp)
target_link_libraries(stranger_cxx PRIVATE legs::legs)
"""
STRANGER_MAIN = """
#include <legs.h>
int main(void)
{
    static const int16_t observation[LEGS_NUM_INPUTS] = {0};
    int16_t action[LEGS_NUM_OUTPUTS];
    STATE
    return 0;
}
"""


def stranger(folder: Path, champion: Champion, cmakelists: str) -> Path:
    """Another CMake project that uses the library."""
    step = "legs_step(observation, action);"
    if champion.controller.canonical.is_recurrent:
        step = "struct legs_state state; legs_reset(&state); legs_step(&state, observation, action);"
    folder.mkdir()
    (folder / "CMakeLists.txt").write_text(cmakelists)
    (folder / "main.c").write_text(STRANGER_MAIN.replace("STATE", step))
    (folder / "main.cpp").write_text(STRANGER_MAIN.replace("STATE", step))
    return folder


@SENSORS
def test_cmake_builds_tests_installs_and_is_found_by_another_project(
    champion: Champion, options: tuple[str, ...], tmp_path: Path
) -> None:
    folder = package("cmake", *options)
    build = tmp_path / "build"
    run("cmake", "-S", folder, "-B", build, "-DCMAKE_BUILD_TYPE=MinSizeRel", cwd=tmp_path)
    run("cmake", "--build", build, cwd=tmp_path)
    said = run("ctest", "--test-dir", build, cwd=tmp_path)
    assert re.search(rf"100% tests passed.* out of {1 + bool(options)}\n", said)
    run("cmake", "--install", build, "--prefix", tmp_path / "prefix", cwd=tmp_path)
    # What was installed must do without the folders it was made in.
    shutil.rmtree(folder)
    shutil.rmtree(build)
    other = stranger(tmp_path / "stranger", champion, STRANGER)
    run("cmake", "-S", other, "-B", other / "build", f"-DCMAKE_PREFIX_PATH={tmp_path / 'prefix'}", cwd=tmp_path)
    run("cmake", "--build", other / "build", cwd=tmp_path)
    run(other / "build" / "stranger", cwd=tmp_path)
    run(other / "build" / "stranger_cxx", cwd=tmp_path)


def test_cmake_refuses_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save_pickle(FEED_FORWARD, tmp_path / "champion.pkl")
    folder = package("cmake")
    run("cmake", "-S", folder, "-B", "build", cwd=tmp_path)
    run("cmake", "--build", "build", cwd=tmp_path)
    run("cmake", "--install", "build", "--prefix", tmp_path / "prefix", cwd=tmp_path)
    other = stranger(tmp_path / "stranger", FEED_FORWARD, STRANGER.replace(f"legs {MINOR}", "legs 99.0"))
    with pytest.raises(AssertionError, match="is not compatible with the version requested"):
        run("cmake", "-S", other, "-B", other / "build", f"-DCMAKE_PREFIX_PATH={tmp_path / 'prefix'}", cwd=tmp_path)


def test_cmake_works_as_a_subdirectory_and_brings_no_tests_there(champion: Champion, tmp_path: Path) -> None:
    package("cmake")
    cmakelists = STRANGER.replace(f"find_package(legs {MINOR} REQUIRED)", "add_subdirectory(../legs legs)")
    other = stranger(tmp_path / "stranger", champion, cmakelists)
    run("cmake", "-S", other, "-B", other / "build", cwd=tmp_path)
    run("cmake", "--build", other / "build", cwd=tmp_path)
    assert not list((other / "build").rglob("legs_selftest*"))


ARDUINO_H = """
#pragma once
#include <stdint.h>
#include <stddef.h>
extern "C" { unsigned long millis(void); int analogRead(uint8_t pin); }
struct Print {
    size_t println(const char *text); size_t println(int value); size_t println(unsigned int value);
    size_t println(long value); size_t println(unsigned long value);
};
struct HardwareSerial : Print { void begin(unsigned long baud); };
extern HardwareSerial Serial;
void setup();
void loop();
"""
ARDUINO_CORE = """
#include "Arduino.h"
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
static unsigned long now;
extern "C" unsigned long millis(void) { return now += 7; }
static void put(char c) { while (!(UCSR0A & (1 << UDRE0))) { } UDR0 = (uint8_t)c; }
size_t Print::println(const char *text) { while (*text) put(*text++); put('\\n'); return 0; }
size_t Print::println(long value) { put('['); if (value < 0) put('-'); put(']'); put('\\n'); return 0; }
size_t Print::println(int value) { return println((long)value); }
size_t Print::println(unsigned int value) { return println((long)value); }
size_t Print::println(unsigned long value) { return println((long)value); }
void HardwareSerial::begin(unsigned long) { UCSR0B = 1 << TXEN0; }
HardwareSerial Serial;
int main() { setup(); for (int i = 0; i < 20; i++) loop(); Serial.println("done"); cli(); sleep_mode(); return 0; }
"""
CATEGORIES = (
    "Display|Communication|Signal Input/Output|Sensors|Device Control|Timing|Data Storage|Data Processing|Other"
).split("|")


@SENSORS
def test_the_arduino_sketch_compiles_by_the_cores_rules_and_runs(
    champion: Champion, options: tuple[str, ...], tmp_path: Path
) -> None:
    for tool in ("avr-g++", "simavr"):
        assert shutil.which(tool), f"{tool} is missing: run tools/install-debian-tools.sh"
    folder = package("arduino", *options)
    work = tmp_path / "sketch"
    work.mkdir()
    (work / "Arduino.h").write_text(ARDUINO_H)
    (work / "core.cpp").write_text(ARDUINO_CORE)
    # The builder puts this line before a sketch and compiles it as C++.
    sketch = (folder / "examples" / "legs" / "legs.ino").read_text()
    (work / "legs.ino.cpp").write_text(f"#include <Arduino.h>\n{sketch}")
    common = ["-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-Os", "-Wall", "-Wextra", "-Werror", "-flto"]
    common += ["-ffunction-sections", "-fdata-sections", f"-I{work}", f"-I{folder / 'src'}", "-c"]
    objects = []
    for source in [*sorted((folder / "src").glob("*.c")), work / "legs.ino.cpp", work / "core.cpp"]:
        objects.append(f"{source.name}.o")
        language = ["avr-gcc", "-std=gnu11", "-ffat-lto-objects"]
        if source.suffix == ".cpp":
            language = ["avr-g++", "-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics", "-fpermissive"]
        run(*language, *common, source, "-o", objects[-1], cwd=work)
    run("avr-gcc", "-Os", "-flto", "-Wl,--gc-sections", "-mmcu=atmega328p", *objects, "-o", "legs.elf", cwd=work)
    done = subprocess.run(
        ["simavr", "-m", "atmega328p", "-f", "16000000", "legs.elf"],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    said = done.stdout + done.stderr
    assert "wrong answer" not in said
    assert "done" in said
    assert said.count("[") >= 3


def test_library_properties_follow_the_specification(champion: Champion) -> None:
    folder = package("arduino", "--sensor", "map.toml")
    lines = (folder / "library.properties").read_text().splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    assert len(properties) == len(lines)
    required = {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"}
    assert required <= set(properties) <= required | {"includes", "license", "depends", "dot_a_linkage"}
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,62}", properties["name"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", properties["version"])
    assert properties["category"] in CATEGORIES
    assert properties["architectures"] == "*"
    for header in properties["includes"].split(","):
        assert (folder / "src" / header).is_file()


def test_without_ziglang_or_with_one_that_fails_no_size_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = Controller((Input(0, 9),), (Node((Link(0), Link(1, 1))),), (Signal(1),))
    code = generate(controller, "legs", "table", encoding="bytes")
    assert flash_bytes(code) > 20

    def refuse(one: object) -> int:
        raise CompilerError("zig: legs.c: failed: no memory")

    monkeypatch.setattr(view, "code_bytes", refuse)
    with pytest.raises(PackageError, match=r"^codegen --package: cannot measure the code: zig: .* no memory$"):
        flash_bytes(code)
    monkeypatch.setattr(view, "zig_compiler", lambda target: None)
    with pytest.raises(PackageError, match=r"^codegen --package: .* pip install ziglang$"):
        flash_bytes(code)


@pytest.mark.parametrize(
    ("environment", "begins"),
    [("Legs-v0", "A controller evolved on Legs-v0: 1 inputs,"), ("", "A controller: 1 inputs,")],
)
def test_the_description_says_where_it_was_evolved_if_that_is_known(environment: str, begins: str) -> None:
    controller = Controller((Input(0, 9),), (Node((Link(0), Link(1, 1))),), (Signal(1),))
    code = generate(controller, "legs", "table")
    made = Package("plain", code, "", controller, None, environment, guard=False, flash=100)
    assert made.description.startswith(begins)


def test_library_json_follows_platformios_schema(champion: Champion) -> None:
    folder = package("platformio", "--sensor", "map.toml")
    data = json.loads((folder / "library.json").read_text())
    types = {
        "name": str,
        "version": str,
        "description": str,
        "keywords": list,
        "license": str,
        "authors": list,
        "frameworks": str,
        "platforms": str,
        "headers": list,
        "examples": list,
        "build": dict,
    }
    assert {key: type(value) for key, value in data.items()} == types
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", data["name"])
    assert len(data["name"]) <= 50
    assert re.fullmatch(r"\d+\.\d+\.\d+", data["version"])
    assert len(data["description"]) <= 255
    assert all(re.fullmatch(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?", word) for word in data["keywords"])
    assert all(set(author) <= {"name", "email", "url", "maintainer"} for author in data["authors"])
    assert all((folder / "src" / header).is_file() for header in data["headers"])
    for example in data["examples"]:
        assert set(example) == {"name", "base", "files"}
        assert all((folder / example["base"] / name).is_file() for name in example["files"])
    assert set(data["build"]) == {"srcDir", "includeDir"}
    assert (folder / data["build"]["srcDir"] / "legs.c").is_file()


@SENSORS
def test_the_platformio_example_runs(champion: Champion, options: tuple[str, ...], tmp_path: Path) -> None:
    folder = package("platformio", *options)
    sources = [folder / "examples" / "legs" / "src" / "main.c", *sorted((folder / "src").glob("*.c"))]
    run("cc", "-std=c99", *STRICT, f"-I{folder / 'src'}", *sources, "-o", "example", cwd=tmp_path)
    assert "action[1] = " in run("./example", cwd=tmp_path)


def check_schema(value: object, schema: object, where: str = "module.yml") -> None:
    """A type, a list of one type, or a mapping of known keys."""
    if isinstance(schema, dict):
        assert isinstance(value, dict), where
        for key, entry in value.items():
            assert key in schema, f"{where}: unknown key {key}"
            check_schema(entry, schema[key], f"{where}.{key}")
    elif isinstance(schema, list):
        assert isinstance(value, list), where
        for entry in value:
            check_schema(entry, schema[0], where)
    else:
        assert type(value) is schema, f"{where}: {value!r}"


MODULE_SCHEMA = {
    "name": str,
    "build": {
        "cmake": str,
        "kconfig": str,
        "cmake-ext": bool,
        "kconfig-ext": bool,
        "sysbuild-cmake": str,
        "sysbuild-kconfig": str,
        "depends": [str],
        "settings": {f"{root}_root": str for root in ("board", "dts", "soc", "arch", "module_ext", "sca", "snippet")},
    },
    "tests": [str],
    "samples": [str],
    "boards": [str],
}
"""What Zephyr's build system knows of a module.yml that concerns sources; any other key is an error there."""


def test_module_yml_follows_zephyrs_schema_and_names_what_is_there(champion: Champion) -> None:
    folder = package("zephyr", "--sensor", "map.toml")
    module = yaml.safe_load((folder / "zephyr" / "module.yml").read_text())
    check_schema(module, MODULE_SCHEMA)
    assert module["name"] == "legs"
    assert (folder / module["build"]["cmake"] / "CMakeLists.txt").is_file()
    assert (folder / module["build"]["kconfig"]).is_file()
    assert all((folder / sample).is_dir() for sample in module["samples"])


def test_kconfig_defines_the_symbols_that_the_sample_sets(champion: Champion, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = package("zephyr")
    monkeypatch.setenv("srctree", str(folder))
    config = kconfiglib.Kconfig("zephyr/Kconfig", warn_to_stderr=False)
    assert set(config.syms) >= {"BITNEAT_LEGS", "BITNEAT_LEGS_SELFTEST"}
    assert config.syms["BITNEAT_LEGS"].str_value == "n"
    config.load_config(str(folder / "samples" / "legs" / "prj.conf"))
    assert [config.syms[name].str_value for name in ("BITNEAT_LEGS", "BITNEAT_LEGS_SELFTEST")] == ["y", "y"]
    assert config.warnings == []


ZEPHYR_APPLICATION = """
cmake_minimum_required(VERSION 3.21)
project(application LANGUAGES C)
macro(zephyr_library_named name)
  set(ZEPHYR_CURRENT_LIBRARY ${name})
  add_library(${name} STATIC)
  target_link_libraries(app PRIVATE ${name})
endmacro()
function(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()
function(zephyr_library_sources_ifdef option)
  if(${option})
    target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
  endif()
endfunction()
function(zephyr_include_directories)
  include_directories(${ARGN})
  foreach(folder ${ARGN})
    get_filename_component(full ${folder} ABSOLUTE BASE_DIR ${CMAKE_CURRENT_SOURCE_DIR})
    target_include_directories(app PRIVATE ${full})
  endforeach()
endfunction()
add_executable(app ../legs/samples/legs/src/main.c)
target_include_directories(app PRIVATE include)
target_compile_options(app PRIVATE -Wall -Wextra -Werror)
file(STRINGS ../legs/samples/legs/prj.conf settings REGEX "^CONFIG_")
foreach(setting ${settings})
  string(REGEX MATCH "^(CONFIG_[A-Z_0-9]+)=y$" matched ${setting})
  set(${CMAKE_MATCH_1} y)
endforeach()
add_subdirectory(../legs/zephyr module)
"""


@SENSORS
def test_the_zephyr_module_and_its_sample_build_and_run(
    champion: Champion, options: tuple[str, ...], tmp_path: Path
) -> None:
    """With the few commands of Zephyr's build system that the module uses, as documented there."""
    package("zephyr", *options)
    application = tmp_path / "application"
    (application / "include" / "zephyr" / "sys").mkdir(parents=True)
    (application / "include" / "zephyr" / "kernel.h").write_text(
        "#include <stdint.h>\n#include <stdlib.h>\n"
        "static int steps;\nstatic inline int32_t k_msleep(int32_t ms) { if (++steps == 3) exit(0); return ms * 0; }\n"
    )
    (application / "include" / "zephyr" / "sys" / "printk.h").write_text("#include <stdio.h>\n#define printk printf\n")
    (application / "CMakeLists.txt").write_text(ZEPHYR_APPLICATION)
    run("cmake", "-S", application, "-B", application / "build", cwd=tmp_path)
    run("cmake", "--build", application / "build", cwd=tmp_path)
    assert run(application / "build" / "app", cwd=tmp_path).count("action[0] = ") == 3
