/* SPDX-License-Identifier: MIT
 *
 * A program on simavr's AVR core, from one address to another, watched instruction by instruction if asked.
 */
#include "trace.h"

#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <stdlib.h>
#include <string.h>

enum { REACHED = 0, RUNAWAY = 1, CRASHED = 2 };

void *bitneat_avr_new(const char *mcu, const uint8_t *code, uint32_t size)
{
    avr_t *const avr = avr_make_mcu_by_name(mcu);
    if (avr == NULL || avr_init(avr) != 0 || size > avr->flashend + 1) {
        return NULL;
    }
    avr->log = LOG_NONE;
    memcpy(avr->flash, code, size);
    avr->codeend = avr->flashend;
    return avr;
}

void bitneat_avr_free(void *machine)
{
    avr_terminate(machine);
    free(machine);
}

uint32_t bitneat_avr_ram_end(void *machine)
{
    return ((avr_t *)machine)->ramend;
}

uint8_t *bitneat_avr_data(void *machine)
{
    return ((avr_t *)machine)->data;
}

static uint32_t pointer(const avr_t *avr, int low)
{
    return avr->data[low] | (uint32_t)avr->data[low + 1] << 8;
}

/* Which address an instruction reads or writes, by the instruction set manual. */
static void access(avr_t *avr, uint32_t pc, struct bitneat_trace *trace)
{
    const uint32_t code = avr->flash[pc] | (uint32_t)avr->flash[pc + 1] << 8;
    if ((code & 0xd000U) == 0x8000U) { /* LDD, STD, and LD, ST without displacement */
        const uint32_t displacement = (code & 7U) | (code >> 7 & 0x18U) | (code >> 8 & 0x20U);
        bitneat_on_access(avr, code >> 9 & 1, pointer(avr, code & 8U ? 28 : 30) + displacement, 1, 0, trace);
    } else if ((code & 0xfc00U) == 0x9000U) {
        const uint32_t kind = code & 15U;
        const int store = code >> 9 & 1;
        if (kind == 0) { /* LDS, STS */
            bitneat_on_access(avr, store, avr->flash[pc + 2] | (uint32_t)avr->flash[pc + 3] << 8, 1, 0, trace);
        } else if (kind == 15) { /* PUSH, POP */
            bitneat_on_access(avr, store, pointer(avr, R_SPL) + (store ? 0 : 1), 1, 0, trace);
        } else if (kind == 1 || kind == 2) {
            bitneat_on_access(avr, store, pointer(avr, 30) - (kind == 2), 1, 0, trace);
        } else if (kind == 9 || kind == 10) {
            bitneat_on_access(avr, store, pointer(avr, 28) - (kind == 10), 1, 0, trace);
        } else if (kind >= 12) {
            bitneat_on_access(avr, store, pointer(avr, 26) - (kind == 14), 1, 0, trace);
        } else { /* LPM, ELPM */
            bitneat_on_access(avr, 2, pointer(avr, 30), 1, 0, trace);
        }
    } else if ((code & 0xf000U) == 0xd000U || (code & 0xfe0eU) == 0x940eU || code == 0x9509U) { /* RCALL, CALL, ICALL */
        bitneat_on_access(avr, 1, pointer(avr, R_SPL) - 1, 2, 0, trace);
    } else if (code == 0x9508U) { /* RET */
        bitneat_on_access(avr, 0, pointer(avr, R_SPL) + 1, 2, 0, trace);
    } else if (code == 0x95c8U) { /* LPM */
        bitneat_on_access(avr, 2, pointer(avr, 30), 1, 0, trace);
    }
}

int bitneat_avr_run(void *machine, uint32_t entry, uint32_t halt, uint64_t limit, struct bitneat_trace *trace)
{
    avr_t *const avr = machine;
    uint64_t begin = 0;
    avr->pc = entry;
    avr->data[1] = 0; /* gcc's register of zero */
    avr->data[R_SPL] = avr->ramend & 0xffU;
    avr->data[R_SPH] = (uint8_t)(avr->ramend >> 8);
    avr->state = cpu_Running;
    while (avr->pc != halt) {
        if (limit-- == 0) {
            return RUNAWAY;
        }
        if (trace != NULL) {
            const uint32_t was_active = trace->active;
            trace->now.cycles = avr->cycle - begin;
            bitneat_on_code(avr, avr->pc, 2, trace);
            if (trace->active) {
                if (!was_active) {
                    begin = avr->cycle;
                    /* The stack pointer is written in two halves, and is nonsense in between: only accesses count.
                     * AVR's points to the next free byte, others' to the last in use. */
                    trace->entry_sp = pointer(avr, R_SPL) + 1;
                    if (trace->num_steps == 0) {
                        trace->lowest = trace->entry_sp;
                    }
                }
                access(avr, avr->pc, trace);
            }
        }
        avr->pc = avr_run_one(avr);
        if (avr->state != cpu_Running) {
            return CRASHED;
        }
    }
    if (trace != NULL && trace->active) {
        trace->now.cycles = avr->cycle - begin;
        bitneat_on_code(avr, avr->pc, 2, trace);
    }
    return REACHED;
}
