/* SPDX-License-Identifier: MIT */
#include "trace.h"

/* Not against forgery: 64 bits well mixed, so that two different sequences hardly ever agree. */
static uint64_t mix(uint64_t hash, uint64_t value)
{
    hash = (hash ^ value) * UINT64_C(0x9e3779b97f4a7c15);
    return hash ^ (hash >> 29);
}

static void lower(struct bitneat_trace *trace, uint64_t address)
{
    if (trace->stack_begin <= address && address < trace->lowest) {
        trace->lowest = address;
    }
}

static void finish(struct bitneat_trace *trace)
{
    trace->active = 0;
    if (trace->num_steps < trace->max_steps) {
        trace->steps[trace->num_steps] = trace->now;
    }
    trace->num_steps++;
}

void bitneat_on_code(void *engine, uint64_t address, uint32_t size, void *user)
{
    struct bitneat_trace *const trace = user;
    (void)size;
    if (address < trace->code_begin || trace->code_end <= address) {
        if (trace->active) {
            finish(trace);
        }
        return;
    }
    const int first = trace->num_steps == 0;
    if (!trace->active) {
        if (address != trace->entry) {
            return; /* another function of the same file: reset, decide */
        }
        trace->active = 1;
        trace->now = (struct bitneat_step){0, 0, 0, 0};
    }
    trace->now.instructions++;
    trace->now.code = mix(trace->now.code, address);
    if (first) {
        uint64_t sp = 0;
        if (trace->path_length < trace->path_capacity) {
            trace->path[trace->path_length] = address;
        }
        trace->path_length++;
        if (trace->read_register) {
            trace->read_register(engine, trace->sp_register, &sp);
            if (trace->now.instructions == 1) {
                trace->entry_sp = sp;
                trace->lowest = sp;
            }
            lower(trace, sp);
        }
    }
}

void bitneat_on_access(void *engine, int kind, uint64_t address, int size, int64_t value, void *user)
{
    struct bitneat_trace *const trace = user;
    (void)engine;
    (void)value;
    if (trace->active) {
        trace->now.data = mix(trace->now.data, address ^ ((uint64_t)size << 48) ^ ((uint64_t)kind << 56));
        if ((kind & 1) && trace->num_steps == 0 && address < trace->stack_end) { /* odd: a write */
            lower(trace, address);
        }
    }
}

void bitneat_on_block(void *engine, uint64_t address, uint32_t size, void *user)
{
    struct bitneat_trace *const trace = user;
    (void)size;
    if (address < trace->code_begin || trace->code_end <= address) {
        trace->blocks_left = trace->block_limit;
    } else if (--trace->blocks_left == 0) {
        trace->runaway = 1;
        trace->stop(engine);
    }
}
