"""Single functions in machine code, written by hand: what each may and may not do."""

import pytest

from bitneat.prove.execute import AMD64, CORTEX_M, CORTEX_M0, Finished, Machine, Processor, Program
from bitneat.prove.memory import Region, Violation
from bitneat.prove.terms import Atom, Terms

CODE, DATA = 0x1000, 0x2000


def run(processor: Processor, code: str, terms: Terms, *, writable: bool = True) -> Finished:
    content = bytes.fromhex(code)
    program = Program(range(CODE, CODE + len(content)), content, {"f": CODE | processor.thumb})
    machine = Machine(terms, processor, program, [Region("its data", range(DATA, DATA + 8), writable=writable)])
    machine.memory.provide(DATA, terms.var(Atom("x", -100, 100), 32))
    return machine.call("f", [DATA])


def test_what_is_computed_is_returned() -> None:
    # ldr r0, [r0]; adds r0, r0, #3; bx lr, and the same for x86-64: movl (%rdi), %eax; addl $3, %eax; ret
    for processor, code in ((CORTEX_M, "0068 c01c 7047"), (AMD64, "8b07 83c003 c3")):
        terms = Terms()
        finished = run(processor, code.replace(" ", ""), terms)
        found = terms.extract(finished.returned, 0, 32)
        constant, parts = terms.linear_parts(found)
        assert constant == 3
        assert [part.atom.name for part in parts if part.atom] == ["x"]
        assert finished.instructions == 3


@pytest.mark.parametrize(
    ("processor", "code", "message"),
    [
        (CORTEX_M, "82b0 7047", "another stack pointer"),  # sub sp, #8; bx lr
        (CORTEX_M, "0424 7047", "does not preserve r4"),  # movs r4, #4; bx lr
        (AMD64, "31db c3", "does not preserve rbx"),  # xorl %ebx, %ebx; ret
        (CORTEX_M, "c268 7047", "beyond its data|none of its memory"),  # ldr r2, [r0, #12]; bx lr
        (CORTEX_M, "4268 7047", "before it has written it"),  # ldr r2, [r0, #4]; bx lr
        (CORTEX_M0, "401c 0288 7047", "is no multiple of 2"),  # adds r0, r0, #1; ldrh r2, [r0]; bx lr
        (CORTEX_M0, "b0f90010 7047", "b0 f9 00 10, beyond the instructions of ARMv6-M"),  # ldrsh.w r1, [r0]
        (CORTEX_M0, "4ff00101 7047", "4f f0 01 01, beyond the instructions of ARMv6-M"),  # mov.w r1, #1
        (CORTEX_M0, "0021 01b1 7047", "01 b1, beyond"),  # movs r1, #0; cbz r1, .+4
        (CORTEX_M0, "8042 08bf c046 7047", "08 bf, beyond"),  # cmp r0, r0; it eq; nop
        (AMD64, "c4e278f2c1 c3", "c4 e2 78 f2 c1, beyond the instructions of every x86-64"),  # andn %ecx, %eax, %eax
        (AMD64, "f30fbcc0 c3", "f3 0f bc c0, beyond"),  # tzcnt %eax, %eax
        (CORTEX_M, "6a46 083a 1260 7047", "bytes below the stack pointer"),  # mov r2, sp; subs r2, #8; str r2, [r2]
        (AMD64, "4889442408 c3", "beyond its stack|none of its memory"),  # movq %rax, 8(%rsp): the caller's
        (CORTEX_M, "0168 0029 00d0 c046 7047", "branches depending on data"),  # ldr r1, [r0]; cmp r1, #0; beq .+2; nop
        (
            CORTEX_M,
            "0168 4118 0a68 7047",
            "an address that depends on data",
        ),  # ldr r1, [r0]; adds r1, r0, r1; ldr r2, [r1]
        (CORTEX_M, "fee7", "did not come back"),  # b .
        (CORTEX_M, "0047", "none of its code"),  # bx r0
        (AMD64, "ffe7", "none of its code"),  # jmp *%rdi
    ],
)
def test_what_must_not_be_is_a_violation(
    processor: Processor, code: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bitneat.prove.execute.MAX_INSTRUCTIONS", 100)
    with pytest.raises(Violation, match=message):
        run(processor, code.replace(" ", ""), Terms())


def test_what_is_given_to_be_read_is_not_to_be_written() -> None:
    with pytest.raises(Violation, match="writes its data"):
        run(CORTEX_M, "00607047", Terms(), writable=False)  # str r0, [r0]; bx lr


def test_the_smallest_cortex_has_barriers_and_hints() -> None:
    # movs r2, #0; dmb sy; nop; bx lr
    code = "0022bff35f8f00bf7047"
    assert run(CORTEX_M0, code, Terms()).instructions == 4


@pytest.mark.parametrize(
    ("processor", "code", "expected"),
    [
        (CORTEX_M, "7047", 0),  # bx lr
        (AMD64, "c3", 8),  # ret, from the address that the call pushed
        (CORTEX_M, "82b0 0093 02b0 7047", 8),  # sub sp, #8; str r3, [sp]; add sp, #8; bx lr
        (CORTEX_M, "82b0 0193 02b0 7047", 8),  # the same with str r3, [sp, #4]: what is not touched is taken, too
        (AMD64, "48894424f0 c3", 24),  # movq %rax, -16(%rsp): in the red zone
    ],
)
def test_the_stack_is_what_a_caller_must_have_left(processor: Processor, code: str, expected: int) -> None:
    assert run(processor, code.replace(" ", ""), Terms()).stack_bytes == expected
