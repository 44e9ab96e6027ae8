# SPDX-License-Identifier: MIT
"""The instruction sets whose code can be looked into: which instructions multiply, and which branch on a condition."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import capstone

from bitneat.errors import BitneatError


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction where it lies."""

    address: int
    size: int
    mnemonic: str
    operands: str


@dataclass(frozen=True, slots=True)
class InstructionSet:
    """How to read machine code.

    Args:
        name: for messages.
        disassemble: code and its address to its instructions, as far as they can be read.
        multiplies: by the start of the mnemonic, multiplications and divisions.
        is_conditional: whether a mnemonic, with its operands, is a branch on a condition or through a table.
        sums: mnemonics of plain additions and subtractions.
        nops: instructions that do nothing, by their size.
        counts_constant: whether the branch at an index of some code ends a loop that counts a constant down; None where compilers
            make no such loops.
        code_mark: how symbols start that mark the beginning of code between constants; None where there are no such.
    """

    name: str
    disassemble: Callable[[bytes, int], Iterator[Instruction]] = field(repr=False)
    multiplies: tuple[str, ...]
    is_conditional: Callable[[str, str], bool] = field(repr=False)
    sums: frozenset[str]
    nops: tuple[bytes, ...]
    code_mark: str | None = None
    counts_constant: Callable[[Sequence[Instruction], int], bool] | None = field(default=None, repr=False)

    def decode(self, code: bytes, address: int) -> list[Instruction]:
        """All instructions, as far as they can be read."""
        return list(self.disassemble(code, address))

    def decode_one(self, code: bytes, offset: int, address: int) -> Instruction | None:
        """The instruction at an offset of some code that starts at an address; None if it cannot be read."""
        return next(self.disassemble(code[offset : offset + 16], address + offset), None)

    def decode_all(self, code: bytes, address: int, where: str) -> list[Instruction]:
        """All instructions.

        Raises:
            BitneatError: if a part of the code cannot be read.
        """
        found = self.decode(code, address)
        reached = found[-1].address + found[-1].size if found else address
        if reached != address + len(code):
            raise BitneatError(f"{where}+{reached:#x}: cannot disassemble the compiled code")
        return found

    def is_multiplication(self, one: Instruction) -> bool:
        """Or a division."""
        return one.mnemonic.removeprefix("c.").startswith(self.multiplies)

    def conditional_branches(self, code: Sequence[Instruction]) -> list[Instruction]:
        """Those of some code whose condition may depend on data; a loop that counts a constant down is none."""
        found = [at for at, one in enumerate(code) if self.is_conditional(one.mnemonic, one.operands)]
        return [code[at] for at in found if self.counts_constant is None or not self.counts_constant(code, at)]

    def is_sum(self, one: Instruction) -> bool:
        """Whether it is a plain addition or subtraction of registers."""
        return one.mnemonic in self.sums

    def executed_sums(self, code: bytes, address: int, path: Iterable[int]) -> list[tuple[Instruction, bytes]]:
        """The additions and subtractions that were executed, each with instructions of the same size that do nothing.

        Args:
            code: machine code.
            address: where it starts.
            path: the addresses executed.
        """
        found = [self.decode_one(code, here - address, address) for here in sorted(set(path))]
        pairs = [(one, self.nothing(one.size)) for one in found if one is not None and self.is_sum(one)]
        return [(one, nothing) for one, nothing in pairs if nothing is not None]

    def nothing(self, size: int) -> bytes | None:
        """Instructions of that size that do nothing."""
        for nop in self.nops:
            if size % len(nop) == 0:
                return nop * (size // len(nop))
        return None


def _capstone(arch: str, *modes: str) -> Callable[[bytes, int], Iterator[Instruction]]:
    def disassemble(code: bytes, address: int) -> Iterator[Instruction]:
        mode = sum(getattr(capstone, f"CS_MODE_{name}") for name in modes)
        decoder = capstone.Cs(getattr(capstone, f"CS_ARCH_{arch}"), mode)
        for where, size, mnemonic, operands in decoder.disasm_lite(code, address):
            yield Instruction(where, size, mnemonic, operands)

    return disassemble


_THUMB_CONDITIONS = ("eq", "ne", "hs", "cs", "lo", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le")
_THUMB_BRANCHES = frozenset({"cbz", "cbnz", "tbb", "tbh", *(f"b{condition}" for condition in _THUMB_CONDITIONS)})

THUMB = InstructionSet(
    name="thumb",
    disassemble=_capstone("ARM", "THUMB", "MCLASS"),
    # What ARMv6-M, or any Thumb, has.
    multiplies=("mul", "mla", "mls", "smul", "smla", "smml", "smu", "umul", "umla", "umaal", "sdiv", "udiv"),
    is_conditional=lambda mnemonic, _: mnemonic.removesuffix(".w").removesuffix(".n") in _THUMB_BRANCHES,
    sums=frozenset({"add", "adds", "sub", "subs", "add.w", "sub.w", "adds.w", "subs.w"}),
    nops=(b"\xc0\x46",),  # mov r8, r8
    code_mark="$t",
)

RISCV = InstructionSet(
    name="riscv",
    disassemble=_capstone("RISCV", "RISCV32", "RISCVC"),
    multiplies=("mul", "div", "rem"),
    is_conditional=lambda mnemonic, _: mnemonic.removeprefix("c.").startswith("b") and mnemonic != "ebreak",
    sums=frozenset({"add", "sub", "c.add", "c.sub"}),
    nops=(b"\x13\x00\x00\x00", b"\x01\x00"),
)


def _x86_conditional(mnemonic: str, _: str) -> bool:
    return (mnemonic.startswith("j") and mnemonic != "jmp") or mnemonic.startswith("loop")


X86_64 = InstructionSet(
    name="x86-64",
    disassemble=_capstone("X86", "64"),
    multiplies=("mul", "imul", "div", "idiv", "pmul", "pmadd", "vpmul", "fmul", "fdiv"),
    is_conditional=_x86_conditional,
    sums=frozenset({"add", "sub"}),
    nops=(b"\x90",),
)
I386 = InstructionSet(
    name="i386",
    disassemble=_capstone("X86", "32"),
    multiplies=X86_64.multiplies,
    is_conditional=_x86_conditional,
    sums=X86_64.sums,
    nops=X86_64.nops,
)

POWERPC = InstructionSet(
    name="powerpc",
    disassemble=_capstone("PPC", "32", "BIG_ENDIAN"),
    multiplies=("mul", "div"),
    is_conditional=lambda mnemonic, _: (
        mnemonic.startswith("b") and mnemonic not in ("b", "bl", "ba", "bla", "blr", "blrl", "bctr", "bctrl")
    ),
    sums=frozenset({"add", "subf", "sub"}),
    nops=(b"\x60\x00\x00\x00",),
)


_AVR_PATTERNS: tuple[tuple[int, int, str], ...] = (
    (0xFC00, 0x9C00, "mul"),
    (0xFF00, 0x0200, "muls"),
    (0xFF00, 0x0300, "mulsu"),
    (0xFC07, 0xF401, "brne"),
    (0xF800, 0xF000, "brbx"),
    (0xFC08, 0xFC00, "sbrx"),
    (0xFC00, 0x1000, "cpse"),
    (0xFD00, 0x9900, "sbix"),
    (0xFC00, 0x0C00, "add"),
    (0xFC00, 0x1C00, "adc"),
    (0xFC00, 0x1800, "sub"),
    (0xFC00, 0x0800, "sbc"),
    (0xF000, 0xE000, "ldi"),
    (0xFE0F, 0x940A, "dec"),
    (0xFE0F, 0x9405, "shift"),
    (0xFE0E, 0x9406, "shift"),
    (0xFE0F, 0x9000, "lds"),
    (0xFE0F, 0x9200, "sts"),
    (0xFE0E, 0x940C, "jmp"),
    (0xFE0E, 0x940E, "call"),
)
"""Masks, values and names of the AVR instructions that matter here, from Microchip's instruction set manual.

The names stand for groups: brbx for all other branches on a flag, shift for asr, lsr and ror, sbrx and sbix for the skips on a
bit, set or clear. mulsu includes fmul and its kin.
"""


def _disassemble_avr(code: bytes, address: int) -> Iterator[Instruction]:
    at = 0
    while at + 2 <= len(code):
        word = int.from_bytes(code[at : at + 2], "little")
        mnemonic = next((name for mask, value, name in _AVR_PATTERNS if word & mask == value), "other")
        size = 4 if mnemonic in ("lds", "sts", "jmp", "call") else 2
        if at + size > len(code):
            return
        yield Instruction(address + at, size, mnemonic, f"({code[at : at + size].hex()})")
        at += size


def _avr_counts_constant(code: Sequence[Instruction], at: int) -> bool:
    """An AVR shifts by one bit only; gcc -Os writes a shift by a constant as ``ldi r, n; loop: lsr …; dec r; brne loop``.

    Where the branch goes is not known before linking, so the loop is known by its counter: brne follows dec, and the instruction
    before the four or fewer that shift loads the same register with a constant.
    """
    if code[at].mnemonic != "brne" or at == 0 or code[at - 1].mnemonic != "dec":
        return False
    counter = int.from_bytes(bytes.fromhex(code[at - 1].operands[1:-1])[:2], "little") >> 4 & 31
    for before in reversed(code[max(at - 6, 0) : at - 1]):
        if before.mnemonic == "ldi":
            word = int.from_bytes(bytes.fromhex(before.operands[1:-1]), "little")
            return (word >> 4 & 15) + 16 == counter
        if before.mnemonic not in ("add", "adc", "shift"):
            return False
    return False


AVR = InstructionSet(
    name="avr",
    disassemble=_disassemble_avr,
    multiplies=("mul",),
    is_conditional=lambda mnemonic, _: mnemonic in ("brne", "brbx", "sbrx", "cpse", "sbix"),
    sums=frozenset({"add", "sub"}),  # those with a carry often add nothing
    nops=(b"\x00\x00",),
    counts_constant=_avr_counts_constant,
)
