# SPDX-License-Identifier: MIT
"""A C program that says of each blob whether the runtime takes it, and runs those that it takes."""

PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "bitneat/runtime.h"

/* Reads records of a 32-bit length and that many bytes; answers with a status byte for each. What is valid is run, in
 * memory of exactly the size that it asked for. */
int main(void)
{
    uint32_t size;
    while (fread(&size, 4, 1, stdin) == 1) {
        uint8_t *blob = malloc(size + (size == 0));
        struct bn_controller c;
        if (fread(blob, 1, size, stdin) != size) return 2;
        memset(&c, 0xA5, sizeof c);
        enum bn_status status = bn_open(&c, blob, size);
        if (status == BN_OK) {
            int16_t *workspace = malloc(2U * c.workspace_length);
            int16_t *state = malloc(2U * c.num_state + 1U);
            int16_t *observation = malloc(2U * c.num_inputs);
            int16_t *action = malloc(2U * c.num_outputs);
            status = bn_validate(&c, workspace);
            if (status == BN_OK) {
                bn_reset(&c, state);
                for (int step = 0; step < 3; step++) {
                    for (unsigned i = 0; i < c.num_inputs; i++) {
                        observation[i] = (int16_t)(step == 0 ? 32767 : step == 1 ? -32767 : 5);
                    }
                    bn_step(&c, state, workspace, observation, action);
                }
            }
            free(workspace); free(state); free(observation); free(action);
        }
        free(blob);
        putchar(status == BN_OK ? 'y' : 'n');
    }
    return 0;
}
"""
