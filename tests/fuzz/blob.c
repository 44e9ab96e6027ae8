/* SPDX-License-Identifier: MIT
 *
 * Any bytes at all as a blob: opened, validated, and run if they are valid, by libFuzzer under a sanitizer. All memory has exactly the
 * size that the runtime asks for, so that one byte too far is seen.
 */
#include "bitneat/runtime.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_feature)
#if __has_feature(memory_sanitizer)
#include <sanitizer/msan_interface.h>
#define WRITTEN_BY_LIBFUZZER(memory, size) __msan_unpoison(memory, size)
#endif
#endif
#ifndef WRITTEN_BY_LIBFUZZER
#define WRITTEN_BY_LIBFUZZER(memory, size) ((void)0)
#endif

enum { STEPS = 6, NOT_A_SIGNAL = -32768 };

static unsigned long num_valid;

static int16_t *signals(size_t count)
{
    int16_t *memory = malloc(count * sizeof(int16_t));
    if (memory == NULL && count != 0) {
        abort();
    }
    return memory;
}

/* Inputs that no limit of the blob allows, too: outputs may then be any, but nothing may be read or written outside. */
static void observe(const struct bn_controller *c, int step, const uint8_t *data, size_t size, int16_t *observation)
{
    for (size_t i = 0; i < c->num_inputs; i++) {
        const int any = data[(i * 7 + (size_t)step) % size] * 257 - 32768;
        observation[i] = (int16_t)(step == 0 ? 32767 : step == 1 ? -32767 : step == 2 ? -32768 : step == 3 ? 0 : any);
    }
}

static void run(const struct bn_controller *c, const uint8_t *data, size_t size)
{
    int16_t *workspace = signals(c->workspace_length);
    int16_t *state = c->num_state == 0 ? NULL : signals(c->num_state);
    int16_t *observations = signals((size_t)c->num_inputs * STEPS);
    int16_t *actions = signals((size_t)c->num_outputs * STEPS);
    int16_t *again = signals((size_t)c->num_outputs * STEPS);
    int16_t *lanes = signals((size_t)c->workspace_length * BN_MAX_LANES);
    bn_reset(c, state);
    for (int step = 0; step < STEPS; step++) {
        int16_t *action = actions + (size_t)step * c->num_outputs;
        observe(c, step, data, size, observations + (size_t)step * c->num_inputs);
        bn_step(c, state, workspace, observations + (size_t)step * c->num_inputs, action);
        for (size_t i = 0; i < c->num_outputs; i++) {
            /* An output may hand on an input, which here may be what no signal is. */
            if (action[i] == NOT_A_SIGNAL && step != 2 && step < 4) {
                abort();
            }
        }
    }
    bn_reset(c, state);
    const struct bn_job job = {c, state, observations, again, STEPS};
    bn_population_step(&job, 1, lanes);
    if (memcmp(actions, again, (size_t)c->num_outputs * STEPS * sizeof(int16_t)) != 0) {
        abort(); /* by lanes it is the same */
    }
    free(workspace);
    free(state);
    free(observations);
    free(actions);
    free(again);
    free(lanes);
}

static void tell(void)
{
    (void)fprintf(stderr, "valid blobs: %lu\n", num_valid);
}

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    (void)argc;
    (void)argv;
    return atexit(tell);
}

static enum bn_status validate(struct bn_controller *c, const uint8_t *blob, size_t size)
{
    enum bn_status status = bn_open(c, blob, size);
    if (status == BN_OK) {
        int16_t *workspace = signals(c->workspace_length);
        status = bn_validate(c, workspace);
        free(workspace);
    }
    return status;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bn_controller c;
    uint8_t *blob = malloc(size == 0 ? 1 : size);
    if (blob == NULL) {
        abort();
    }
    memcpy(blob, data, size);
    if (validate(&c, blob, size) == BN_OK) {
        num_valid++;
        run(&c, data, size);
    }
    free(blob);
    return 0;
}

/* libFuzzer's own mutations, of which nearly all change the length that a body must have, or leave bits in the padding; one of
 * eight is mended there, where that is enough to make the blob valid. */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
    struct bn_controller c;
    const size_t mutated = LLVMFuzzerMutate(data, size, max_size);
    WRITTEN_BY_LIBFUZZER(data, max_size); /* which MemorySanitizer does not see */
    if (seed % 8 != 0 || mutated == 0) {
        return mutated;
    }
    const size_t first = mutated > 2 ? mutated - 2 : 1;
    const size_t last = mutated + 2 < max_size ? mutated + 2 : max_size;
    if (last > mutated) {
        memset(data + mutated, 0, last - mutated);
    }
    for (size_t length = first; length <= last; length++) {
        const uint8_t kept = data[length - 1];
        for (unsigned bits = 8; bits > 0; bits--) {
            data[length - 1] = (uint8_t)(kept & ((1U << bits) - 1U));
            const enum bn_status status = validate(&c, data, length);
            if (status == BN_OK) {
                return length;
            }
            if (status != BN_ERROR_ORDER) {
                break;
            }
        }
        data[length - 1] = kept;
    }
    return mutated;
}
