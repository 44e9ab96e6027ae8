/* SPDX-License-Identifier: 0BSD
 *
 * The runtime against answers of the reference: opened, validated, stepped one by one and as a population; and a blob that is
 * damaged anywhere is refused or harmless.
 */
#include "bitneat/runtime.h"
#include "known_answers.h"

#include <stdio.h>
#include <string.h>

enum { MAX_WORKSPACE = 64, MAX_BLOB = 256 };

static int16_t workspace[MAX_WORKSPACE * BN_MAX_LANES];

static int run(const struct known_answer *known, const struct bn_controller *c)
{
    int16_t state[MAX_WORKSPACE];
    int16_t actions[KNOWN_STEPS * 16];
    const size_t size = sizeof(int16_t) * KNOWN_STEPS * known->num_outputs;
    bn_reset(c, state);
    for (size_t step = 0; step < KNOWN_STEPS; step++) {
        bn_step(c, state, workspace, known->inputs + step * known->num_inputs, actions + step * known->num_outputs);
    }
    if (memcmp(actions, known->outputs, size) != 0) {
        return 1;
    }
    memset(actions, 0, sizeof actions);
    bn_reset(c, state);
    const struct bn_job job = {c, state, known->inputs, actions, KNOWN_STEPS};
    bn_population_step(&job, 1, workspace);
    return memcmp(actions, known->outputs, size) != 0;
}

/* Every single damaged bit, and every length: nothing may be read or written outside (a sanitizer would see it). */
static int survive_damage(const struct known_answer *known)
{
    uint8_t blob[MAX_BLOB];
    struct bn_controller c;
    int refused = 0;
    for (size_t bit = 0; bit < 8 * known->size; bit++) {
        memcpy(blob, known->blob, known->size);
        blob[bit >> 3] = (uint8_t)(blob[bit >> 3] ^ (1 << (bit & 7)));
        if (bn_open(&c, blob, known->size) != BN_OK || c.workspace_length > MAX_WORKSPACE ||
            bn_validate(&c, workspace) != BN_OK) {
            refused++;
        }
    }
    for (size_t size = 0; size < known->size; size++) {
        if (bn_open(&c, known->blob, size) == BN_OK && bn_validate(&c, workspace) == BN_OK) {
            return 1;
        }
    }
    return refused == 0;
}

int main(void)
{
    int failures = 0;
    for (size_t i = 0; i < sizeof known_answers / sizeof known_answers[0]; i++) {
        const struct known_answer *known = &known_answers[i];
        struct bn_controller c;
        const char *problem = NULL;
        if (bn_open(&c, known->blob, known->size) != BN_OK || c.workspace_length > MAX_WORKSPACE ||
            c.num_inputs != known->num_inputs || c.num_outputs != known->num_outputs) {
            problem = "does not open";
        } else if (bn_validate(&c, workspace) != BN_OK) {
            problem = "is not valid";
        } else if (run(known, &c) != 0) {
            problem = "gives other outputs";
        } else if (survive_damage(known) != 0) {
            problem = "is accepted when damaged";
        }
        printf("%s: %s\n", known->name, problem ? problem : "ok");
        failures += problem != NULL;
    }
    return failures != 0;
}
