# SPDX-License-Identifier: MIT
"""One program that runs every subject of the corpus in every implementation, and says which first gives another bit.

The program reads all inputs and expected outputs from a file. Observations lie in memory of exactly their size; what an
implementation may write is filled with -32768 before each step (a state before its reset, a workspace, too), and what lies
behind it is looked at afterwards.
"""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bitneat.codegen import GeneratedC, generate, selftest
from bitneat.codegen.runtime import interpreter
from tests.mutation.corpus import Subject, encodings

RUNTIME_SOURCES = ("open", "reader", "validate", "population")
COMPILE = ("gcc", "-std=c99", "-w")
SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0")

MANY = 10000
"""Sequences of a subject that goes through all arguments."""

_HEAD = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "bitneat/runtime.h"

enum { BEHIND = 8, MARK = -32768 };

struct subject { long sequences, steps, inputs, outputs; int16_t *in, *out; };
struct generated { int subject; const char *name; void (*reset)(void); void (*step)(const int16_t *, int16_t *);
                   int32_t (*decide)(const int16_t *); int32_t start; };
struct packed { int subject; const char *name; const uint8_t *blob; size_t size; };
"""

_TAIL = r"""
static void *fresh(size_t count)
{
    int16_t *memory = malloc(2 * count + (count == 0));
    for (size_t i = 0; i < count; i++) memory[i] = MARK;
    return memory;
}

static void differs(const char *name, int subject, long sequence, long step, const char *what)
{
    printf("%s subject %d sequence %ld step %ld: %s\n", name, subject, sequence, step, what);
    exit(1);
}

static void compare(const char *name, int number, long sequence, long step, const int16_t *got)
{
    const struct subject *s = &subjects[number];
    if (memcmp(got, s->out + (sequence * s->steps + step) * s->outputs, 2 * (size_t)s->outputs) != 0)
        differs(name, number, sequence, step, "outputs");
    for (long i = s->outputs; i < s->outputs + BEHIND; i++) if (got[i] != MARK)
        differs(name, number, sequence, step, "written behind outputs");
}

static void run_generated(const struct generated *g)
{
    const struct subject *s = &subjects[g->subject];
    int16_t *in = fresh((size_t)s->inputs);
    int16_t *out = fresh((size_t)s->outputs + BEHIND);
    for (long q = 0; q < s->sequences; q++) {
        g->reset();
        for (long t = 0; t < s->steps; t++) {
            memcpy(in, s->in + (q * s->steps + t) * s->inputs, 2 * (size_t)s->inputs);
            for (long i = 0; i < s->outputs + BEHIND; i++) out[i] = MARK;
            g->step(in, out);
            compare(g->name, g->subject, q, t, out);
            if (memcmp(in, s->in + (q * s->steps + t) * s->inputs, 2 * (size_t)s->inputs) != 0)
                differs(g->name, g->subject, q, t, "inputs written");
            if (g->decide != NULL) {
                const int16_t *right = s->out + (q * s->steps + t) * s->outputs;
                long best = 0;
                for (long i = 1; i < s->outputs; i++) if (right[i] > right[best]) best = i;
                if (g->decide(right) != (int32_t)best + g->start) differs(g->name, g->subject, q, t, "decision");
            }
        }
    }
    free(in); free(out);
}

static void run_packed(const struct packed *p)
{
    const struct subject *s = &subjects[p->subject];
    uint8_t *blob = malloc(p->size);
    struct bn_controller c, d;
    memcpy(blob, p->blob, p->size);
    memset(&c, 0xA5, sizeof c);
    memset(&d, 0x5A, sizeof d);
    if (bn_controller_size() != sizeof c) differs(p->name, p->subject, 0, 0, "size");
    if (bn_open(&c, blob, p->size) != BN_OK) differs(p->name, p->subject, 0, 0, "open");
    /* Of sizes whose bits 32 bits can count the header alone is read here; larger ones are refused before anything is. */
    const size_t most = (size_t)UINT32_MAX / 8;
    if (bn_open(&d, blob, most) != BN_OK || bn_open(&d, blob, most + 1) != BN_ERROR_SIZE)
        differs(p->name, p->subject, 0, 0, "largest size");
    if (c.num_inputs != s->inputs || c.num_outputs != s->outputs) differs(p->name, p->subject, 0, 0, "shape");
    if (c.workspace_length < s->inputs + s->outputs - 1 && c.workspace_length < s->inputs)
        differs(p->name, p->subject, 0, 0, "workspace");
    const size_t length = c.workspace_length;
    int16_t *workspace = fresh(length);
    int16_t *state = fresh(c.num_state);
    int16_t *in = fresh((size_t)s->inputs);
    int16_t *out = fresh((size_t)s->outputs + BEHIND);
    if (bn_validate(&c, workspace) != BN_OK) differs(p->name, p->subject, 0, 0, "validate");
    for (long q = 0; q < s->sequences; q++) {
        for (size_t i = 0; i < c.num_state; i++) state[i] = MARK;
        bn_reset(&c, state);
        for (long t = 0; t < s->steps; t++) {
            memcpy(in, s->in + (q * s->steps + t) * s->inputs, 2 * (size_t)s->inputs);
            for (size_t i = 0; i < length; i++) workspace[i] = MARK;
            for (long i = 0; i < s->outputs + BEHIND; i++) out[i] = MARK;
            bn_step(&c, state, workspace, in, out);
            compare(p->name, p->subject, q, t, out);
        }
    }
    free(workspace); free(in); free(out);
    /* The same by whole jobs: two of them, so that one's place in the list matters. */
    const size_t count = (size_t)(s->sequences * s->steps);
    const size_t per = s->steps == 1 ? count : (size_t)s->steps;
    const size_t lanes = c.encoding == 0 && c.num_state == 0 ? BN_MAX_LANES : 1;
    int16_t *wide = fresh(length * lanes + BEHIND);
    int16_t *actions = fresh(per * (size_t)s->outputs + BEHIND);
    int16_t *second = fresh(7 * (size_t)s->outputs + BEHIND);
    for (size_t i = 0; i < c.num_state; i++) state[i] = MARK;
    bn_reset(&c, state);
    int16_t *other = fresh(c.num_state);
    bn_reset(&c, other);
    const size_t few = per < 7 ? per : 7;
    const struct bn_job jobs[] = {{&c, state, s->in, actions, per}, {&c, other, s->in, second, few}};
    bn_population_step(jobs, 2, wide);
    if (memcmp(actions, s->out, 2 * per * (size_t)s->outputs) != 0) differs(p->name, p->subject, 0, 0, "population");
    if (memcmp(second, s->out, 2 * few * (size_t)s->outputs) != 0) differs(p->name, p->subject, 0, 0, "second job");
    for (size_t i = per * (size_t)s->outputs; i < per * (size_t)s->outputs + BEHIND; i++) if (actions[i] != MARK)
        differs(p->name, p->subject, 0, 0, "behind actions");
    for (size_t i = length * lanes; i < length * lanes + BEHIND; i++) if (wide[i] != MARK)
        differs(p->name, p->subject, 0, 0, "behind workspace");
    free(wide); free(actions); free(second); free(state); free(other); free(blob);
}

int main(int count, char **arguments)
{
    FILE *file = fopen(arguments[1], "rb");
    if (count != 2 || file == NULL) return 2;
    for (size_t i = 0; i < sizeof subjects / sizeof *subjects; i++) {
        struct subject *s = &subjects[i];
        const size_t steps = (size_t)(s->sequences * s->steps);
        s->in = malloc(2 * steps * (size_t)s->inputs);
        s->out = malloc(2 * steps * (size_t)s->outputs);
        if (fread(s->in, 2 * (size_t)s->inputs, steps, file) != steps) return 2;
        if (fread(s->out, 2 * (size_t)s->outputs, steps, file) != steps) return 2;
    }
    fclose(file);
    for (size_t i = 0; i < sizeof generated / sizeof *generated; i++) run_generated(&generated[i]);
    for (size_t i = 0; i < sizeof packed / sizeof *packed; i++) run_packed(&packed[i]);
    for (size_t i = 0; i < sizeof subjects / sizeof *subjects; i++) { free(subjects[i].in); free(subjects[i].out); }
    return selftests();
}
"""


def write_data(subjects: Sequence[Subject], path: Path) -> None:
    """What the program reads: for each subject all inputs, then all outputs."""
    parts = [part for subject in subjects for part in (subject.case.inputs, subject.expected)]
    path.write_bytes(b"".join(np.ascontiguousarray(part, "<i2").tobytes() for part in parts))


Instance = tuple[int, str]
"""The number of a subject, and ``unrolled`` or the encoding of its table."""


def instances(subjects: Sequence[Subject], times: int = 2) -> list[Instance]:
    """Those whose C has a line, numbers and names apart, that fewer than ``times`` before it have."""
    seen: Counter[str] = Counter()
    chosen = []
    for number, subject in enumerate(subjects):
        kinds = ["unrolled", *encodings(subject.case.controller)][: 2 if len(subject.case.inputs) > MANY else None]
        for kind in kinds if subject.styles else []:
            code = _generated(subject, f"s{number}", kind)
            shapes = {_shape(line) for line in code.source.splitlines()}
            special = times > 1 and (subject.guard or subject.start is not None) and kind in ("unrolled", "bytes")
            if special or any(seen[shape] < times for shape in shapes):
                chosen.append((number, kind))
                seen.update(shapes)
    return chosen


def _shape(line: str) -> str:
    """A line of C without its numbers; lines of tables and comments are all the same."""
    if line.strip().startswith(("/*", "*", "0x")):
        return ""
    return re.sub(r"[0-9]+", "#", line)


def _generated(subject: Subject, name: str, kind: str) -> GeneratedC:
    style, encoding = ("unrolled", None) if kind == "unrolled" else ("table", kind)
    return generate(
        subject.case.controller,
        name,
        style,  # type: ignore[arg-type]
        guard=subject.guard,
        action=subject.action,
        encoding=encoding,
    )


def generated_source(subjects: Sequence[Subject], chosen: Sequence[Instance]) -> str:
    """The program's own text: the C of the chosen instances, and the blobs of all subjects."""
    texts = [_HEAD]
    rows, packed, tests = [], [], []
    for number, kind in chosen:
        subject, name = subjects[number], f"s{number}_{kind}"
        code = _generated(subject, name, kind)
        texts += [code.header, code.source.replace(f'#include "{name}.h"\n', "")]
        for entry in ("step",) if kind == "unrolled" or subject.guard else ("step", "run"):
            rows.append(_thunks(texts, name, number, subject, f"struct {name}_state" in code.header, entry=entry))
    for number, subject in enumerate(subjects):
        controller = subject.case.controller
        if subject.guard:
            continue
        if subject.styles and number % 16 == 0:
            code = generate(controller, f"t{number}", "unrolled")
            test = selftest(code, controller).replace(f'#include "t{number}.h"\n', "")
            texts += [
                code.header,
                code.source.replace(f'#include "t{number}.h"\n', ""),
                *_selftest(test, number, f"struct t{number}_state" in code.header),
            ]
            tests.append(number)
        # All arguments of the activations in one encoding: how links are written has nothing to do with them.
        for encoding in list(_blobs(subject))[: 1 if len(subject.case.inputs) > MANY else None]:
            texts.append(f"static const uint8_t blob{number}_{encoding}[] = {{{_blobs(subject)[encoding]}}};")
            packed.append(f'{{{number}, "{encoding}", blob{number}_{encoding}, sizeof blob{number}_{encoding}}},')
    texts.append("static int selftests(void)\n{")
    # An untouched step passes; one with a wrong output fails at that step.
    texts += [f"    if (t{n}_selftest() != 0 || wrong{n}_selftest() != 5) return 1;" for n in tests]
    texts += ["    return 0;\n}", "static struct subject subjects[] = {"]
    for subject in subjects:
        sequences, steps, inputs = subject.case.inputs.shape
        texts.append(f"    {{{sequences}, {steps}, {inputs}, {subject.expected.shape[2]}, 0, 0}},")
    texts += ["};", "static const struct generated generated[] = {", *rows, "};"]
    texts += ["static const struct packed packed[] = {", *packed, "};", _TAIL]
    return "\n".join(texts)


def _selftest(test: str, number: int, has_state: bool) -> list[str]:
    state = f"struct t{number}_state *state, " if has_state else ""
    argument = "state, " if has_state else ""
    place = "0" if number // 16 % 2 else f"T{number}_NUM_OUTPUTS - 1"
    return [
        test,
        f"static int calls{number};",
        f"static void wrong{number}({state}const int16_t *observation, int16_t *action)",
        f"{{ t{number}_step({argument}observation, action); if (++calls{number} == 5) action[{place}]++; }}",
        f"#define t{number}_step wrong{number}",
        f"#define t{number}_selftest wrong{number}_selftest",
        f"#define t{number}_test_inputs wrong{number}_inputs",
        f"#define t{number}_test_outputs wrong{number}_outputs",
        test,
        *(f"#undef t{number}_{word}" for word in ("step", "selftest", "test_inputs", "test_outputs")),
    ]


def _thunks(texts: list[str], name: str, number: int, subject: Subject, has_state: bool, *, entry: str) -> str:
    macro, own = name.upper(), f"{name}_{entry}"
    inputs, outputs = subject.case.inputs.shape[2], subject.expected.shape[2]
    texts.append(f"static struct {{ struct {name}_state s; int16_t behind; }} of_{own};" if has_state else "")
    reset = f"memset(&of_{own}, 0x80, sizeof of_{own}); {name}_reset(&of_{own}.s);" if has_state else ""
    texts.append(f"static void reset_{own}(void) {{ {reset} }}")
    state = f"&of_{own}.s, " if has_state else ""
    if entry == "step":
        body = f"{name}_step({state}o, a);"
    else:
        body = (
            f"int16_t *signals = malloc(2 * {macro}_NUM_SIGNALS);"
            f" for (int i = 0; i < {macro}_NUM_SIGNALS; i++) signals[i] = -32768; memcpy(signals, o, {2 * inputs});"
            f" {name}_run({state}signals); memcpy(a, signals + {macro}_NUM_SIGNALS - {outputs}, {2 * outputs}); free(signals);"
        )
    check = f" if (of_{own}.behind != (int16_t)0x8080) a[{outputs}] = 1;" if has_state else ""
    texts.append(f"static void step_{own}(const int16_t *o, int16_t *a) {{ {body}{check} }}")
    decide = f"{name}_decide" if subject.start is not None else "NULL"
    return f'{{{number}, "{own}", reset_{own}, step_{own}, {decide}, {subject.start or 0}}},'


def _blobs(subject: Subject) -> dict[str, str]:
    """The blobs as C has them; computed once, as no mutant changes them."""
    if id(subject) not in _BLOBS:
        _BLOBS[id(subject)] = {name: ",".join(map(str, blob)) for name, blob in subject.blobs().items()}
    return _BLOBS[id(subject)]


_BLOBS: dict[int, dict[str, str]] = {}


def runtime_source() -> str:
    """The interpreter as the templates and their views print it now, before it is written to ``runtime_c``."""
    return interpreter()


def compile_c(source: Path, target: Path, include: Sequence[Path], flags: Sequence[str]) -> str:
    """Compile to an object; the first error, or an empty text."""
    command = [*COMPILE, *flags, *(f"-I{folder}" for folder in include), "-c", str(source), "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else next((s for s in done.stderr.splitlines() if "error" in s), "error")
