/* SPDX-License-Identifier: 0BSD */
#include "bitneat/runtime.h"

size_t bn_controller_size(void)
{
    return sizeof(struct bn_controller);
}

void bn_step(const struct bn_controller *c, int16_t *state, int16_t *workspace, const int16_t *observation,
             int16_t *action)
{
    for (uint16_t i = 0; i < c->num_inputs; i++) {
        workspace[i] = observation[i];
    }
    bn_run(c, state, workspace);
    for (uint16_t i = 0; i < c->num_outputs; i++) {
        action[i] = workspace[c->workspace_length - c->num_outputs + i];
    }
}

void bn_population_step(const struct bn_job *jobs, size_t num_jobs, int16_t *workspace)
{
    for (size_t i = 0; i < num_jobs; i++) {
        const struct bn_controller *c = jobs[i].controller;
        const int16_t *observation = jobs[i].observations;
        int16_t *action = jobs[i].actions;
        for (size_t step = 0; step < jobs[i].steps; step++) {
            bn_step(c, jobs[i].state, workspace, observation, action);
            observation += c->num_inputs;
            action += c->num_outputs;
        }
    }
}
