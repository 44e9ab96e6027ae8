/* SPDX-License-Identifier: MIT
 *
 * Watches one function of an emulated program, instruction by instruction: a fingerprint of the addresses executed and one of
 * the data addresses touched, for each call. Python holds the struct (bitneat/verify/targets/tracing.py declares it too).
 */
#ifndef BITNEAT_TRACE_H
#define BITNEAT_TRACE_H

#include <stdint.h>

struct bitneat_step {
    uint64_t code; /* fingerprint of the addresses of the instructions, in order */
    uint64_t data; /* fingerprint of the addresses and sizes of all accesses, in order */
    uint64_t instructions;
    uint64_t cycles; /* 0 where the emulator does not count them */
};

struct bitneat_trace {
    uint64_t code_begin, code_end; /* where the code under test is; anything else is its caller */
    uint64_t entry;                /* the function */
    uint64_t blocks_left;          /* of the call; the emulator is stopped when none is left */
    uint64_t block_limit;
    uint32_t active;  /* within a call */
    uint32_t runaway; /* stopped since no block was left */
    struct bitneat_step now;
    struct bitneat_step *steps; /* one for each call */
    uint64_t num_steps, max_steps;
    uint64_t *path; /* the addresses of the first call */
    uint64_t path_length, path_capacity;
    uint64_t stack_begin, stack_end;
    uint64_t entry_sp,
        lowest; /* of the first call: the stack pointer at its start, and the lowest it came or was written */
    int (*stop)(void *engine);
    int (*read_register)(void *engine, int which, void *value);
    int sp_register;
};

void bitneat_on_code(void *engine, uint64_t address, uint32_t size, void *trace);
void bitneat_on_access(void *engine, int kind, uint64_t address, int size, int64_t value, void *trace);
void bitneat_on_block(void *engine, uint64_t address, uint32_t size, void *trace);

#endif
