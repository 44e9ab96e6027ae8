# SPDX-License-Identifier: MIT
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.errors import BitneatError
from bitneat.verify.instructions import AVR, I386, POWERPC, RISCV, THUMB, X86_64, InstructionSet

EVERY = (THUMB, RISCV, X86_64, I386, POWERPC, AVR)

# Encodings from the processors' manuals.
CASES = [
    (THUMB, "4843", "d1d1", "c046"),  # muls r0, r1; bne; nop
    (RISCV, "3305b502", "63060500", "13000000"),  # mul a0, a0, a1; beqz a0; nop
    (RISCV, "3345b502", "11c1", "0100"),  # div; c.beqz; c.nop
    (X86_64, "0fafc1", "7502", "90"),  # imul eax, ecx; jne; nop
    (I386, "f7f9", "7402", "90"),  # idiv ecx; je; nop
    (POWERPC, "7c6321d6", "41820008", "60000000"),  # mullw; beq; nop
    (AVR, "029f", "09f4", "0000"),  # mul r16, r18; brne; nop
    (AVR, "0202", "10fd", "0000"),  # muls r16, r18; sbrc; nop
]


@pytest.mark.parametrize(("instructions", "product", "branch", "nop"), CASES)
def test_multiplications_and_conditional_branches_are_told_from_the_rest(
    instructions: InstructionSet, product: str, branch: str, nop: str
) -> None:
    code = instructions.decode_all(bytes.fromhex(product + branch + nop), 0, "text")
    assert [instructions.is_multiplication(one) for one in code] == [True, False, False]
    assert instructions.conditional_branches(code) == [code[1]]


@pytest.mark.parametrize("instructions", EVERY)
def test_what_does_nothing_is_one_instruction_or_several(instructions: InstructionSet) -> None:
    for nop in instructions.nops:
        nothing = instructions.nothing(2 * len(nop))
        assert nothing is not None
        assert len(nothing) == 2 * len(nop)
        assert sum(one.size for one in instructions.decode_all(nothing, 0, "text")) == 2 * len(nop)


@pytest.mark.parametrize("instructions", EVERY)
def test_nothing_is_not_half_an_instruction(instructions: InstructionSet) -> None:
    smallest = min(map(len, instructions.nops))
    assert (instructions.nothing(smallest + 1) is None) == (smallest > 1)


@pytest.mark.parametrize(
    ("instructions", "code"),
    [(THUMB, "00bf00f0"), (RISCV, "0100ffff"), (X86_64, "9048"), (POWERPC, "6000000000"), (AVR, "00000e94")],
)
def test_code_that_ends_within_an_instruction_is_refused(instructions: InstructionSet, code: str) -> None:
    with pytest.raises(BitneatError, match=r"text\+0x\w+: cannot disassemble"):
        instructions.decode_all(bytes.fromhex(code), 0, "text")


@pytest.mark.parametrize(
    ("code", "branches"),
    [
        ("34e0b695a79597958795 3a95d1f7", 0),  # ldi r19, 4; lsr, ror, ror, ror; dec r19; brne
        ("24e0b695a79597958795 3a95d1f7", 1),  # the constant is in another register
        ("342fb695a79597958795 3a95d1f7", 1),  # the count comes from a register
        ("34e0b695a79597958795 3a95d9f3", 1),  # the branch is on another flag
        ("b695a79597958795 3a95d1f7", 1),  # nothing sets the count
        ("34e0b695 3a95d1f7", 0),  # one byte is shifted
        ("34e0b695a79597958795b695 3a95d1f7", 1),  # more than four shifts are something else
        ("3a95d1f7", 1),
        ("d1f7", 1),
    ],
)
def test_on_avr_a_shift_by_a_constant_is_no_conditional_branch(code: str, branches: int) -> None:
    found = AVR.conditional_branches(AVR.decode_all(bytes.fromhex(code), 0, "text"))
    assert len(found) == branches


def test_the_sums_that_were_executed_are_found_once_each() -> None:
    code = bytes.fromhex("4018 0020 401a 4018")  # adds r0, r0, r1; movs r0, #0; subs r0, r0, r1; adds, not reached
    found = THUMB.executed_sums(code, 0x100, (0x100, 0x102, 0x104, 0x100))
    assert [(one.mnemonic, one.address, len(nothing)) for one, nothing in found] == [
        ("adds", 0x100, 2),
        ("subs", 0x104, 2),
    ]


_AVR_GROUPS = {
    "lsl": "add",
    "rol": "adc",
    "ser": "ldi",
    **dict.fromkeys(("fmul", "fmuls", "fmulsu"), "mulsu"),
    **dict.fromkeys(("asr", "lsr", "ror"), "shift"),
    **dict.fromkeys(("sbrc", "sbrs"), "sbrx"),
    **dict.fromkeys(("sbic", "sbis"), "sbix"),
}
_AVR_NAMES = {
    "mul",
    "muls",
    "mulsu",
    "brne",
    "cpse",
    "add",
    "adc",
    "sub",
    "sbc",
    "ldi",
    "dec",
    "lds",
    "sts",
    "jmp",
    "call",
}


def test_every_word_of_avr_is_what_binutils_says_that_it_is(tmp_path: Path) -> None:
    objdump = shutil.which("avr-objdump")
    if objdump is None:
        pytest.skip("needs avr-objdump (Debian: binutils-avr)")
    words = b"".join(word.to_bytes(2, "little") + b"\0\0" for word in range(1 << 16))
    (tmp_path / "words").write_bytes(words)
    command = [objdump, "--disassemble-all", "--disassemble-zeroes", "--target=binary", "--architecture=avr:5", "words"]
    listing = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    checked = 0
    for line in listing.splitlines():
        found = re.match(r"\s*([0-9a-f]+):\t[0-9a-f ]+\t(\.?\w+)", line)
        if found is None or int(found[1], 16) % 4:
            continue
        address, name = int(found[1], 16), found[2]
        group = "brbx" if name.startswith("br") and name not in ("brne", "break") else _AVR_GROUPS.get(name, name)
        wanted = group if group in _AVR_NAMES | {"brbx", *_AVR_GROUPS.values()} else "other"
        one = AVR.decode_all(words[address : address + 4], address, "text")[0]
        long = name in ("lds", "sts", "jmp", "call")
        assert (one.mnemonic, one.size) == (wanted, 4 if long else 2), line
        checked += 1
    assert checked == 1 << 16
