"""Instructions as terms against the same instructions in the emulator, on random data."""

from collections.abc import Iterator

import numpy as np
import pytest
import unicorn
from unicorn import arm_const, x86_const

from bitneat.prove.evaluation import values_of
from bitneat.prove.execute import AMD64, CORTEX_M, Machine, Processor, Program
from bitneat.prove.memory import Region
from bitneat.prove.terms import Atom, Term, Terms

CODE, DATA, STACK, BACK = 0x10000, 0x20000, 0x40000, 0x30000
WORDS = 8
SAMPLES = 24


def as_terms(processor: Processor, code: bytes, rows: np.ndarray) -> np.ndarray:
    terms = Terms()
    atoms = [Atom(f"word{i}", -(1 << 31), (1 << 31) - 1) for i in range(WORDS)]
    program = Program(range(CODE, CODE + len(code)), code, {"f": CODE | processor.thumb})
    machine = Machine(terms, processor, program, [Region("its data", range(DATA, DATA + 4 * WORDS), writable=True)])
    for i, atom in enumerate(atoms):
        machine.memory.provide(DATA + 4 * i, terms.var(atom, 32))
    memory = machine.call("f", [DATA]).memory
    found: list[Term] = [memory.result(DATA + 4 * i, 4, "word") for i in range(WORDS)]
    values = values_of(found, dict(zip(atoms, rows.T, strict=True)))
    return np.stack([np.broadcast_to(one, (len(rows),)) for one in values], axis=1).astype(np.uint32)


def in_the_emulator(processor: Processor, code: bytes, rows: np.ndarray) -> np.ndarray:
    if processor is AMD64:
        engine = unicorn.Uc(unicorn.UC_ARCH_X86, unicorn.UC_MODE_64)
    else:
        engine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    for start in (CODE, DATA, BACK, STACK):
        engine.mem_map(start, 0x1000)
    engine.mem_write(CODE, code)
    answers = []
    for row in rows:
        engine.mem_write(DATA, row.astype(np.int32).tobytes())
        if processor is AMD64:
            engine.mem_write(STACK + 0x800, BACK.to_bytes(8, "little"))
            engine.reg_write(x86_const.UC_X86_REG_RSP, STACK + 0x800)
            engine.reg_write(x86_const.UC_X86_REG_RDI, DATA)
            engine.emu_start(CODE, BACK)
        else:
            engine.reg_write(arm_const.UC_ARM_REG_SP, STACK + 0x800)
            engine.reg_write(arm_const.UC_ARM_REG_R0, DATA)
            engine.reg_write(arm_const.UC_ARM_REG_LR, BACK | 1)
            engine.emu_start(CODE | 1, BACK)
        answers.append(np.frombuffer(engine.mem_read(DATA, 4 * WORDS), dtype=np.uint32))
    return np.array(answers)


def rows_for(seed: int) -> np.ndarray:
    """Random words, equal ones, extremes and small ones, so that every flag shows."""
    rng = np.random.default_rng(seed)
    rows = rng.integers(-(1 << 31), (1 << 31) - 1, size=(SAMPLES, WORDS), endpoint=True)
    rows[::3] = rng.choice(np.array([0, 1, -1, (1 << 31) - 1, -(1 << 31), 0x7FFF, -0x8000, 0x80]), size=rows[::3].shape)
    rows[1::6, 1] = rows[1::6, 0]
    rows[2::6] >>= 24
    return rows


def agree(processor: Processor, text: str, what: str) -> None:
    code = bytes.fromhex(text)
    rows = rows_for(len(what))
    expected, found = in_the_emulator(processor, code, rows), as_terms(processor, code, rows)
    wrong = np.flatnonzero((expected != found).any(axis=1))
    assert not len(wrong), f"{what}: {rows[wrong[0]]}: {found[wrong[0]]} instead of {expected[wrong[0]]}"


VECTORS = {
    "punpcklbw": "60", "punpcklwd": "61", "punpckldq": "62", "packsswb": "63", "pcmpgtb": "64", "pcmpgtw": "65",
    "pcmpgtd": "66", "punpckhbw": "68", "punpckhwd": "69", "punpckhdq": "6a", "packssdw": "6b", "punpcklqdq": "6c",
    "punpckhqdq": "6d", "pcmpeqb": "74", "pcmpeqw": "75", "pcmpeqd": "76", "paddb": "fc", "paddw": "fd", "paddd": "fe",
    "paddq": "d4", "psubb": "f8", "psubw": "f9", "psubd": "fa", "psubq": "fb", "pand": "db", "pandn": "df", "por": "eb",
    "pxor": "ef", "pmaxsw": "ee", "pminsw": "ea", "pmaxub": "de", "pminub": "da", "pmullw": "d5",
}  # fmt: skip
WITH_A_NUMBER = {
    "psrlw": "71d003", "psraw": "71e003", "psllw": "71f003", "psrld": "72d005", "psrad": "72e005", "pslld": "72f005",
    "psrlq": "73d007", "psllq": "73f007", "pslldq": "73f804", "psrldq": "73d804", "pshufd": "70c11b", "pinsrw": "c4c103",
}  # fmt: skip


@pytest.mark.parametrize("name", [*VECTORS, *WITH_A_NUMBER])
def test_vectors(name: str) -> None:
    operation = f"660f{VECTORS[name]}c1" if name in VECTORS else f"660f{WITH_A_NUMBER[name]}"
    # movdqu (%rdi), %xmm0; movdqu 16(%rdi), %xmm1; movl 16(%rdi), %ecx; …; movdqu %xmm0, (%rdi); ret
    agree(AMD64, f"f30f6f07 f30f6f4f10 8b4f10 {operation} f30f7f07 c3", name)


X86 = {
    "cmpl": "39c8", "cmpw": "6639c8", "cmpb": "38c8", "addl": "01c8", "addw": "6601c8", "subl": "29c8", "testl": "85c8",
    "andl": "21c8", "cmpl; incl": "39c8ffc0", "cmpl; decl": "39c8ffc8", "negl": "f7d8", "shll": "c1e003", "shrl": "c1e803",
}  # fmt: skip


def conditions(name: str) -> Iterator[int]:
    """Those that the instruction defines: of shifts no overflow; nobody has the parity."""
    for code in range(16):
        if code >> 1 != 5 and not (name.startswith("sh") and code >> 1 in (0, 6, 7)):
            yield code


@pytest.mark.parametrize("name", X86)
def test_conditions_of_x86(name: str) -> None:
    for code in conditions(name):
        # movl (%rdi), %eax; movl 4(%rdi), %ecx; …; setcc %al; movzbl %al, %eax; movl %eax, (%rdi); ret
        agree(AMD64, f"8b07 8b4f04 {X86[name]} 0f9{code:x}c0 0fb6c0 8907 c3", f"{name}, condition {code}")


@pytest.mark.parametrize("operation", ["11c8", "19c8", "19c0", "0f42c1", "0f4cc1", "0fafc1"])
def test_carries_choices_and_products_of_x86(operation: str) -> None:
    # After a comparison: adc, sbb, sbb with itself, cmovb, cmovl, imul
    agree(AMD64, f"8b07 8b4f04 39c8 {operation} 8907 c3", operation)


THUMB = {
    "cmp": "9142", "cmn": "d142", "tst": "1142", "adds": "8918", "subs": "891a", "ands": "1140", "lsls": "c900",
    "asrs": "c910", "lsrs": "c908", "cmp; adcs": "91425141", "cmp; sbcs": "91429141", "rsbs": "4942", "mvns": "c943",
}  # fmt: skip


@pytest.mark.parametrize("name", THUMB)
def test_conditions_of_thumb(name: str) -> None:
    for code in range(14):
        choice = (0xBF00 | code << 4 | (1 - (code & 1)) << 3 | 4).to_bytes(2, "little").hex()
        # ldr r1, [r0]; ldr r2, [r0, #4]; movs r3, #0; cmp r3, r2; …; ite cc; mov r3, #1; mov r3, #0; str r1; str r3; bx lr
        text = f"0168 4268 0023 9342 {THUMB[name]} {choice} 0123 0023 0160 4360 7047"
        agree(CORTEX_M, text, f"{name}, condition {code}")
