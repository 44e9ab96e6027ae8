# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from bitneat.native.compiler import host_compiler, zig_compiler
from bitneat.verify.cfile import CFile
from bitneat.verify.machine import Toolchain, examine, loading_violations, stack_depth
from bitneat.verify.targets import TARGETS, select
from tests.verify.champions import champion, plain_champion, written


def chip() -> Toolchain:
    toolchain = TARGETS["cortex-m0"].toolchain()
    assert toolchain is not None  # ziglang is a dependency
    return toolchain


def with_line(code: CFile, line: str) -> CFile:
    code.path.write_text(code.source.replace("    action[0]", f"    {line}\n    action[0]", 1))
    return CFile.read(code.path)


@pytest.mark.parametrize("name", ["host-unrolled", "cortex-m0"])
def test_generated_code_keeps_its_promises(name: str, tmp_path: Path) -> None:
    (ready,) = select([name])
    examination = examine(written(plain_champion(), tmp_path), ready.toolchain)
    assert examination.violations == ()
    assert 0 < examination.flash < 400
    assert examination.ram == 0


def test_what_is_remembered_counts_as_ram(tmp_path: Path) -> None:
    code = written(champion(seed=3, recurrent=True), tmp_path)
    assert code.num_state is not None
    assert examine(code, Toolchain(host_compiler())).ram == 2 * code.num_state
    (ready,) = select(["wasm32"])
    assert examine(code, ready.toolchain).ram == 2 * code.num_state > 4


@pytest.mark.parametrize(
    ("line", "violation"),
    [
        ("static int16_t calls; calls++; if (calls > 9) return;", "bytes of static data in .bss"),
        ("extern int16_t elsewhere(void); (void)elsewhere();", "needs elsewhere from elsewhere"),
    ],
)
def test_static_data_and_foreign_functions_are_found_on_any_target(line: str, violation: str, tmp_path: Path) -> None:
    code = with_line(written(plain_champion(), tmp_path), line)
    for toolchain in (Toolchain(host_compiler()), chip()):
        assert any(violation in found for found in examine(code, toolchain).violations)


@pytest.mark.parametrize(
    ("text", "violation"),
    [
        (
            "static int twice(int x) { return x + x; }\nstatic int (*pick(void))(int) { return twice; }\n"
            'int chosen(int x) __attribute__((ifunc("pick")));\n',
            "chosen runs by itself, expected none",
        ),
        (
            "__attribute__((constructor)) static void early(void) { volatile int x = 1; (void)x; }\n",
            ".init_array runs by itself, expected none",
        ),
        # By hand it need not be in memory that can be written.
        (
            "__attribute__((used)) static void early(void) { volatile int x = 1; (void)x; }\n"
            '__asm__(".section .init_array,\\"a\\",@progbits\\n.quad early\\n.text");\n',
            ".init_array runs by itself, expected none",
        ),
        (
            "__attribute__((used)) static void late(void) { volatile int x = 1; (void)x; }\n"
            '__asm__(".section .fini_array.00100,\\"a\\",@progbits\\n.quad late\\n.text");\n',
            ".fini_array.00100 runs by itself, expected none",
        ),
    ],
)
def test_what_a_loader_would_run_is_found(text: str, violation: str, tmp_path: Path) -> None:
    code = written(plain_champion(), tmp_path)
    code.path.write_text(code.source + text)
    found = loading_violations(CFile.read(code.path), host_compiler(), ("-std=gnu99", "-Os", "-ffreestanding"))
    assert any(violation in one for one in found)


@pytest.mark.parametrize("name", [".init3", ".fini5", ".init", ".init_array", ".ctors.100"])
def test_what_a_chip_would_run_by_itself_is_found(name: str, tmp_path: Path) -> None:
    """avr-libc's start-up code falls through sections named .init0 to .init9."""
    code = written(plain_champion(), tmp_path)
    code.path.write_text(
        code.source + f'__attribute__((section("{name}"), used)) static void early(void) {{ __asm__ volatile (""); }}\n'
    )
    (ready,) = select(["avr"])
    found = examine(CFile.read(code.path), ready.toolchain).violations
    assert f"{name} runs by itself, expected none" in found


def test_position_independent_code_for_another_word_size_is_sound_too(tmp_path: Path) -> None:
    zig = zig_compiler("x86-linux-gnu")
    assert zig is not None
    code = written(champion("BipedalWalker-v3", seed=1), tmp_path, "table")
    assert loading_violations(code, zig, ("-std=c99", "-Os", "-ffreestanding")) == []


@pytest.mark.parametrize(
    ("line", "violation"),
    [
        ("if (observation[0] > 3) { volatile int stop = observation[0]; (void)stop; }", "is a conditional branch"),
        (
            "volatile int32_t product = observation[0]; product = product * observation[1];",
            "is a multiplication or division",
        ),
    ],
)
def test_branches_and_multiplications_are_found_in_the_machine_code(line: str, violation: str, tmp_path: Path) -> None:
    code = with_line(written(plain_champion(), tmp_path), line)
    assert any(violation in found for found in examine(code, chip()).violations)


def test_the_table_style_may_branch_on_its_table(tmp_path: Path) -> None:
    assert examine(written(plain_champion(), tmp_path, "table"), chip()).violations == ()


GRAPH = """\
graph: { title: "w.c"
node: { title: "w.c:leaf" label: "leaf\\nw.c:1:1\\n8 bytes (static)" }
node: { title: "w.c:deep" label: "deep\\nw.c:2:1\\n40 bytes (static)" }
node: { title: "w_step" label: "w_step\\nw.c:3:1\\n16 bytes (static)" }
node: { title: "w_odd" label: "w_odd\\nw.c:4:1\\n16 bytes (dynamic)" }
node: { title: "memcpy" label: "memcpy\\n<built-in>" shape : ellipse }
node: { title: "w_copy" label: "w_copy\\nw.c:5:1\\n4 bytes (static)" }
edge: { sourcename: "w_step" targetname: "w.c:deep" label: "w.c:3:5" }
edge: { sourcename: "w_step" targetname: "w.c:leaf" label: "w.c:3:6" }
edge: { sourcename: "w.c:deep" targetname: "w.c:leaf" label: "w.c:2:6" }
edge: { sourcename: "w_copy" targetname: "memcpy" label: "w.c:2:6" }
}
"""


@pytest.mark.parametrize(("function", "depth"), [("w_step", 64), ("w.c:leaf", 8), ("w_odd", None), ("w_copy", None)])
def test_the_stack_is_that_of_the_deepest_chain_of_calls(function: str, depth: int | None) -> None:
    assert stack_depth(GRAPH, function) == depth


def test_a_recursion_has_no_depth() -> None:
    graph = GRAPH + 'edge: { sourcename: "w.c:leaf" targetname: "w_step" label: "w.c:1:1" }\n'
    assert stack_depth(graph, "w_step") is None
