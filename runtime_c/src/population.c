/* SPDX-License-Identifier: 0BSD */
#include "bitneat/runtime.h"
#include "format.h"

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

/* Several steps of a controller without state, a lane each. */
static void step_lanes(const struct bn_controller *c, size_t lanes, int16_t *workspace, const int16_t *observations,
                       int16_t *actions)
{
    const size_t num_inputs = c->num_inputs;
    const size_t num_outputs = c->num_outputs;
    for (size_t lane = 0; lane < lanes; lane++) {
        for (size_t i = 0; i < num_inputs; i++) {
            workspace[i * lanes + lane] = observations[lane * num_inputs + i];
        }
    }
    bn_run_lanes(c, lanes, workspace);
    const int16_t *outputs = workspace + (c->workspace_length - num_outputs) * lanes;
    for (size_t lane = 0; lane < lanes; lane++) {
        for (size_t i = 0; i < num_outputs; i++) {
            actions[lane * num_outputs + i] = outputs[i * lanes + lane];
        }
    }
}

void bn_population_step(const struct bn_job *jobs, size_t num_jobs, int16_t *workspace)
{
    for (size_t i = 0; i < num_jobs; i++) {
        const struct bn_controller *c = jobs[i].controller;
        const int16_t *observation = jobs[i].observations;
        int16_t *action = jobs[i].actions;
        size_t left = jobs[i].steps;
        while (left != 0) {
            const int wide = c->encoding == BN_BYTES && c->num_state == 0;
            const size_t steps = !wide ? 1 : left < BN_MAX_LANES ? left : BN_MAX_LANES;
            if (steps > 1) {
                step_lanes(c, steps, workspace, observation, action);
            } else {
                bn_step(c, jobs[i].state, workspace, observation, action);
            }
            observation += steps * c->num_inputs;
            action += steps * c->num_outputs;
            left -= steps;
        }
    }
}
