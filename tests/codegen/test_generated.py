# SPDX-License-Identifier: MIT
"""The text of the generated C: stable, warning-free in C99 and C++, with names and comments that can't break out."""

from __future__ import annotations

import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bitneat.codegen import CNameError, CodegenError, GeneratedC, check_name, code_bytes, generate, selftest
from bitneat.codegen.generate import table_encodings
from bitneat.codegen.names import check_file_stem, check_member_name
from bitneat.codegen.runtime import interpreter, known_answers
from bitneat.controller import BoxAction, Constant, Controller, DiscreteAction, Input, Link, Node, Signal
from bitneat.native.compiler import Compiler, CompilerError, host_compiler, identify, zig_compiler
from bitneat.native.data import runtime_dir
from tests.compiled import WARNINGS
from tests.strategies import random_controller

GOLDEN = Path(__file__).parent / "golden"
REFRESH = bool(os.environ.get("BITNEAT_REFRESH_GOLDEN"))
"""Run with BITNEAT_REFRESH_GOLDEN=1 to write the golden files anew, then read the difference."""

LEGS = Controller(
    inputs=(Input(0, 2047), Input(2, 300), Input()),
    nodes=(
        Node((Link(0), Link(1, sign=-1)), bias=256, gain=-1, activation="tanh"),
        Node((Link(3), Link(2, delay=1, sign=-1), Link(4, delay=1)), activation="clamped"),
        Node((Link(0, sign=-1), Link(4)), gain=2, activation="hat"),
    ),
    outputs=(Signal(4), Signal(5)),
)
CHOICE = Controller((Input(), Input()), (Node((Link(0), Link(1))),), (Signal(0), Signal(2), Signal(1)), 6)


def legs(style: str, **options: object) -> GeneratedC:
    action = BoxAction((-1.0, 0.0), (1.0, 2.5), (2,), "float32")
    return generate(LEGS, "legs", style, action=action, environment_id="Legs-v0", **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("style", ["unrolled", "table"])
def test_generated_files_are_what_they_were(style: str) -> None:
    code = legs(style)
    texts = {f"legs_{style}.h": code.header, f"legs_{style}.c": code.source}
    if style == "unrolled":
        texts["legs_selftest.c"] = selftest(code, LEGS)
    for name, text in texts.items():
        if REFRESH:
            GOLDEN.mkdir(exist_ok=True)
            (GOLDEN / name).write_text(text)
        assert text == (GOLDEN / name).read_text()


def test_the_generated_parts_of_the_runtime_are_up_to_date() -> None:
    for path, text in (("src/interpreter.c", interpreter()), ("tests/known_answers.h", known_answers())):
        assert (runtime_dir() / path).read_text() == text, "run python -m bitneat.codegen.runtime"


def test_generation_does_not_depend_on_hash_seed_or_locale() -> None:
    program = (
        "from tests.codegen.test_generated import legs; import hashlib;"
        "print(hashlib.sha256((legs('table').source + legs('auto', guard=True).header).encode()).hexdigest())"
    )
    seen = set()
    for seed, locale in (("0", "C"), ("1", "C.UTF-8"), ("77", "de_DE.UTF-8")):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "LC_ALL": locale, "TZ": f"UTC+{seed[0]}"}
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            check=True,
        )
        seen.add(done.stdout)
    assert len(seen) == 1


def compilers() -> list[tuple[Compiler, str]]:
    """The C and C++ compilers of this machine, and ziglang's clang for both."""
    found = [(host_compiler(), "-std=c99")]
    for command in ("gcc", "clang", "clang-14"):
        found += [(c, "-std=c99") for c in [identify([command])] if c]
    for command in ("g++", "clang++", "clang++-14"):
        found += [(c, "-std=c++11") for c in [identify([command])] if c]
    zig = zig_compiler()
    assert zig is not None, "ziglang is a dependency"
    found.append((zig, "-std=c99"))
    found.append((Compiler((*zig.command[:-1], "c++"), zig.family, zig.version), "-std=c++11"))
    return found


@pytest.mark.parametrize("style", ["unrolled", "table"])
@pytest.mark.parametrize("guard", [False, True])
def test_generated_code_compiles_without_a_warning_as_c99_and_cxx(tmp_path: Path, style: str, guard: bool) -> None:
    sources = []
    controllers = [LEGS, CHOICE, *(random_controller(random.Random(seed)) for seed in range(500, 505))]
    for number, controller in enumerate(controllers):
        if all(isinstance(output, Constant) for output in controller.canonical.outputs):
            continue
        action = DiscreteAction(len(controller.outputs), -3) if number % 2 else None
        code = generate(controller, f"c{number}", style, guard=guard, action=action)  # type: ignore[arg-type]
        (tmp_path / f"c{number}.h").write_text(code.header)
        (tmp_path / f"c{number}.c").write_text(code.source)
        (tmp_path / f"c{number}_selftest.c").write_text(selftest(code, controller))
        sources += [f"c{number}.c", f"c{number}_selftest.c"]
    unity = tmp_path / "unity"
    text = "".join(f'#include "{name}"\n' for name in sources)
    families = set()
    for compiler, standard in compilers():
        source = unity.with_suffix(".c" if standard == "-std=c99" else ".cpp")
        source.write_text(text)
        out = tmp_path / "unity.o"
        for level in ("-O0", "-O2"):
            command = [*compiler.command, standard, *WARNINGS, level, "-c", str(source), "-o", str(out)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{compiler.title} {standard}: {done.stderr[:2000]}"
        families.add((compiler.family, standard))
    assert any(family in ("clang", "zig") and standard == "-std=c++11" for family, standard in families)


@pytest.mark.parametrize("style", ["unrolled", "table"])
@pytest.mark.parametrize("controller", [LEGS, CHOICE])
def test_the_selftest_passes_and_catches_a_fault(tmp_path: Path, style: str, controller: Controller) -> None:
    code = generate(controller, "legs", style)  # type: ignore[arg-type]
    (tmp_path / "legs.h").write_text(code.header)
    (tmp_path / "legs_selftest.c").write_text(selftest(code, controller))
    command = [
        *host_compiler().command,
        "-std=c99",
        "-O2",
        "-DLEGS_SELFTEST_MAIN",
        "legs.c",
        "legs_selftest.c",
        "-o",
        "t",
    ]
    end = code.source.index("};", code.source.index("_weights[" if style == "unrolled" else "_body["))
    last = code.source.rindex("0x", 0, end) + 3
    faulty = f"{code.source[:last]}{int(code.source[last], 16) ^ 1:x}{code.source[last + 1 :]}"
    for text, expected in ((code.source, 0), (faulty, 1)):
        (tmp_path / "legs.c").write_text(text)
        subprocess.run(command, cwd=tmp_path, check=True)
        assert subprocess.run([tmp_path / "t"], check=False).returncode == expected


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("", "no C identifier"),
        ("9lives", "no C identifier"),
        ("a-b", "no C identifier"),
        ("naïve", "no C identifier"),
        ("x\n#include", "no C identifier"),
        ("int", "reserved word"),
        ("class", "reserved word"),
        ("restrict", "reserved word"),
        ("_walker", "reserve"),
        ("a__b", "reserve"),
        ("walker_", "reserve"),
        ("uint8", "belong"),
        ("bn", "belong"),
        ("bn_population", "belong"),
        ("bitneat_runtime", "belong"),
        ("w" * 41, "at most 40"),
    ],
)
def test_a_name_that_cannot_prefix_c_is_refused(name: str, why: str) -> None:
    with pytest.raises(CNameError, match=why) as caught:
        check_name(name)
    assert "\n" not in str(caught.value)


def test_a_name_is_forty_characters_at_most_and_fifty_of_a_longer_one_are_shown() -> None:
    assert check_name("w" * 40) == "w" * 40
    for check in (check_name, check_member_name):
        with pytest.raises(CNameError, match=rf"^here: '{'-' * 50}' is no C identifier"):
            check("-" * 50, "here")
        with pytest.raises(CNameError, match=rf"^here: \"'{'-' * 50}'\" is no C identifier"):
            check("-" * 51, "here")


def test_foreign_text_cannot_leave_its_comment(tmp_path: Path) -> None:
    code = generate(LEGS, "legs", "unrolled", environment_id='x */ #error "out" /* \\\n??/ \x00é')
    comment = code.header[: code.header.index("#ifndef")]
    assert comment.count("*/") == 1
    assert comment.rstrip().endswith("*/")
    assert code.header.isascii()
    assert "\\" not in comment
    assert "?" not in comment


def test_a_controller_without_a_path_is_refused() -> None:
    constant = Controller((Input(),), (Node((), 256),), (Signal(1),))
    with pytest.raises(CodegenError, match="no path from any input to an output"):
        generate(constant, "walker")


def test_an_action_space_that_does_not_fit_is_refused() -> None:
    with pytest.raises(CodegenError, match="3 outputs, but its action space takes 2"):
        generate(CHOICE, "walker", action=DiscreteAction(2))


@pytest.mark.parametrize("start", [2**31 - 3, -(2**31)])
def test_a_choice_that_32_bits_cannot_name_is_refused(start: int) -> None:
    with pytest.raises(CodegenError, match=rf"^action space: start {start} does not fit 32 bits$"):
        generate(CHOICE, "walker", "table", action=DiscreteAction(3, start), encoding="bytes")
    nearest = start + (1 if start < 0 else -1)
    assert generate(CHOICE, "walker", "table", action=DiscreteAction(3, nearest), encoding="bytes")


def test_shifts_leave_the_dense_encodings_out_of_the_choice() -> None:
    shifted = Controller((Input(0, 9),), (Node((Link(0, shift=1),)),), (Signal(1),))
    assert set(table_encodings(shifted.canonical)) <= {"bytes", "rice"}


@pytest.mark.parametrize(
    ("bias", "activation", "start"),
    [
        (77, "relu", "UINT32_C(77)"),
        (-77, "relu", "UINT32_C(0) - UINT32_C(77)"),
        (0, "relu", "0"),
        (77, "clamped", "77U"),
        (-77, "clamped", "0U - 77U"),
        (0, "clamped", "0"),
    ],
)
def test_a_sum_starts_from_its_bias_in_twos_complement(bias: int, activation: str, start: str) -> None:
    node = Node((Link(0), Link(1, sign=-1)), bias, 0, activation)
    source = generate(Controller((Input(0, 900), Input(0, 900)), (node,), (Signal(2),)), "legs", "unrolled").source
    assert re.findall(r"(?:uint32_t|unsigned) sum0 = (.*);", source) == [start]


@pytest.mark.parametrize(
    ("links", "hidden"),
    [
        ((Link(0, shift=1), Link(1)), 0),
        ((Link(0), Link(1, shift=2)), 0),
        ((Link(0), Link(0, shift=1), Link(1, shift=1)), 4),  # all of the node's, each with both signs
        ((Link(0, shift=3), Link(0, shift=1)), 4),
        ((Link(0, 1), Link(0, shift=1)), 0),  # of another step
    ],
)
def test_shifts_of_what_is_read_with_several_are_hidden(links: tuple[Link, ...], hidden: int) -> None:
    made = Controller((Input(0, 90), Input(0, 90)), (Node(links, 0, 0, "clamped"),), (Signal(2),))
    source = generate(made, "legs", "unrolled").source
    assert len(re.findall(r"legs_opaque\(\(\w+\)\S+ << \d\)", source)) == hidden


def test_a_node_is_described_as_a_formula() -> None:
    node = Node((Link(0, sign=-1), Link(1, sign=-1)), -77, 2, "clamped")
    text = generate(Controller((Input(0, 9), Input(0, 9)), (node,), (Signal(2),)), "legs", "unrolled").source
    assert "/* clamped((-x0 - x1 - 77) * 2^2) */" in text


@pytest.mark.parametrize(("limit", "clips"), [(16383, False), (16384, True)])
def test_a_sum_is_clipped_only_where_it_can_be_beyond_a_signal(limit: int, clips: bool) -> None:
    node = Node((Link(0), Link(1)), 0, 0, "identity")
    made = Controller((Input(0, limit), Input(0, 16384)), (node,), (Signal(2),))
    assert ("legs_clip(sum0" in generate(made, "legs", "unrolled").source) == clips


def test_of_a_long_stem_fifty_characters_are_shown() -> None:
    assert check_file_stem("w" * 200, "-o") == "w" * 200
    with pytest.raises(CNameError, match=rf"^-o: '{'!' * 50}' cannot name C files"):
        check_file_stem("!" * 50, "-o")
    with pytest.raises(CNameError, match=rf"^-o: \"'{'!' * 50}'\" cannot name C files"):
        check_file_stem("!" * 51, "-o")


@pytest.mark.parametrize("language", ["c", "c++"])
def test_no_name_that_is_let_pass_is_a_macro_or_a_word_of_a_compiler_called_without_a_standard(language: str) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("needs gcc")
    command = [compiler, "-x", language, "-dM", "-E", os.devnull]
    defined = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    for name in {line.split()[1] for line in defined.splitlines()} | {"typeof", "asm", "typeof_unqual"}:
        for check in (check_name, check_member_name):
            with pytest.raises(CNameError):
                check(name, "map")


def test_no_header_of_the_c_library_is_hidden() -> None:
    for name in ("stdint", "string", "math", "Features"):
        with pytest.raises(CNameError, match=rf"^here: {name}\.h is a header of the C library"):
            check_file_stem(name, "here")
    with pytest.raises(CNameError, match=r"^header name: time\.h is a header"):
        generate(CHOICE, "time", "unrolled")
    assert generate(CHOICE, "time", "unrolled", header_name="clock.h").name == "time"


def test_a_table_shifts_by_a_field_only_where_gains_differ() -> None:
    for gains, shifts in (((-2, -2), False), ((-2, 1), True)):
        nodes = tuple(Node((Link(0), Link(1, sign=-1)), 0, gain, "clamped") for gain in gains)
        controller = Controller((Input(0, 900), Input(0, 700)), nodes, (Signal(2), Signal(3)))
        text = generate(controller, "legs", "table", encoding="bytes").source
        assert ("floor_shift_by_sign" in text) == shifts
        assert ("fields" in text) == shifts
    nodes = tuple(Node((Link(0), Link(1, sign=-1)), 0, gain, "clamped") for gain in (0, 2))
    up = Controller((Input(0, 900), Input(0, 700)), nodes, (Signal(2), Signal(3)))
    assert "floor_shift_by_sign" not in generate(up, "legs", "table", encoding="bytes").source  # none is shifted down


def test_files_are_written_whole_under_the_name_that_the_source_includes(tmp_path: Path) -> None:
    code = generate(CHOICE, "walker", "unrolled", header_name="legs.h")
    source, header = code.write(tmp_path)
    assert (source.name, header.name) == ("walker.c", "legs.h")
    assert (source.read_text(), header.read_text()) == (code.source, code.header)
    assert '#include "legs.h"' in code.source


def test_a_member_of_a_struct_has_a_name_of_forty_letters_at_most() -> None:
    assert check_member_name("x" * 40, "map") == "x" * 40
    with pytest.raises(CNameError, match=r"^map: 41 characters long, expected at most 40$"):
        check_member_name("x" * 41, "map")


def test_auto_takes_the_style_that_compiles_smaller() -> None:
    rng = random.Random(3)
    large = random_controller(rng, num_inputs=24, num_nodes=30, num_outputs=4, ternary=True, activations=["clamped"])
    small = Controller((Input(0, 2047),), (Node((Link(0),)),), (Signal(1),))
    for controller, expected in ((large, "table"), (small, "unrolled")):
        sizes = {style: code_bytes(generate(controller, "w", style)) for style in ("unrolled", "table")}  # type: ignore[arg-type]
        assert generate(controller, "w").style == expected == min(sizes, key=sizes.__getitem__)


def test_decide_is_the_argmax_with_the_lowest_index_of_equals(tmp_path: Path) -> None:
    code = generate(CHOICE, "w", "unrolled", action=DiscreteAction(3, start=-5))
    (tmp_path / "w.h").write_text(code.header)
    values = (-32767, -1, 0, 1, 32767)
    rows = [(a, b, c) for a in values for b in values for c in values]
    checks = ""
    for row in rows:
        best = max(range(3), key=row.__getitem__) - 5
        checks += "    {{ const int16_t y[3] = {{{}, {}, {}}}; if (w_decide(y) != {}) return 1; }}\n".format(*row, best)
    (tmp_path / "main.c").write_text(f"{code.source}\nint main(void)\n{{\n{checks}\n    return 0;\n}}\n")
    command = [*host_compiler().command, "-std=c99", "-O2", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    subprocess.run([*command, "main.c", "-o", "t"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "t"], check=False).returncode == 0


@pytest.mark.parametrize("style", ["unrolled", "table"])
def test_the_guard_takes_any_int16(tmp_path: Path, style: str) -> None:
    guarded = generate(LEGS, "guarded", style, guard=True)  # type: ignore[arg-type]
    plain = generate(LEGS, "plain", style)  # type: ignore[arg-type]
    for code in (guarded, plain):
        (tmp_path / f"{code.name}.h").write_text(code.header)
        (tmp_path / f"{code.name}.c").write_text(code.source)
    (tmp_path / "main.c").write_text(
        '#include "guarded.c"\n#include "plain.c"\n'
        "static int16_t clip(int16_t x, int16_t l) { return x > l ? l : x < -l ? (int16_t)-l : x; }\n"
        "int main(void)\n{\n    struct guarded_state a; struct plain_state b; int16_t y[2], z[2];\n"
        "    guarded_reset(&a); plain_reset(&b);\n"
        "    for (long i = -32768; i < 32768; i += 7) {\n"
        "        const int16_t x[3] = {(int16_t)i, (int16_t)-i, (int16_t)(i ^ 0x55)};\n"
        "        const int16_t w[3] = {clip(x[0], 2047), clip(x[1], 300), clip(x[2], 32767)};\n"
        "        guarded_step(&a, x, y); plain_step(&b, w, z);\n"
        "        if (y[0] != z[0] || y[1] != z[1]) return 1;\n    }\n    return 0;\n}\n"
    )
    command = [*host_compiler().command, "-std=c99", "-O2", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    subprocess.run([*command, "main.c", "-o", "t"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "t"], check=False).returncode == 0


@pytest.mark.parametrize("stem", ['a"b', "a\nb", "é", "", ".hidden", "a b"])
def test_a_file_name_that_cannot_stand_in_an_include_is_refused(stem: str) -> None:
    with pytest.raises(CNameError, match="cannot name C files") as caught:
        generate(LEGS, "legs", "unrolled", header_name=f"{stem}.h")
    assert "\n" not in str(caught.value)


def test_without_ziglang_nothing_is_chosen_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["bitneat.codegen.generate"], "zig_compiler", lambda target: None)
    with pytest.raises(CompilerError, match="pip install ziglang"):
        generate(LEGS, "legs")
    assert generate(LEGS, "legs", "unrolled").style == "unrolled"
    assert generate(LEGS, "legs", "table", encoding="bytes").encoding == "bytes"
