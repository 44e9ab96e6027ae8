# SPDX-License-Identifier: MIT
"""Executes a function of a linked program on terms instead of numbers: one path, since it must not branch on data.

pyvex lifts the machine code to VEX, Valgrind's intermediate language, whose operations are small and say all they do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

from bitneat.prove.baseline import beyond_armv6m, beyond_x86_64
from bitneat.prove.flags import HELPERS, UnsupportedError
from bitneat.prove.memory import Bytes, Memory, Region, Violation
from bitneat.prove.operations import operation
from bitneat.prove.terms import Atom, Term, Terms

MAX_INSTRUCTIONS = 5_000_000
_STACK_TOP = 0x7FFF_0000
_STACK_BYTES = 0x10000
_RETURN_TO = 0x0EADBEE0
"""Where the caller is; nothing is there."""


@dataclass(frozen=True, slots=True)
class Processor:
    """What has to be known of a processor and its calling convention.

    Args:
        vex: pyvex's name of it, as in ``ARCH_AMD64``.
        word: bits of a register.
        arguments: registers of the first arguments.
        result: register of a returned number.
        stack_pointer: register.
        link: register that holds the address to return to; None where a call pushes it.
        preserved: registers that a function gives back as it got them.
        initial: registers whose content at entry is fixed by the calling convention.
        red_zone: bytes below the stack pointer that a function may use.
        thumb: whether the lowest bit of an address says how to execute what is there.
        machine: ``e_machine`` of its ELF files.
        architectures: of ARM, those whose instructions it executes, the own one last.
        baseline: the instructions that it has, for messages.
        beyond: whether an instruction is none of those, though the lifter knows it; None where it need not be asked.
    """

    vex: str
    word: int
    arguments: tuple[str, ...]
    result: str
    stack_pointer: str
    link: str | None
    preserved: tuple[str, ...]
    initial: tuple[tuple[str, int, int], ...] = ()
    red_zone: int = 0
    thumb: bool = False
    machine: str = ""
    architectures: tuple[str, ...] = ()
    baseline: str = ""
    beyond: Callable[[bytes], bool] | None = None
    aligned: bool = False
    """Whether an access that is not at a multiple of its size faults."""


AMD64 = Processor(
    vex="ARCH_AMD64",
    word=64,
    arguments=("rdi", "rsi", "rdx"),
    result="rax",
    stack_pointer="rsp",
    link=None,
    preserved=("rbx", "rbp", "r12", "r13", "r14", "r15"),
    initial=(("dflag", 64, 1), ("cc_op", 64, 0)),  # strings go upwards; flags as they were, which nobody knows
    red_zone=128,
    machine="EM_X86_64",
    baseline="every x86-64",
    beyond=beyond_x86_64,
)
CORTEX_M = Processor(
    vex="ARCH_ARM_LE",
    word=32,
    arguments=("r0", "r1", "r2"),
    result="r0",
    stack_pointer="r13",
    link="r14",
    preserved=("r4", "r5", "r6", "r7", "r8", "r9", "r10", "r11"),
    # No instruction in front made the first ones conditional; flags as they were, which nobody knows.
    initial=(("itstate", 32, 0), ("cc_op", 32, 0)),
    thumb=True,
    machine="EM_ARM",
    architectures=("v6-M", "v6S-M", "v7-M"),
)
CORTEX_M0 = replace(CORTEX_M, architectures=("v6-M", "v6S-M"), baseline="ARMv6-M", beyond=beyond_armv6m, aligned=True)
CORTEX_M4 = replace(CORTEX_M, architectures=(*CORTEX_M.architectures, "v7E-M"))


@dataclass(frozen=True, slots=True)
class Program:
    """Machine code in its place: where it is, what is there, and where its functions begin."""

    code: range
    content: bytes
    functions: dict[str, int]


@dataclass(frozen=True, slots=True)
class Finished:
    """A function that has returned.

    ``stack_bytes`` is the deepest its stack was, as verify measures it: from the stack pointer before the call, so with the
    return address that a call pushes, to the lowest address that the stack pointer reached or that was touched.
    """

    memory: Memory
    returned: Term
    instructions: int
    stack_bytes: int


class Machine:
    """One call of one function.

    Args:
        terms: where terms are made.
        processor: which.
        program: whose function is called.
        regions: what it may touch besides its code, constants and stack.
    """

    def __init__(self, terms: Terms, processor: Processor, program: Program, regions: Sequence[Region]) -> None:
        self._terms, self._processor, self._program = terms, processor, program
        self._vex: Any = import_module("pyvex")
        self._arch: Any = getattr(self._vex, processor.vex)
        self._lifted: dict[int, Any] = {}
        own = Region("its code and constants", program.code, writable=False)
        # On top of the stack is what a call pushes; above that is the caller's.
        pushed = 0 if processor.link else processor.word // 8
        self._stack_top = _STACK_TOP - pushed
        stack = Region("its stack", range(_STACK_TOP - _STACK_BYTES, _STACK_TOP), writable=True)
        self.memory = Memory(terms, (own, *regions), stack)
        for at, byte in enumerate(program.content):
            self.memory.provide(program.code.start + at, terms.const(8, byte))
        self._registers = Bytes(terms)
        self._temporaries: dict[int, Term] = {}
        self._at = 0
        self._instructions = 0
        self._stack_accesses: list[int] = []
        self._pointer_before = self._lowest_pointer = self._stack_top
        self._set_up()

    def _set_up(self) -> None:
        processor, terms = self._processor, self._terms
        offsets = import_module("pyvex.vex_ffi").guest_offsets
        own = sorted((offset, name) for (arch, name), offset in offsets.items() if arch == self._arch.vex_name_small)
        for (offset, name), (end, _) in zip(own, [*own[1:], (own[-1][0] + 64, "")], strict=True):
            for at in range(offset, end):
                self._registers.write(at, terms.var(Atom(f"{name}.{at - offset}", 0, 255, undefined=True), 8))
        top = processor.word - 1
        for name in (*processor.arguments, *processor.preserved, processor.stack_pointer):
            self._set(name, terms.var(Atom(name, -(1 << top), (1 << top) - 1, undefined=True), processor.word))
        for name, width, value in processor.initial:
            self._registers.write(self._offset(name), terms.const(width, value))
        self._set(processor.stack_pointer, terms.const(processor.word, self._stack_top))
        back = terms.const(processor.word, _RETURN_TO | processor.thumb)
        if processor.link:
            self._set(processor.link, back)
        else:
            self.memory.provide(self._stack_top, back)

    def _offset(self, name: str) -> int:
        return int(self._arch.get_register_offset(name))

    def _set(self, name: str, term: Term) -> None:
        self._registers.write(self._offset(name), term)

    def _get(self, name: str) -> Term:
        return self._registers.read(self._offset(name), self._processor.word // 8)

    def call(self, function: str, arguments: Sequence[int]) -> Finished:
        """Run a function with addresses as its arguments until it returns.

        Raises:
            Violation: if it does what it must not: branches or addresses that depend on data, memory that is not its own, a
                register that it should have preserved.
            UnsupportedError: if it contains something that is not modelled.
        """
        processor = self._processor
        for name, value in zip(processor.arguments, arguments, strict=False):
            self._set(name, self._terms.const(processor.word, value))
        before = {name: self._get(name) for name in processor.preserved}
        address = self._program.functions[function]
        while address & ~int(processor.thumb) != _RETURN_TO:
            address = self._block(address)
        self._check_stack_accesses()
        for name, term in before.items():
            if self._get(name) is not term:
                raise Violation(f"does not preserve {name}")
        expected = _STACK_TOP
        if self._get(processor.stack_pointer) is not self._terms.const(processor.word, expected):
            raise Violation("returns with another stack pointer")
        return Finished(
            self.memory,
            self._get(processor.result),
            self._instructions,
            _STACK_TOP - min(self.memory.lowest_stack, self._lowest_pointer),
        )

    def _block(self, address: int) -> int:
        block = self._lifted.get(address)
        if block is None:
            block = self._lifted[address] = self._lift(address)
        statements, after, kind = block
        self._temporaries = {}
        try:
            for statement in statements:
                target = self._statement(statement)
                if target is not None:
                    return target
            if kind not in ("Ijk_Boring", "Ijk_Call", "Ijk_Ret"):
                raise UnsupportedError(f"an instruction of kind {kind}")
            return self._known(self._expression(after), "jumps to an address that depends on data")
        except Violation as found:
            raise Violation(f"at {self._at:#x}: {found}") from None
        except UnsupportedError as found:
            raise UnsupportedError(f"at {self._at:#x}: {found}") from None

    def _lift(self, address: int) -> Any:
        thumb = int(self._processor.thumb)
        at = (address & ~thumb) - self._program.code.start
        if not 0 <= at < len(self._program.content) or (thumb and not address & 1):
            raise Violation(f"runs on at {address:#x}, which is none of its code")
        try:
            block = self._vex.lift(self._program.content[at:], address, self._arch, bytes_offset=address & thumb)
        except self._vex.PyVEXError as error:
            raise UnsupportedError(f"at {address:#x}: {error}") from None
        return block.statements, block.next, block.jumpkind

    def _require_known(self, address: int, size: int) -> None:
        at = address - self._program.code.start
        instruction = self._program.content[at : at + size]
        if self._processor.beyond is not None and self._processor.beyond(instruction):
            raise Violation(f"executes {instruction.hex(' ')}, beyond the instructions of {self._processor.baseline}")

    def _known(self, term: Term, what: str) -> int:
        if not term.is_const:
            raise Violation(what)
        return term.unsigned

    def _check_stack_accesses(self) -> None:
        """What lies below the stack pointer may be overwritten by an interrupt at any time."""
        if self._stack_accesses:
            pointer = self._known(
                self._get(self._processor.stack_pointer), "moves its stack by an amount that depends on data"
            )
            lowest = min(pointer, self._pointer_before) - self._processor.red_zone
            for address in self._stack_accesses:
                if address < lowest:
                    raise Violation(f"touches its stack {lowest - address} bytes below the stack pointer")
            self._stack_accesses.clear()
        pointer_term = self._get(self._processor.stack_pointer)
        self._pointer_before = pointer_term.unsigned if pointer_term.is_const else self._stack_top
        self._lowest_pointer = min(self._lowest_pointer, self._pointer_before)

    def _statement(self, statement: Any) -> int | None:
        """Execute one; the address that it jumps to, if it does."""
        match statement.tag:
            case "Ist_IMark":
                self._check_stack_accesses()
                self._at = statement.addr
                self._instructions += 1
                if self._instructions > MAX_INSTRUCTIONS:
                    raise Violation(f"did not come back within {MAX_INSTRUCTIONS} instructions")
                self._require_known(statement.addr, statement.len)
            case "Ist_WrTmp":
                self._temporaries[statement.tmp] = self._expression(statement.data)
            case "Ist_Put":
                self._registers.write(statement.offset, self._expression(statement.data))
            case "Ist_Store":
                self._store(self._expression(statement.addr), self._expression(statement.data))
            case "Ist_StoreG":
                if self._known(self._expression(statement.guard), "writes depending on data"):
                    self._store(self._expression(statement.addr), self._expression(statement.data))
            case "Ist_LoadG":
                self._temporaries[statement.dst] = self._guarded_load(statement)
            case "Ist_Exit":
                if self._known(self._expression(statement.guard), "branches depending on data"):
                    if statement.jumpkind not in ("Ijk_Boring", "Ijk_Call", "Ijk_Ret"):
                        raise UnsupportedError(f"an instruction of kind {statement.jumpkind}")
                    return int(statement.dst.value)
            case "Ist_AbiHint" | "Ist_NoOp" | "Ist_MBE":
                pass
            case tag:
                raise UnsupportedError(f"VEX statement {tag}")
        return None

    def _guarded_load(self, statement: Any) -> Term:
        if not self._known(self._expression(statement.guard), "reads depending on data"):
            return self._expression(statement.alt)
        conversions = {
            "ILGop_Ident32": (4, 32, False),
            "ILGop_Ident64": (8, 64, False),
            "ILGop_16Uto32": (2, 32, False),
        }
        conversions |= {"ILGop_16Sto32": (2, 32, True), "ILGop_8Uto32": (1, 32, False), "ILGop_8Sto32": (1, 32, True)}
        if statement.cvt not in conversions:
            raise UnsupportedError(f"VEX load {statement.cvt}")
        size, width, is_signed = conversions[statement.cvt]
        term = self._load(self._expression(statement.addr), size)
        return self._terms.sext(term, width) if is_signed else self._terms.zext(term, width)

    def _store(self, address: Term, term: Term) -> None:
        place = self._place(address, term.width // 8, "writes to")
        self.memory.store(place, term)

    def _load(self, address: Term, size: int) -> Term:
        place = self._place(address, size, "reads from")
        return self.memory.load(place, size)

    def _place(self, address: Term, size: int, what: str) -> int:
        place = self._known(address, f"{what} an address that depends on data")
        if self._processor.aligned and place % size:
            raise Violation(f"{what} {place:#x}, which is no multiple of {size}")
        if self.memory.is_stack(place):
            self._stack_accesses.append(place)
        return place

    def _expression(self, expression: Any) -> Term:
        match expression.tag:
            case "Iex_RdTmp":
                return self._temporaries[expression.tmp]
            case "Iex_Const":
                return self._constant(expression.con)
            case "Iex_Get":
                return self._registers.read(expression.offset, _size(expression.ty))
            case "Iex_Load":
                return self._load(self._expression(expression.addr), _size(expression.ty))
            case "Iex_Unop" | "Iex_Binop" | "Iex_Triop":
                return operation(expression.op)(self._terms, *map(self._expression, expression.args))
            case "Iex_ITE":
                parts = (expression.cond, expression.iftrue, expression.iffalse)
                condition, then, otherwise = map(self._expression, parts)
                if then.width <= 64:
                    return self._terms.ite(condition, then, otherwise)
                return self._wide_choice(condition, then, otherwise)
            case "Iex_CCall":
                helper = HELPERS.get(expression.callee.name)
                if helper is None:
                    raise UnsupportedError(f"VEX helper {expression.callee.name}")
                result = helper(self._terms, [self._expression(one) for one in expression.args])
                return self._terms.extract(result, 0, 8 * _size(expression.ret_type))
            case tag:
                raise UnsupportedError(f"VEX expression {tag}")

    def _wide_choice(self, condition: Term, then: Term, otherwise: Term) -> Term:
        extract = self._terms.extract
        halves = ((extract(then, at, 64), extract(otherwise, at, 64)) for at in range(0, then.width, 64))
        return self._terms.concat([self._terms.ite(condition, *pair) for pair in halves])

    def _constant(self, constant: Any) -> Term:
        size = constant.size
        if constant.type == "Ity_V128":
            value = int(constant.value)
            return self._terms.concat([self._terms.const(64, value), self._terms.const(64, value >> 64)])
        if constant.type not in ("Ity_I1", "Ity_I8", "Ity_I16", "Ity_I32", "Ity_I64"):
            raise UnsupportedError(f"VEX constant of type {constant.type}")
        return self._terms.const(size, int(constant.value))


def _size(kind: str) -> int:
    """Bytes of a VEX type; one bit is kept in none, and is never in memory."""
    sizes = {"Ity_I8": 1, "Ity_I16": 2, "Ity_I32": 4, "Ity_I64": 8, "Ity_V128": 16, "Ity_V256": 32}
    if kind not in sizes:
        raise UnsupportedError(f"VEX type {kind}")
    return sizes[kind]
