# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.verify.cfile import CFile
from bitneat.verify.machine import examine
from bitneat.verify.targets import select
from bitneat.verify.wasm import read_wasm
from tests.verify.champions import plain_champion, written


def violations(line: str, folder: Path) -> tuple[str, ...]:
    code = written(plain_champion(), folder)
    code.path.write_text(code.source.replace("    action[0]", f"    {line}\n    action[0]", 1))
    (ready,) = select(["wasm32"])
    return examine(CFile.read(code.path), ready.toolchain).violations


def test_generated_code_keeps_its_promises(tmp_path: Path) -> None:
    assert violations("", tmp_path) == ()


@pytest.mark.parametrize(
    ("line", "violation"),
    [
        ("static int16_t calls; calls++; if (calls > 9) return;", "bytes of static data in .bss"),
        ("extern int16_t elsewhere(void); (void)elsewhere();", "needs elsewhere from elsewhere"),
        (
            "volatile int32_t product = observation[0]; product = product * observation[1];",
            "mul is a multiplication or division",
        ),
        ("volatile int32_t product = observation[0]; product = product / 7;", "is a multiplication or division"),
        ("if (observation[0] > 3) { volatile int stop = 1; (void)stop; }", "is a conditional branch"),
    ],
)
def test_what_breaks_them_is_found(line: str, violation: str, tmp_path: Path) -> None:
    assert any(violation in found for found in violations(line, tmp_path))


@pytest.mark.parametrize("content", [b"", b"\x7fELF", b"\0asm\2\0\0\0"])
def test_anything_else_is_refused(content: bytes) -> None:
    with pytest.raises(BitneatError, match="not a WebAssembly file"):
        read_wasm(content)
