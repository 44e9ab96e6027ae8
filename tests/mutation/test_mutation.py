# SPDX-License-Identifier: MIT
"""The mutators change what they say, what judges them sees it, and what survives is argued."""

from __future__ import annotations

import ast
import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutation import c_source, python_source
from tests.mutation.run_c import Judge, all_mutants
from tests.mutation.survivors import arguments_of

ROOT = Path(__file__).resolve().parents[2]
CORE = [path for part in ("controller", "codegen", "verify") for path in (ROOT / "bitneat" / part).rglob("*.py")]

PYTHON = """
LIMIT = 4
def clip(x: int = 3, *, low: int = 1) -> int:
    \"\"\"Say + nothing.\"\"\"
    if TYPE_CHECKING:
        low += 1
    total = 0
    for i in range(x):
        if i < low and not i == 2:
            total += i << 1
            continue
    text = "a" + f"{total + 1}"
    return max(total, low) if text is not None else -total
"""

C = """\
#include "x.h"
/* x + 1 */
#if defined(__AVR__)
    a = b + 1;
#else
static int16_t f(int16_t x, const uint8_t *next)
{
    uint32_t sum = x + 12U;
    sum <<= 3;
    {% if m.shift %}
    sum += *next++ & {{ mask }};
    {% endif %}
    __asm__("" : "+r"(sum));
    return (int16_t)sum;
}
#endif
"""


def test_python_is_changed_where_it_computes_and_nowhere_else() -> None:
    found = python_source.mutants("x.py", PYTHON)
    changes = {(mutant.before, mutant.after) for mutant in found}
    assert {
        ("LIMIT = 4", "LIMIT = 5"),
        ("i < low", "i <= low"),
        ("i < low", "i >= low"),
        ("i == 2", "i != 2"),
        ("i < low and (not i == 2)", "i < low or not i == 2"),
        ("total += i << 1", "total -= i << 1"),
        ("total += i << 1", "pass"),
        ("i << 1", "i >> 1"),
        ("continue", "pass"),
        ("max(total, low)", "min(total, low)"),
        ("text is not None", "text is None"),
        ("-total", "+total"),
        ("total + 1", "total - 1"),
    } <= changes
    assert not any("nothing" in before or before == "low += 1" for before, _ in changes)
    assert ("'a' + f'{total + 1}'", "'a' - f'{total + 1}'") not in changes
    for mutant in found:
        changed = python_source.mutated(PYTHON, mutant.number)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(PYTHON)), mutant
    assert [mutant.number for mutant in found] == list(range(len(found)))


def test_c_is_changed_where_the_host_compiles_it_and_nowhere_else() -> None:
    found = c_source.mutants("x.c.j2", C)
    changes = {(mutant.before, mutant.after) for mutant in found}
    assert {
        ("uint32_t sum = x + 12U;", "uint32_t sum = x - 12U;"),
        ("uint32_t sum = x + 12U;", "uint32_t sum = x;"),
        ("uint32_t sum = x + 12U;", "uint32_t sum = x + 13U;"),
        ("uint32_t sum = x + 12U;", "uint32_t sum = x + 0U;"),
        ("uint32_t sum = x + 12U;", "uint16_t sum = x + 12U;"),
        ("sum <<= 3;", "sum >>= 3;"),
        ("sum <<= 3;", ";"),
        ("{% if m.shift %}", "{% if not (m.shift) %}"),
        ("sum += *next++ & {{ mask }};", "sum += *next++ | {{ mask }};"),
        ("sum += *next++ & {{ mask }};", "sum += *next & {{ mask }};"),
        ("return (int16_t)sum;", "return (int8_t)sum;"),
    } <= changes
    assert not any(word in before for before, _ in changes for word in ("__asm__", "include", "a = b", "/*"))
    for mutant in found:
        changed = mutant.applied(C)
        assert changed != C
        assert mutant.after in changed
        assert len(C.splitlines()) == len(changed.splitlines())


def test_c_that_python_prints_is_changed_outside_its_fields() -> None:
    source = '''
def term(x, k):
    """x << k"""
    if k > 3:
        raise ValueError(f"{k} > 3")
    return f"({x} << {k + 1}) - 1U"
'''
    changes = {(m.before, m.after) for m in c_source.mutants("view.py", source)}
    line = 'return f"({x} << {k + 1}) - 1U"'
    assert (line, line.replace("<<", ">>")) in changes
    assert (line, line.replace("- 1U", "- 0U")) in changes
    assert {before for before, _ in changes} == {line}


def test_there_are_hundreds_of_mutants_and_each_argument_is_about_one_of_them() -> None:
    python = [m for path in CORE for m in python_source.mutants(str(path.relative_to(ROOT)), path.read_text())]
    of_c = [m for _, listed in all_mutants().values() for m in listed]
    assert len(python) > 2000
    assert min(Counter(m.kind for m in of_c).values()) > 50
    for kind, keys in (("python", {m.key for m in python}), ("c", {m.key for m in of_c})):
        arguments = arguments_of(kind)
        assert set(arguments) <= keys, sorted(set(arguments) - keys)
        assert all(len(why) > 10 for why in arguments.values())


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Judge]:
    return Judge(tmp_path_factory.mktemp("judge"), sanitize=False)


def test_a_sample_of_the_mutants_of_c_is_killed(judge: Judge) -> None:
    found = all_mutants()
    argued = arguments_of("c")
    # Of the narrowed types many hold every value there is, and not all are argued one by one.
    listed = [m for _, mutants in found.values() for m in mutants if m.key not in argued and m.kind != "type"]
    for mutant in random.Random(3).sample(listed, 16 if judge.fast else 3):
        outcome = judge.judge(mutant, found[mutant.path][0])
        assert not outcome.survived, f"{mutant.path}:{mutant.line}: {mutant.before} -> {mutant.after}"
