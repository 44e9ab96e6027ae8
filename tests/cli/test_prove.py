# SPDX-License-Identifier: MIT
"""`bitneat prove`: what it says, keeps and refuses."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.champion import load
from bitneat.cli.main import main
from bitneat.controller import Reference
from bitneat.prove import check
from tests.prove.proving import CHAMPIONS, CHIP


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(check, "cache_dir", lambda: tmp_path / "cache")
    shutil.copy(CHAMPIONS / "tiny.pkl", "champion.pkl")
    assert main(["codegen", "champion.pkl", "-o", "walker.c", "--style", "unrolled"]) == 0
    return tmp_path


ONE = ["prove", "--targets", "cortex-m4", "--optimize", "2", "--style", "own", "--json", "proof.json"]


def test_the_command_proves_and_keeps_what_it_proved(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(ONE) == 0
    assert "PROVED: 1 of 1 binaries" in capsys.readouterr().out
    data = json.loads((folder / "proof.json").read_text())
    assert data["verdict"] == "pass"
    assert data["controller"]["sha256"] == load(folder / "champion.pkl").controller.sha256
    (pair,) = data["pairs"]
    assert (pair["target"], pair["optimization"], pair["style"], pair["cached"]) == (
        "cortex-m4",
        "-O2",
        "unrolled",
        False,
    )
    assert main(ONE) == 0
    assert json.loads((folder / "proof.json").read_text())["pairs"][0]["cached"]
    for path in (folder / "cache" / "proofs").iterdir():
        path.write_text(path.read_text().replace("proved", "prov3d"))
    assert main(ONE) == 0
    assert not json.loads((folder / "proof.json").read_text())["pairs"][0]["cached"]


def test_an_edited_file_is_refused_with_inputs_that_show_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(ONE) == 0
    path = folder / "walker.c"
    text, edits = re.subn(r"\b256U", "255U", path.read_text(), count=1)
    assert edits == 1
    path.write_text(text)
    assert main(ONE) == 1
    printed = capsys.readouterr().out
    assert "NOT PROVED: 0 of 1 binaries" in printed
    assert "inputs   " in printed
    data = json.loads((folder / "proof.json").read_text())
    assert data["verdict"] == "fail"
    found = data["pairs"][0]["functions"][0]["counterexample"]
    assert Reference(load(folder / "champion.pkl").controller).step(found["sequence"][-1]) == found["expected"]
    assert found["found"] != found["expected"]


def test_a_given_object_is_proved_or_refused(folder: Path) -> None:
    chip = CHIP["cortex-m0"]
    toolchain = chip.toolchain()
    assert toolchain is not None
    compiler, flags = toolchain.compiler.command, [*toolchain.flags, "-std=c99", "-O2", "-ffreestanding", "-c"]
    given = [*ONE[:1], "--targets", "cortex-m0", "--object", "walker.o", "--c", "walker.c"]
    subprocess.run([*compiler, *flags, "walker.c", "-o", "walker.o"], check=True)
    assert main(given) == 0
    (folder / "wrong").mkdir()
    shutil.copy(folder / "walker.h", folder / "wrong")
    (folder / "wrong" / "walker.c").write_text((folder / "walker.c").read_text().replace("sum0 += ", "sum0 -= ", 1))
    subprocess.run([*compiler, *flags, "wrong/walker.c", "-o", "walker.o"], check=True)
    assert main(given) == 1


def test_what_is_named_twice_is_proved_once(folder: Path) -> None:
    twice = ["--targets", "cortex-m0,cortex-m0", "--optimize", "s,-Os, s", "--style", "own", "--json", "proof.json"]
    assert main(["prove", *twice]) == 0
    assert len(json.loads((folder / "proof.json").read_text())["pairs"]) == 1


GIVEN = ["prove", "--c", "walker.c", "--object", "walker.o", "--no-cache"]


def _compile(cpu: str) -> None:
    gcc = shutil.which("arm-none-eabi-gcc")
    if gcc is None:
        pytest.skip("needs arm-none-eabi-gcc")
    subprocess.run([gcc, f"-mcpu={cpu}", "-mthumb", "-Os", "-c", "walker.c", "-o", "walker.o"], check=True)


@pytest.mark.parametrize(
    ("cpu", "target", "architecture"),
    [("cortex-m4", "cortex-m0", "v7E-M"), ("cortex-m3", "cortex-m0", "v7-M"), ("cortex-m4", "cortex-m3", "v7E-M")],
)
def test_an_object_for_a_larger_processor_is_refused(
    cpu: str, target: str, architecture: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _compile(cpu)
    assert main([*GIVEN, "--targets", target]) == 2
    error = capsys.readouterr().err
    assert f"walker.o: was compiled for ARM{architecture}, expected ARMv6-M or" in error
    assert error.count("\n") == 1


def test_an_object_for_a_smaller_processor_is_proved_and_no_compiler_is_claimed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _compile("cortex-m0")
    assert main([*GIVEN, "--targets", "cortex-m4", "--json", "proof.json"]) == 0
    assert json.loads((folder / "proof.json").read_text())["pairs"][0]["compiler"] == "given"
    assert "gcc" not in capsys.readouterr().out


def test_an_object_that_does_not_say_for_what_it_is_or_lies_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    objcopy = shutil.which("arm-none-eabi-objcopy")
    if objcopy is None:
        pytest.skip("needs arm-none-eabi-objcopy")
    _compile("cortex-m0")
    subprocess.run([objcopy, "--dump-section", ".ARM.attributes=m0", "walker.o"], check=True)
    _compile("cortex-m4")
    subprocess.run([objcopy, "--remove-section", ".ARM.attributes", "walker.o", "stripped.o"], check=True)
    subprocess.run([objcopy, "--update-section", ".ARM.attributes=m0", "walker.o"], check=True)
    shutil.copy("stripped.o", "other.o")
    assert main([*GIVEN[:3], "--object", "other.o", "--targets", "cortex-m0"]) == 2
    assert "other.o: does not say for which ARM it was compiled, expected ARMv6-M" in capsys.readouterr().err
    assert main([*GIVEN, "--targets", "cortex-m0"]) == 1
    assert "beyond the instructions of ARMv6-M" in capsys.readouterr().out


def test_an_object_for_a_newer_x86_64_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toolchain = CHIP["x86-64"].toolchain()
    assert toolchain is not None
    if toolchain.compiler.family != "gcc":
        pytest.skip("needs gcc for x86-64")
    assert main(["codegen", str(CHAMPIONS / "walker.pkl"), "-o", "walker.c", "--style", "unrolled"]) == 0
    for flag, status in (("-mtune=haswell", 0), ("-march=haswell", 1)):
        flags = [*toolchain.flags, "-std=c99", "-O2", "-ffreestanding", "-fno-stack-protector", flag, "-c"]
        subprocess.run([*toolchain.compiler.command, *flags, "walker.c", "-o", "walker.o"], check=True)
        assert main(["prove", str(CHAMPIONS / "walker.pkl"), *GIVEN[1:], "--targets", "x86-64"]) == status
    assert "beyond the instructions of every x86-64" in capsys.readouterr().out


def test_an_object_of_another_machine_and_what_is_none_are_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _compile("cortex-m0")
    assert main([*GIVEN, "--targets", "x86-64"]) == 2
    assert "walker.o: is for ARM, 32 bits, little-endian; expected X86_64, 64 bits" in capsys.readouterr().err
    whole = Path("walker.o").read_bytes()
    for content, message in (
        (Path("champion.pkl").read_bytes(), "walker.o: not an ELF file, expected an object"),
        (whole[:40], "walker.o: a damaged ELF file"),
        (whole[:16] + b"\x02" + whole[17:], "walker.o: is linked already"),
        (whole.replace(b"walker_step\0", b"walker_stop\0"), "walker.o: "),
    ):
        Path("walker.o").write_bytes(content)
        assert main([*GIVEN, "--targets", "cortex-m0"]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--targets", "avr"], "--targets: avr is none of"),
        (["--targets", ""], "argument --targets: expected a value, got an empty one"),
        (["--targets", " , "], "--targets: names no target, expected some of x86-64, cortex-m0, cortex-m3, cortex-m4"),
        (["--optimize", "9"], "--optimize: '9' is none of"),
        (["--object", "walker.o"], "name the one target"),
        (["--object", "none.o", "--targets", "cortex-m0"], "none.o"),
        (["missing.pkl"], "missing.pkl"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["prove", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_missing_package_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(check, "find_spec", lambda name: None if name == "bitwuzla" else name)
    assert main(["prove"]) == 2
    assert "prove needs bitwuzla: pip install 'bitneat[prove]'" in capsys.readouterr().err
