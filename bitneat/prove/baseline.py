# SPDX-License-Identifier: MIT
"""Which instructions a processor lacks, though the lifter knows them: it lifts for the largest of each family."""

from __future__ import annotations

_LEGACY_PREFIXES = frozenset(b"\x26\x2e\x36\x3e\x64\x65\x66\x67\xf0\xf2\xf3")
_VEX_OR_EVEX = frozenset(b"\x62\xc4\xc5")


def beyond_armv6m(instruction: bytes) -> bool:
    """Whether a Thumb instruction is none of ARMv6-M, which has calls and barriers alone of the long ones (ARM DDI 0419, A5.3)."""
    first, second = (int.from_bytes(instruction[at : at + 2], "little") for at in (0, 2))
    if len(instruction) == 2:
        is_compare_and_branch = first & 0xF500 == 0xB100
        is_if_then = first & 0xFF00 == 0xBF00 and first & 0xF != 0
        return is_compare_and_branch or is_if_then
    is_call = first & 0xF800 == 0xF000 and second & 0xD000 == 0xD000
    is_barrier = first == 0xF3BF and second & 0xFF00 == 0x8F00 and second & 0xF0 in (0x40, 0x50, 0x60)
    return not is_call and not is_barrier


def beyond_x86_64(instruction: bytes) -> bool:
    """Whether an instruction is of an extension that not every x86-64 has: SSE3 and later, AVX, BMI, LZCNT, POPCNT, MOVBE.

    By the opcode maps of the Intel manual, volume 2, appendix A. What older processors take for another instruction counts:
    TZCNT is BSF there, whose result is another for 0.
    """
    rest = instruction.lstrip(bytes(_LEGACY_PREFIXES))
    prefixes = instruction[: len(instruction) - len(rest)]
    if rest[:1] and 0x40 <= rest[0] < 0x50:  # REX
        rest = rest[1:]
    opcode, second = rest[0], rest[1] if len(rest) > 1 else 0
    if opcode != 0x0F:
        is_xop = opcode == 0x8F and second & 0x38 != 0
        return opcode in _VEX_OR_EVEX or is_xop
    is_repeated = 0xF2 in prefixes or 0xF3 in prefixes
    is_counting = 0xF3 in prefixes and second in (0xB8, 0xBC, 0xBD)
    is_sse3 = second in (0x7C, 0x7D, 0xD0) or (is_repeated and second in (0x12, 0x16, 0xF0))
    return second in (0x38, 0x3A) or is_counting or is_sse3
