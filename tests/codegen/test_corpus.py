# SPDX-License-Identifier: MIT
"""The corpus of parity, part by part: each kind of controller in every style and encoding, without a warning, bit for bit.

What the mutants of C are judged by all at once, in a second's pieces: a fault in one kind fails one test.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from bitneat.native.data import runtime_dir
from tests.compiled import WARNINGS
from tests.mutation import parity
from tests.mutation.corpus import subjects

PARTS = 16
COMPILE = ("gcc", "-std=c99", *WARNINGS, *(f"-I{runtime_dir() / name}" for name in ("include", "src")))


def compiled(source: Path, text: str) -> Path:
    """The object of a source, which must not give a warning."""
    source.write_text(text)
    target = source.with_suffix(".o")
    done = subprocess.run([*COMPILE, "-c", source, "-o", target], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return target


@pytest.fixture(scope="module")
def runtime(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The runtime of the checkout, with the interpreter that the templates print now."""
    folder = tmp_path_factory.mktemp("runtime")
    sources = {name: (runtime_dir() / "src" / f"{name}.c").read_text() for name in parity.RUNTIME_SOURCES}
    sources["interpreter"] = parity.runtime_source()
    return [compiled(folder / f"{name}.c", text) for name, text in sources.items()]


@pytest.mark.parametrize("part", range(PARTS))
def test_every_kind_gives_the_reference_answers_without_a_warning(
    tmp_path: Path, runtime: list[Path], part: int
) -> None:
    found = subjects()[part::PARTS]
    parity.write_data(found, tmp_path / "data")
    main = compiled(tmp_path / "main.c", parity.generated_source(found, parity.instances(found)))
    subprocess.run(["gcc", main, *runtime, "-o", tmp_path / "main"], check=True)
    done = subprocess.run([tmp_path / "main", tmp_path / "data"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
