# SPDX-License-Identifier: MIT
"""Faults to plant in a generated file, each as a line in front of its outputs, or as other text for some of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A line, or a replacement of ``old`` by ``new``; ``rare`` if random inputs hardly ever show it.

    ``shows`` says whether there are inputs for which an output differs, so that a counterexample has to be found.
    """

    name: str
    line: str = ""
    old: str = ""
    new: str = ""
    shows: bool = True
    rare: bool = False
    only: str = ""
    """The target whose assembly it is in; any if empty."""


_X, _Y = "observation[0]", "observation[1]"

FAULTS = (
    Fault("two inputs by chance", f"n0 ^= (unsigned)(({_X} == 101) & ({_Y} == -77));"),
    Fault("three inputs by chance", f"n0 += (unsigned)(({_X} == 105) & ({_Y} == -206) & (observation[2] == -1907));", rare=True),
    Fault("one bit by chance", f"n0 ^= (unsigned)((({_X} ^ {_Y}) == 0x55) & (observation[2] == 1999)) << 3;", rare=True),
    Fault("values beside each other", f"n0 -= (unsigned)(({_X} - {_Y} == 3) & ({_Y} + observation[2] == -2040));", rare=True),
    Fault("one value of a sum", "n0 ^= (unsigned)(sum0 == 1777U);"),
    Fault("an odd address", "n0 += (unsigned)(*(volatile const int16_t *)((const uint8_t *)observation + 1) & 0);", shows=False,
          only="cortex-m0"),
    Fault("a branch on data", f"if ({_X} > 3) {{ volatile int16_t stop = 0; (void)stop; }}", shows=False),
    Fault("an address from data", "{ static const uint8_t zeros[2] = {0, 0}; volatile const uint8_t *at = zeros;"
          f" n0 += at[({_X} >> 4) & 1]; }}", shows=False),
    Fault("a loop over data", f"{{ volatile int left = {_X} & 3; while (left != 0) {{ left = left - 1; }} }}", shows=False),
    Fault("what the stack held", "{ volatile int16_t unset; n0 += (unsigned)(unset & 1); }", shows=False),
    Fault("beyond the observation", "n0 += (unsigned)(((volatile const int16_t *)observation)[3] & 0);", shows=False),
    Fault("before the observation", "n0 += (unsigned)(((volatile const int16_t *)observation)[-1] & 0);", shows=False),
    Fault("beyond the action", "((volatile int16_t *)action)[1] = 0;", shows=False),
    Fault("into the observation", "((volatile int16_t *)observation)[0] = 0;", shows=False),
    Fault("what the action held", "n0 += (unsigned)(((volatile int16_t *)action)[0] & 0);", shows=False),
    Fault("memory of its own", "{ static volatile int16_t calls; calls = (int16_t)(calls + 1); }", shows=False),
    Fault("an address of nobody", "*(volatile int *)(uintptr_t)0x40000000U = 1;", shows=False),
    Fault("an instruction that traps", "__builtin_trap();", shows=False),
    Fault("no output", old="    action[0] =", new="    (void)n0; if (0) action[0] ="),
    Fault("a clip one too low", old="256U)", new="255U)", rare=False),
    Fault("another gain", old="<< 1", new="<< 2"),
    Fault("a sum without its last term", old="sum0 += ", new="sum0 = "),
    Fault("a register of the caller's", '__asm__ volatile("mov r8, r0");', shows=False, only="cortex-m0"),
    Fault("the stack pointer", '__asm__ volatile("sub sp, #8");', shows=False, only="cortex-m0"),
    Fault("below the stack pointer", "{ register int16_t *low __asm__(\"r2\"); __asm__ volatile(\"mov r2, sp\\n\\tsub r2, #32\\n"
          "\\tstr r2, [r2]\" : \"=r\"(low)); }", shows=False, only="cortex-m0"),
    Fault("a register of the caller's on x86", '__asm__ volatile("xorl %ebx, %ebx");', shows=False, only="x86-64"),
)  # fmt: skip
