# SPDX-License-Identifier: MIT
"""``bitneat doctor`` says what is there, what is missing and how to get it, and notices what does not work."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bitneat.cli.main import main
from bitneat.codegen import GeneratedC
from bitneat.controller import ACTIVATION_NAMES
from bitneat.doctor import Finding, findings, installed, selftest, tools
from bitneat.native import compiler
from bitneat.verify.targets import TARGETS, chip, simavr_emulator

ROOT = Path(__file__).resolve().parents[2]


def by_name(found: list[Finding]) -> dict[str, Finding]:
    return {one.name: one for one in found}


@pytest.fixture
def no_programs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine on whose PATH there is nothing."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)


@pytest.fixture
def no_zig(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (compiler, chip, tools):
        monkeypatch.setattr(module, "zig_compiler", lambda target=None: None)


def test_here_everything_that_the_main_commands_need_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", "--json", str(tmp_path / "doctor.json")]) == 0
    out = capsys.readouterr().out
    assert out.endswith("\nevolve, codegen and verify can work here\n")
    data = json.loads((tmp_path / "doctor.json").read_text())
    assert data["verdict"] == "pass"
    names = {(one["section"], one["name"]): one for one in data["findings"]}
    assert all(one["state"] == "found" for one in data["findings"] if one["required"])
    assert {name for section, name in names if section == "targets"} == set(TARGETS)
    for target in TARGETS:
        if names["targets", target]["state"] == "found":
            assert names["self-test", f"C on {target}"]["detail"].endswith("0 differing bits")
    assert names["self-test", "walker against Gymnasium"]["detail"].endswith("steps, 0 differing bits")
    for finding in data["findings"]:
        assert finding["state"] == "found" or finding["remedy"], finding
        assert finding["name"] in out


def test_without_programs_ziglang_serves_and_each_missing_one_is_named_with_its_package(no_programs: None) -> None:
    found = by_name(list(findings(trials=False)))
    assert not any(one.blocks for one in found.values())
    assert found["host C compiler"].detail.startswith("clang")
    packages = {
        "arm-none-eabi-gcc": "gcc-arm-none-eabi",
        "avr-gcc": "gcc-avr avr-libc",
        "riscv64-unknown-elf-gcc": "gcc-riscv64-unknown-elf",
        "clang": "clang",
        "qemu-system-arm": "qemu-system-arm",
    }
    for name, package in packages.items():
        assert (found[name].state, found[name].remedy) == ("missing", f"apt install {package}")


def test_without_any_compiler_nothing_can_work(
    no_programs: None, no_zig: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert re.search(r"\n  !  host C compiler +missing; no C compiler found; install one", out)
    assert re.search(r"\n  -  ziglang +missing; .*pip install ziglang\n", out)
    assert out.splitlines()[-1].startswith("not everything can work here: see host C compiler")
    assert "Traceback" not in out


def test_a_compiler_that_was_named_and_does_not_work_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "/nonexistent/cc")
    assert main(["doctor", "--no-trials"]) == 1
    assert "CC=/nonexistent/cc: not a working C compiler" in capsys.readouterr().out


def test_a_missing_emulator_costs_its_target_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simavr_emulator.ctypes.util, "find_library", lambda name: None)
    found = by_name(list(findings(trials=False)))
    assert found["avr"].state == "missing"
    assert "libsimavr-dev" in found["avr"].remedy
    assert found["simavr (library)"].remedy == "apt install libsimavr-dev"
    assert not any(one.blocks for one in found.values())


def test_a_missing_package_is_named_and_nothing_that_needs_it_is_tried(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = installed.installed_version
    monkeypatch.setattr(installed, "installed_version", lambda name: None if name == "numpy" else real(name))
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "!  packages  missing; numpy; needed for everything: pip install numpy" in out
    assert "compilers:" not in out


def test_missing_packages_can_be_named_without_importing_any(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from bitneat.doctor import installed\n"
        "installed.packages(), installed.extras()\n"
        "print(' '.join(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "cffi", "jinja2", "gymnasium"} & set(done.stdout.split())


def test_requirements_are_read_as_pyproject_states_them(monkeypatch: pytest.MonkeyPatch) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    stated = list(project["dependencies"])
    for extra, lines in project["optional-dependencies"].items():
        stated += [f"{line}; extra == '{extra}'" for line in lines]
    monkeypatch.setattr(installed, "requires", lambda name: stated)
    monkeypatch.setattr(installed, "installed_version", lambda name: None)
    missing = installed.packages()[0].detail.split(", ")
    assert {"neat-python", "gymnasium", "numpy", "wasmtime"} <= set(missing)
    assert len(missing) == len(project["dependencies"])
    named = by_name(installed.extras())
    assert set(named) == set(project["optional-dependencies"]) - {"test", "dev"}
    assert set(named) == set(installed._EXTRAS)
    monkeypatch.setattr(installed, "requires", lambda name: ["x; extra == 'new'"])
    assert installed.extras()[0].enables == "what bitneat[new] is for"
    assert named["plot"].remedy == "pip install 'bitneat[plot]'"


def test_the_controller_of_the_selftest_has_every_activation_and_a_memory() -> None:
    canonical = selftest.tiny().canonical
    assert {node.activation for node in canonical.nodes} == set(ACTIVATION_NAMES)
    assert canonical.is_recurrent


def test_c_that_computes_something_else_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    real = selftest.generate

    def wrong(*arguments: Any, **options: Any) -> GeneratedC:
        code = real(*arguments, **options)
        return replace(code, source=re.sub(r"(?<!SHA-)\b256\b", "255", code.source))

    monkeypatch.setattr(selftest, "generate", wrong)
    monkeypatch.setattr(selftest, "_ready", lambda: selftest.select(["host-unrolled"]))
    found = by_name(selftest.selftest())
    assert found["C on host-unrolled"].blocks
    assert "outputs differ" in found["C on host-unrolled"].detail
    assert not found["C runtime"].blocks


def test_another_walker_than_gymnasiums_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    from bitneat.sim import WalkerVectorEnv

    real = WalkerVectorEnv.step

    def step(envs: WalkerVectorEnv, actions: Any) -> Any:
        observations, *rest = real(envs, actions)
        observations[0, 3] = np.nextafter(observations[0, 3], np.float32(9))
        return observations, *rest

    monkeypatch.setattr(WalkerVectorEnv, "step", step)
    monkeypatch.setattr(selftest, "_ready", list)
    finding = by_name(selftest.selftest())["walker against Gymnasium"]
    assert finding.blocks
    assert finding.detail == "seed 0, step 1: the observations differ"
    assert "--simulator gymnasium" in finding.remedy


def test_sines_of_another_kind_are_slower_and_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    from bitneat.sim.walker import binding

    class Other:
        def simulator_open(self) -> bool:
            return False

        def trig_probe(self) -> int:
            return 0xABC

    monkeypatch.setattr(binding, "library", Other)
    finding = selftest._trial("trigonometry", selftest._trigonometry, "speed", "nothing")
    assert (finding.state, finding.blocks) == ("failed", False)
    assert finding.detail.startswith("the C library's sines are not those of the formula")


def test_on_a_terminal_it_is_a_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(installed, "installed_version", lambda name: None if name == "envpool" else "1")
    assert main(["doctor", "--no-trials"]) == 0
    out = capsys.readouterr().out
    assert "host C compiler" in out
    assert "│" in out
    assert "pip install 'bitneat[" in out
