# SPDX-License-Identifier: MIT
"""The native walker under the sanitizers: no complaint, and the same bits as the fast build's."""

from __future__ import annotations

import random
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bitneat.native.compiler import host_compiler
from bitneat.runtime import pack_for_runtime
from bitneat.sim.environment import Shaping, decode_table, used_inputs
from bitneat.sim.walker import binding as native
from bitneat.sim.walker.episodes import ACTION, FIRST_RAY, evaluate
from tests.sim.walker_builds import program
from tests.sim.walkers import NativeWalkers, champion
from tests.strategies import random_controller

STEPPED = 100
STEPS = 160
RUNS = 12
"""Grounds on which each controller runs, in each mode."""

MAIN = r"""
#include <stdio.h>
#include <stdlib.h>
#include "bitneat/runtime.h"
#include "simulator.h"

enum { STEPPED = @STEPPED@, STEPS = @STEPS@, RUNS = @RUNS@, CONTROLLERS = @CONTROLLERS@ };

@BLOBS@

static void get(void *to, size_t size)
{
    if (fread(to, 1, size, stdin) != size) {
        exit(3);
    }
}

/* Every other one in hardcore mode; who has terminated steps no more. */
static void step_all(int32_t lanes, int32_t threads)
{
    static float actions[STEPS][STEPPED][4];
    static struct pcg64 seeds[STEPPED];
    /* Of its exact size, so that a step beyond its end is seen. */
    struct environment *environments = malloc(STEPPED * sizeof *environments);
    int32_t which[STEPPED];
    int32_t count = STEPPED;
    get(seeds, sizeof seeds);
    get(actions, sizeof actions);
    if (environments == NULL || (size_t)simulator_environment_size() != sizeof *environments) {
        exit(4);
    }
    for (int32_t i = 0; i < STEPPED; ++i) {
        simulator_seed(environments, i, &seeds[i], i % 2);
        which[i] = i;
    }
    float *observations = malloc(STEPPED * 24 * sizeof *observations);
    float *chosen = malloc(STEPPED * 4 * sizeof *chosen);
    double *rewards = malloc(STEPPED * sizeof *rewards);
    uint8_t *terminated = malloc(STEPPED);
    simulator_reset(environments, which, count, observations, lanes, threads);
    fwrite(observations, sizeof *observations, (size_t)count * 24, stdout);
    for (int step = 0; step < STEPS && count > 0; ++step) {
        for (int32_t i = 0; i < count; ++i) {
            for (int k = 0; k < 4; ++k) {
                chosen[4 * i + k] = actions[step][which[i]][k];
            }
        }
        if (!simulator_step(environments, which, count, chosen, observations, rewards, terminated, lanes, threads)) {
            exit(5);
        }
        fwrite(observations, sizeof *observations, (size_t)count * 24, stdout);
        fwrite(rewards, sizeof *rewards, (size_t)count, stdout);
        int32_t left = 0;
        for (int32_t i = 0; i < count; ++i) {
            which[left] = which[i];
            left += terminated[i] == 0;
        }
        count = left;
    }
    free(environments);
    free(observations);
    free(chosen);
    free(rewards);
    free(terminated);
}

static void run_all(int32_t lanes, int32_t threads)
{
    static struct bn_controller controllers[CONTROLLERS];
    static double factor[CONTROLLERS][24], limit[CONTROLLERS][24];
    struct policy policies[CONTROLLERS];
    float *actions[CONTROLLERS];
    static struct pcg64 seeds[RUNS];
    static struct episode episodes[RUNS * CONTROLLERS];
    struct result results[RUNS * CONTROLLERS];
    const struct shaping shaping = {-100.0, -5.0, 10.0, 0.1, 150, 100};
    const volatile int32_t stop = 0;
    for (int i = 0; i < CONTROLLERS; ++i) {
        int32_t one, rays;
        get(&one, sizeof one);
        get(&rays, sizeof rays);
        get(factor[i], sizeof factor[i]);
        get(limit[i], sizeof limit[i]);
        const size_t size = 4 * (2 * (size_t)one + 1) * sizeof *actions[i];
        actions[i] = malloc(size);
        get(actions[i], size);
        static int16_t workspace[1 << 16];
        if (bn_open(&controllers[i], blobs[i], blob_sizes[i]) != BN_OK || bn_validate(&controllers[i], workspace) != BN_OK) {
            exit(6);
        }
        const struct policy policy = {&controllers[i], NULL, factor[i], limit[i], actions[i], one, (uint32_t)rays};
        policies[i] = policy;
    }
    get(seeds, sizeof seeds);
    for (int i = 0; i < RUNS * CONTROLLERS; ++i) {
        episodes[i].policy = i % CONTROLLERS;
        episodes[i].ground = i / CONTROLLERS;
    }
    for (int hardcore = 0; hardcore < 2; ++hardcore) {
        if (!simulator_run(policies, seeds, hardcore, episodes, RUNS * CONTROLLERS, &shaping, results, lanes, threads, &stop)) {
            exit(7);
        }
        for (int i = 0; i < RUNS * CONTROLLERS; ++i) {
            const double numbers[4] = {results[i].reward, results[i].shaped, results[i].steps,
                                       results[i].terminated + 2 * results[i].stalled + 4 * results[i].failed};
            fwrite(numbers, sizeof numbers, 1, stdout);
        }
    }
    for (int i = 0; i < CONTROLLERS; ++i) {
        free(actions[i]);
    }
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        return 2;
    }
    simulator_open();
    step_all(atoi(argv[1]), atoi(argv[2]));
    run_all(atoi(argv[1]), atoi(argv[2]));
    return 0;
}
"""

CONTROLLERS = (champion(), *(random_controller(random.Random(n), num_inputs=24, num_outputs=4) for n in range(4)))
SHAPING = Shaping(-100.0, -5.0, 10.0, 150, 100, 0.1)


def main_source() -> str:
    blobs = [pack_for_runtime(controller) for controller in CONTROLLERS]
    lines = [f"static const uint8_t blob_{i}[] = {{{','.join(map(str, blob))}}};" for i, blob in enumerate(blobs)]
    names = ", ".join(f"blob_{i}" for i in range(len(blobs)))
    sizes = ", ".join(f"sizeof blob_{i}" for i in range(len(blobs)))
    lines.append(f"static const uint8_t *const blobs[] = {{{names}}};")
    lines.append(f"static const size_t blob_sizes[] = {{{sizes}}};")
    values = {
        "STEPPED": STEPPED,
        "STEPS": STEPS,
        "RUNS": RUNS,
        "CONTROLLERS": len(CONTROLLERS),
        "BLOBS": "\n".join(lines),
    }
    source = MAIN
    for name, value in values.items():
        source = source.replace(f"@{name}@", str(value))
    return source


def seeds_data(count: int) -> bytes:
    generators = (np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed))) for seed in range(count))
    return b"".join(bytes(native.ffi().buffer(native.random_state(generator))) for generator in generators)


def actions_given() -> np.ndarray:  # type: ignore[type-arg]
    """Uniform ones, held for a while, and beyond the bounds: by step and walker."""
    rng = np.random.default_rng(5)
    actions = rng.uniform(-1, 1, (STEPS, STEPPED, 4))
    held = np.repeat(rng.choice([-3.0, -1.0, 0.0, 1.0, np.inf], (STEPS // 20, STEPPED, 4)), 20, axis=0)
    return np.where(np.arange(STEPPED)[:, None] % 3 == 0, actions, held).astype(np.float32)


def input_data() -> bytes:
    parts = [seeds_data(STEPPED), actions_given().tobytes()]
    for c in CONTROLLERS:
        rays = sum(1 << (i - FIRST_RAY) for i in used_inputs(c) if i >= FIRST_RAY)
        parts.append(np.array([1 << c.frac_bits, rays], np.int32).tobytes())
        parts.append(np.array([2.0 ** (c.frac_bits + i.scale) for i in c.inputs]).tobytes())
        parts.append(np.array([float(i.limit) for i in c.inputs]).tobytes())
        parts.append(decode_table(ACTION, c.frac_bits).astype(np.float32).tobytes())
    return b"".join((*parts, seeds_data(RUNS)))


def wanted_output() -> bytes:
    """What the program has to print, by the ordinary build."""
    walkers, actions = NativeWalkers(STEPPED), actions_given()
    parts = [walkers.reset(range(STEPPED), [(i, bool(i % 2)) for i in range(STEPPED)]).tobytes()]
    which = np.arange(STEPPED)
    for step in range(STEPS):
        if not which.size:
            break
        answer = walkers.step(which.tolist(), actions[step, which])
        parts += [answer.observations.tobytes(), answer.rewards.tobytes()]
        which = which[answer.terminated == 0]
    for hardcore in (False, True):
        rows = evaluate(CONTROLLERS, range(RUNS), 150, SHAPING, hardcore=hardcore)
        for seed in range(RUNS):
            for row in rows:
                e = row[seed]
                parts.append(
                    np.array([e.reward, e.shaped, e.steps, e.terminated + 2 * e.stalled], np.float64).tobytes()
                )
    return b"".join(parts)


def runs_with(sanitizers: str, folder: Path) -> bool:
    """True iff an empty program does."""
    (folder / "empty.c").write_text("int main(void) { return 0; }")
    flags = [f"-fsanitize={sanitizers}", str(folder / "empty.c"), "-o", str(folder / "empty")]
    compiled = subprocess.run([*host_compiler().command, *flags], capture_output=True, check=False)
    return (
        compiled.returncode == 0
        and subprocess.run([folder / "empty"], capture_output=True, check=False).returncode == 0
    )


@pytest.mark.parametrize(
    ("sanitizers", "settings"),
    [
        pytest.param("address,undefined,float-cast-overflow", [(1, 1), (4, 1), (8, 2), (16, 1)], id="address"),
        pytest.param("thread", [(1, 4), (16, 3)], id="thread"),
    ],
)
def test_sanitizers_have_nothing_to_say(sanitizers: str, settings: list[tuple[int, int]], tmp_path: Path) -> None:
    if sanitizers == "thread" and not runs_with(sanitizers, tmp_path):
        pytest.skip("the compiler's thread sanitizer does not run here, as with some kernels' layouts of memory")
    flags = ["-O1", f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all", "-g0"]
    walker = program(main_source(), flags, tmp_path)
    data, wanted = input_data(), wanted_output()
    for lanes, threads in settings:
        done = subprocess.run([walker, str(lanes), str(threads)], input=data, capture_output=True, check=False)
        message = done.stderr.decode(errors="replace")[:3000]
        assert done.returncode == 0, f"{lanes} lanes, {threads} threads: exit {done.returncode}: {message}"
        assert not message
        assert done.stdout == wanted
