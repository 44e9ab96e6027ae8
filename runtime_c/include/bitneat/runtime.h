/* SPDX-License-Identifier: 0BSD
 *
 * bitneat's C runtime: runs controllers straight from their packed blobs (docs/packed-format.md), with the integer semantics of
 * docs/semantics.md. C99, no libc, no heap, no static mutable state, no floating point, no multiplication.
 *
 * Use:  1. bn_open       reads the header of a blob;
 *       2. bn_validate   (once, for a blob that is not trusted) checks everything that the interpreter relies on;
 *       3. bn_reset      clears the state of delayed links;
 *       4. bn_step       one control step.
 */
#ifndef BITNEAT_RUNTIME_H
#define BITNEAT_RUNTIME_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum bn_status {
    BN_OK = 0,
    BN_ERROR_SIZE = -1,    /* the blob ends too early, or has bytes left over */
    BN_ERROR_VERSION = -2, /* a version, encoding or feature that this runtime does not have */
    BN_ERROR_RANGE = -3,   /* a count, index or value that is out of range */
    BN_ERROR_SUM = -4,     /* a node's sum could leave 32 bits */
    BN_ERROR_ORDER = -5    /* links or lists that are not in ascending order, padding that is not zero */
};

enum { BN_NUM_ACTIVATIONS = 10 };

/* An open controller: the header of its blob, read. The caller may read the fields of the first group. */
struct bn_controller {
    uint16_t num_inputs;
    uint16_t num_outputs;
    uint16_t num_state;        /* int16_t values of state, 0 for a pure function */
    uint16_t workspace_length; /* int16_t values of workspace; the inputs are the first, the outputs the last */
    uint8_t frac_bits;

    const uint8_t *blob;
    size_t size;
    const uint8_t *body;
    uint32_t delayed_at; /* bits into the blob, as are the next two */
    uint32_t outputs_at;
    uint32_t classes_at;
    uint16_t num_nodes;
    uint16_t num_classes;
    uint16_t first_delayed;
    uint16_t first_node;
    uint16_t num_slots;
    uint16_t slot_mask;
    uint8_t encoding;
    uint8_t bias_mode;
    uint8_t bias_width;
    uint8_t has_shifts;
    uint8_t has_empty;
    uint8_t has_map;
    uint8_t signal_width;
    uint8_t activation_bits;
    uint8_t num_activations;
    uint8_t gain_bits;
    int8_t min_gain;
    uint8_t record_bytes;
    uint8_t activations[BN_NUM_ACTIVATIONS];
};

/* sizeof(struct bn_controller), for callers that are not C. */
size_t bn_controller_size(void);

/* Reads the header of `blob[0..size)`, any bytes at all. The blob must stay where it is while the controller is in use. On
 * BN_OK every field of `*c` is set, of `activations` the first num_activations; the body has not been looked at. */
enum bn_status bn_open(struct bn_controller *c, const uint8_t *blob, size_t size);

/* Checks that body, size and every index and sum are what the interpreter relies on, so that a blob from anywhere can be
 * run. 1. `c` was opened with BN_OK. 2. `workspace` has c->workspace_length values; what they held is lost. */
enum bn_status bn_validate(const struct bn_controller *c, int16_t *workspace);

/* Sets the c->num_state values of state to what they are before the first step. */
void bn_reset(const struct bn_controller *c, int16_t *state);

/* One step in place. 1. The blob is valid. 2. `workspace` has c->workspace_length values, the first c->num_inputs of them the
 * inputs, each within its limit. 3. `state` has c->num_state values, from bn_reset or the step before (unused and possibly
 * null if there are none). Afterwards the last c->num_outputs values of the workspace are the outputs. */
void bn_run(const struct bn_controller *c, int16_t *state, int16_t *workspace);

/* The same with separate arrays: c->num_inputs observations in, c->num_outputs actions out. */
void bn_step(const struct bn_controller *c, int16_t *state, int16_t *workspace, const int16_t *observation,
             int16_t *action);

enum { BN_MAX_LANES = 64 };

/* A step for several input vectors at once: workspace[slot * lanes + lane]. 1. The blob is valid, its encoding is 0 (bytes), and it
 * has no state. 2. `lanes` is 1..BN_MAX_LANES. 3. `workspace` has c->workspace_length * lanes values. Otherwise as bn_run. */
void bn_run_lanes(const struct bn_controller *c, size_t lanes, int16_t *workspace);

/* Work for bn_population_step: `steps` successive steps of one controller. */
struct bn_job {
    const struct bn_controller *controller;
    int16_t *state;
    const int16_t *observations; /* steps * num_inputs values */
    int16_t *actions;            /* steps * num_outputs values */
    size_t steps;
};

/* Steps many controllers in one call. 1. Each job meets the contract of bn_step. 2. `workspace` has BN_MAX_LANES times the
 * longest workspace_length; it is shared, as nothing in it outlives a step. Controllers without state take many steps at a time. */
void bn_population_step(const struct bn_job *jobs, size_t num_jobs, int16_t *workspace);

#ifdef __cplusplus
}
#endif

#endif
