# SPDX-License-Identifier: MIT
"""Cycles of the Cortex-M0 as Arm publishes them: Cortex-M0 Technical Reference Manual r0p0, table 3-1, zero wait states.

None of them depends on data: what a branch takes depends on whether it is taken, which the addresses executed say.
"""

from __future__ import annotations

from bitneat.errors import BitneatError
from bitneat.verify.instructions import THUMB, Instruction

SOURCE = "Arm Cortex-M0 TRM r0p0, table 3-1, zero wait states"

_ONE = frozenset(
    "mov movs add adds sub subs rsb rsbs neg negs cmp cmn adc adcs sbc sbcs and ands eor eors orr orrs bic bics mvn mvns tst "
    "lsl lsls lsr lsrs asr asrs ror rors uxth sxth uxtb sxtb rev rev16 revsh nop adr".split()
)
_TWO = frozenset("ldr ldrh ldrb ldrsh ldrsb str strh strb".split())
_TAKEN, _NOT_TAKEN = 3, 1


def cycles(code: bytes, address: int, path: tuple[int, ...]) -> int:
    """Cycles of a run through code, its return included.

    Raises:
        BitneatError: at an instruction that the table has no fixed cycles for, such as a multiplication.
    """
    total = 0
    timed: dict[tuple[int, bool], int] = {}
    sizes: dict[int, int] = {}
    for here, following in zip(path, (*path[1:], -1), strict=True):
        key = (here, False)
        if key not in timed:
            one = next(THUMB.disassemble(code[here - address : here - address + 4], here), None)
            if one is None:
                raise BitneatError(f"{here:#x}: cannot disassemble what was executed")
            sizes[here] = one.size
            timed[here, False], timed[here, True] = _cycles(one)
            timed[here, True] = timed[here, True] if one.size == 2 else timed[here, False]
        straight = following == here + sizes[here]  # a branch over one instruction is a branch
        total += timed[here, not straight]
    return total


def _cycles(one: Instruction) -> tuple[int, int]:
    """Of one instruction, if the next is executed after it and if another is."""
    mnemonic = one.mnemonic.removesuffix(".w").removesuffix(".n")
    registers = [text.strip() for text in one.operands.strip("{}").split(",")]
    if mnemonic in _ONE:
        return 1, _TAKEN  # the latter writes the program counter
    if mnemonic in _TWO:
        return 2, 2
    if mnemonic in ("push", "pop"):
        number = (4 if "pc" in registers else 1) + _count(one.operands)
        return number, number
    if mnemonic in ("ldm", "stm", "ldmia", "stmia"):
        number = _count(one.operands[one.operands.index("{") :])
        return 1 + number, 1 + number
    if mnemonic == "bl":
        return 4, 4
    if mnemonic in ("b", "bx", "blx"):
        return _TAKEN, _TAKEN
    if THUMB.is_conditional(mnemonic, one.operands):
        return _NOT_TAKEN, _TAKEN
    raise BitneatError(f"{one.address:#x}: {mnemonic} {one.operands}: {SOURCE} gives no cycles that always hold")


def _count(registers: str) -> int:
    """How many registers a list has; capstone writes each by itself."""
    return len(registers.strip("{} ").split(","))
