# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.verify.cfile import CFile
from bitneat.verify.machine import examine
from bitneat.verify.targets import select
from bitneat.verify.wasm import MAGIC, read_wasm
from bitneat.verify.wasm import violations as violations_of
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


# Files byte by byte, after the specification's binary format --------------------------------------------------------


def section(kind: int, content: bytes) -> bytes:
    assert len(content) < 128
    return bytes([kind, len(content)]) + content


def name(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


def module_of(body: str) -> bytes:
    """One function with two locals of a kind, whose instructions are given in hexadecimal."""
    function = bytes.fromhex("01027f") + bytes.fromhex(body)
    return MAGIC + section(10, bytes([1, len(function)]) + function)


INSTRUCTIONS = [
    "00",  # unreachable
    "01",  # nop
    "0240",  # block without a result
    "0340",  # loop
    "0440",  # if
    "05",  # else
    "0c00",  # br
    "0d00",  # br_if
    "1000",  # call
    "3f00",  # memory.size
    "4000",  # memory.grow
    "420a",  # i64.const
    "d200",  # ref.func
    "0e02000100",  # br_table of two labels and a default
    "110000",  # call_indirect
    "1c017f",  # select with a type
    "2000",  # local.get
    "280204",  # i32.load
    "41808001",  # i32.const in three bytes
    "430000803f",  # f32.const
    "44000000000000f03f",  # f64.const
    "fc00",  # i32.trunc_sat_f32_s
    "fc080100",  # memory.init
    "fc0901",  # data.drop
    "fc0a0000",  # memory.copy
    "fc0b00",  # memory.fill
    "fc0c0100",  # table.init
    "fc0d01",  # elem.drop
    "fc0e0001",  # table.copy
    "fc0f01",  # table.grow
    "fc1001",  # table.size
    "fc1101",  # table.fill
    "6c",  # i32.mul
    "0b",  # end
]


def test_every_instruction_is_found_behind_those_before_it() -> None:
    wasm = read_wasm(module_of("".join(INSTRUCTIONS)))
    (function,) = wasm.functions
    sizes = [len(one) // 2 for one in INSTRUCTIONS]
    start = len(MAGIC) + 2 + 2 + 3
    assert [one.offset for one in function] == [start + sum(sizes[:i]) for i in range(len(sizes))]
    assert [one.code for one in function] == [int(one[:2], 16) for one in INSTRUCTIONS]
    assert wasm.code_bytes == 3 + sum(sizes)
    assert [found.split(": ")[1] for found in violations_of(wasm, straight=True)] == [
        "if is a conditional branch",
        "br_if is a conditional branch",
        "br_table is a conditional branch",
        "mul is a multiplication or division",
    ]
    assert len(violations_of(wasm, straight=False)) == 1


@pytest.mark.parametrize("body", ["c5", "fd00", "1d"])
def test_an_unknown_instruction_is_refused_by_its_place(body: str) -> None:
    with pytest.raises(BitneatError, match=f"unknown instruction 0x{body[:2]} at 0x10"):
        read_wasm(module_of("01" + body + "0b"))


@pytest.mark.parametrize("body", ["20", "4180", "0e02", "fc0a00"])
def test_a_function_that_ends_too_early_is_refused(body: str) -> None:
    with pytest.raises(BitneatError, match="ends too early"):
        read_wasm(module_of(body))


def test_functions_are_needed_and_memory_is_not() -> None:
    origin = name("env")
    imports = [
        origin + name("table") + b"\x01\x70\x01\x01\x05",  # of 1 to 5 function references
        origin + name("first") + b"\x00\x02",
        origin + name("memory") + b"\x02\x00\x01",
        origin + name("stack") + b"\x03\x7f\x01",
        origin + name("second") + b"\x00\x00",
    ]
    exports = [name("memory") + b"\x02\x00", name("legs_step") + b"\x00\x02"]
    content = MAGIC + section(2, bytes([len(imports)]) + b"".join(imports))
    wasm = read_wasm(content + section(7, bytes([len(exports)]) + b"".join(exports)))
    assert wasm.imports == ("first", "second")
    assert (wasm.first_function, wasm.exports) == (2, {"legs_step": 2})
    assert violations_of(wasm, straight=True) == [
        f"needs {one} from elsewhere, expected to need nothing" for one in ("first", "second")
    ]
    with pytest.raises(BitneatError, match="import of unknown kind 4"):
        read_wasm(MAGIC + section(2, b"\x01" + origin + name("tag") + b"\x04\x00\x00"))


def test_data_and_functions_that_run_by_themselves_are_found() -> None:
    data = [
        bytes.fromhex("0041000b") + b"\x03abc",  # at 0
        b"\x01\x02de",  # passive
        bytes.fromhex("02002300 41046a0b") + b"\x01f",  # of memory 0, at a global plus 4
    ]
    segments = b"\x02" + name(".rodata.table") + b"\x00\x00" + name(".bss.calls") + b"\x01\x00"
    starters = b"\x01\x00\x00"
    linking = name("linking") + b"\x02" + section(5, segments) + section(8, b"\x00") + section(6, starters)
    content = MAGIC + section(11, bytes([len(data)]) + b"".join(data))
    wasm = read_wasm(content + section(0, name("producers")) + section(0, linking))
    assert wasm.segments == ((".rodata.table", 3), (".bss.calls", 2), (".data", 1))
    assert violations_of(wasm, straight=True) == [
        "2 bytes of static data in .bss.calls, expected none",
        "1 bytes of static data in .data, expected none",
        "1 functions run by themselves, expected none",
    ]
