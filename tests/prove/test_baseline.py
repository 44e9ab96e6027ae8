# SPDX-License-Identifier: MIT
"""What a processor lacks, against what capstone says of each instruction."""

import capstone
import numpy as np
import pytest

from bitneat.prove.baseline import beyond_x86_64

EXTENSIONS = {
    "sse3",
    "ssse3",
    "sse41",
    "sse42",
    "avx",
    "avx2",
    "bmi",
    "bmi2",
    "fma",
    "f16c",
    "aes",
    "pclmul",
    "sha",
    "xop",
    "tbm",
}
OLD = {"sse1", "sse2", "mmx", "cmov"}


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("8b07", False),  # movl (%rdi), %eax
        ("480fbfc0", False),  # movswq %ax, %rax
        ("0f44c1", False),  # cmove
        ("f30f1efa", False),  # endbr64
        ("66450f6fc0", False),  # movdqa
        ("f30f6f07", False),  # movdqu
        ("0fbcc1", False),  # bsf
        ("8f00", False),  # pop
        ("f3480fbdc1", True),  # lzcnt
        ("f30fb8c1", True),  # popcnt
        ("0f38f007", True),  # movbe
        ("660f383cc1", True),  # pmaxsb
        ("c4e262f7c1", True),  # sarx
        ("c5f9efc0", True),  # vpxor
        ("62f17c4828c0", True),  # vmovaps of AVX-512
        ("f20ff007", True),  # lddqu
    ],
)
def test_extensions_of_x86_64_are_known(code: str, expected: bool) -> None:
    assert beyond_x86_64(bytes.fromhex(code)) == expected


def test_what_capstone_says_of_random_instructions() -> None:
    decoder = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    decoder.detail = True
    generator = np.random.default_rng(1)
    seen = {True: 0, False: 0}
    for start in (
        b"\x0f",
        b"\x66\x0f",
        b"\xf2\x0f",
        b"\xf3\x0f",
        b"\x66\x0f\x38",
        b"\xc4\xe2",
        b"\xc5",
        b"\x48\x0f",
        b"",
    ):
        for _ in range(2000):
            code = start + generator.bytes(15 - len(start))
            one = next(decoder.disasm(code, 0), None)
            groups = set() if one is None else {decoder.group_name(group) for group in one.groups}
            if one is not None and (groups & EXTENSIONS or groups & OLD):
                expected = bool(groups & EXTENSIONS)
                assert beyond_x86_64(bytes(one.bytes)) == expected, (one.bytes.hex(" "), one.mnemonic, groups)
                seen[expected] += 1
    assert min(seen.values()) > 500
