# SPDX-License-Identifier: MIT
"""The firmware examples: what their pages show is run, and a firmware that computes something else is noticed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bitneat import champion as champions
from bitneat.controller import Reference

EXAMPLES = Path(__file__).parents[1] / "examples"
TOOLS = {
    "firmware-cortex-m0": ("make", "arm-none-eabi-gcc", "qemu-system-arm"),
    "firmware-atmega328p": ("make", "avr-gcc", "cc"),
}
FILES = {"firmware-cortex-m0": (), "firmware-atmega328p": ("/usr/include/simavr/sim_avr.h", "/usr/include/libelf.h")}
EACH = pytest.mark.parametrize("example", TOOLS)


@pytest.fixture
def examples(tmp_path: Path) -> Path:
    """A copy, so that nothing is built in the checkout."""
    ours = shutil.ignore_patterns("build", "walker*")
    for name in ("champions", "firmware-common", *TOOLS):
        shutil.copytree(EXAMPLES / name, tmp_path / name, ignore=ours)
    return tmp_path


def require(example: str) -> None:
    missing = [tool for tool in TOOLS[example] if shutil.which(tool) is None]
    missing += [name for name in FILES[example] if not Path(name).exists()]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not there; tools/install-debian-tools.sh installs what it takes")


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a line of a page, with bitneat and python of the environment that runs the tests."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        ["sh", "-c", command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PATH": path},
    )


@EACH
def test_the_page_of_an_example_runs_and_prints_what_it_says(example: str, examples: Path) -> None:
    require(example)
    page = (examples / example / "README.md").read_text()
    blocks = re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    commands = "".join(blocks).splitlines()
    assert commands[-1] == "make run"
    for command in commands:
        done = shell(command, examples / example)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    promised = re.search(r"^ {4}(\d+ steps, .*)$", page, re.MULTILINE)
    assert promised is not None
    assert promised[1] in done.stdout.splitlines()


@EACH
def test_one_wrong_bit_is_noticed_by_the_selftest(example: str, examples: Path) -> None:
    require(example)
    folder = examples / example
    assert shell("make", folder).returncode == 0
    plant(folder / "build" / "tiny.c")
    done = shell("make run", folder)
    assert done.returncode != 0
    assert "expected 'tiny ready' after the start, got 'self-test failed'" in done.stderr


@EACH
def test_one_wrong_bit_is_noticed_by_the_walk(example: str, examples: Path) -> None:
    require(example)
    folder = examples / example
    assert shell("make", folder).returncode == 0
    plant(folder / "build" / "tiny.c")
    (folder / "build" / "tiny_selftest.c").write_text(
        "int tiny_selftest(void);\nint tiny_selftest(void) { return 0; }\n"
    )
    done = shell("make run", folder)
    assert done.returncode != 0
    found = re.search(r"^403 steps, (\d+) with another answer", done.stdout, re.MULTILINE)
    assert found is not None
    assert 0 < int(found[1]) < 403


def plant(source: Path) -> None:
    """Flip the lowest bit of the last action where the first observation is positive."""
    text = source.read_text()
    assert "\nvoid tiny_step(" in text
    source.write_text(
        text.replace("\nvoid tiny_step(", "\nstatic void honest_step(")
        + "\nvoid tiny_step(const int16_t observation[TINY_NUM_INPUTS], int16_t action[TINY_NUM_OUTPUTS])\n"
        "{\n    honest_step(observation, action);\n"
        "    action[3] = (int16_t)(action[3] ^ (observation[0] > 0));\n}\n"
    )


@EACH
def test_a_garbled_frame_is_answered_by_a_question_mark_and_forgotten(example: str, examples: Path) -> None:
    require(example)
    folder = examples / example
    recorded = (examples / "firmware-common" / "trace.txt").read_text().splitlines()[3]
    observation = recorded.split(" ")[0]
    garbled = [observation[:-1], observation + "0", observation.replace("0", "x", 1), "", "00 00"]
    lines = [f"{frame} ?" for frame in garbled]
    # The walk takes any text for frames here, so that it can send what is none.
    walk = examples / "firmware-common" / "walk.py"
    walk.write_text(walk.read_text().replace('r"((?:[0-9a-f]{4})+) ((?:[0-9a-f]{4})+)"', 'r"(.*) (\\S+)"'))
    (examples / "firmware-common" / "trace.txt").write_text("\n".join([*lines, recorded, *lines, recorded]) + "\n")
    done = shell("make run", folder)
    assert "12 steps, 0 with another answer" in done.stdout, done.stdout + done.stderr


def test_the_trace_is_the_champions_own() -> None:
    champion = champions.load(EXAMPLES / "champions" / "tiny.pkl")
    reference = Reference(champion.controller)
    rows = (EXAMPLES / "firmware-common" / "trace.txt").read_text().splitlines()
    actions = set()
    for row in rows:
        observation, action = (
            [int.from_bytes(bytes.fromhex(frame[i : i + 4]), "big", signed=True) for i in range(0, len(frame), 4)]
            for frame in row.split(" ")
        )
        assert reference.step(observation) == action
        actions.add(tuple(action))
    assert len(rows) == 403
    assert len(actions) > 100
