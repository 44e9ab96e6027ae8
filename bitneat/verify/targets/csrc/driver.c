/* SPDX-License-Identifier: MIT
 *
 * Runs a controller's C on an emulated processor: the host writes inputs into arrays, starts one of the functions below, and
 * reads outputs when it has reached bitneat_halt. It is compiled for the processor by the compiler of the code under test, so
 * nobody outside needs to know how a function is called there.
 *
 * Macros from the command line: STEP, RUN, RESET, DECIDE are the controller's functions (each only if it is there, RUN only if
 * it is to be run instead of STEP); NUM_INPUTS, NUM_OUTPUTS, NUM_SIGNALS, NUM_STATE count int16_t; BATCH is how many steps the
 * arrays hold.
 *
 * Every step gets its inputs at the same place and starts from the same contents, -32768, of what it has to write: then the
 * addresses that it touches can be compared between steps, and what it forgets to write shows.
 */
#include <stdint.h>

#if defined(__wasm__)
#define EXPORTED(name) __attribute__((export_name(name), noinline, used))
#else
#define EXPORTED(name) __attribute__((noinline, used))
#endif

#if NUM_STATE
#define STATE (void *)bitneat_state,
#define STATE_PARAMETER void *state,
int16_t bitneat_state[NUM_STATE];
void RESET(void *state);
#else
#define STATE
#define STATE_PARAMETER
#endif

#ifdef RUN
void RUN(STATE_PARAMETER int16_t *signals);
int16_t bitneat_signals[NUM_SIGNALS];
#else
void STEP(STATE_PARAMETER const int16_t *observation, int16_t *action);
int16_t bitneat_observation[NUM_INPUTS];
int16_t bitneat_action[NUM_OUTPUTS];
#endif

int16_t bitneat_inputs[BATCH * NUM_INPUTS];
int16_t bitneat_outputs[BATCH * NUM_OUTPUTS];
uint16_t bitneat_count;

/* Volatile, so that no compiler makes calls of memcpy and memset, which are not there. */
static void copy(volatile int16_t *to, const volatile int16_t *from, uint16_t count)
{
    while (count != 0) {
        *to++ = *from++;
        count--;
    }
}

static void poison(volatile int16_t *to, uint16_t count)
{
    while (count != 0) {
        *to++ = INT16_MIN;
        count--;
    }
}

EXPORTED("bitneat_halt") void bitneat_halt(void)
{
#if !defined(__wasm__)
    for (;;) {
        __asm__ volatile("");
    }
#endif
}

EXPORTED("bitneat_steps") void bitneat_steps(void)
{
    const int16_t *from = bitneat_inputs;
    int16_t *to = bitneat_outputs;
    for (uint16_t left = bitneat_count; left != 0; left--) {
#ifdef RUN
        copy(bitneat_signals, from, NUM_INPUTS);
        poison(bitneat_signals + NUM_INPUTS, NUM_SIGNALS - NUM_INPUTS);
        RUN(STATE bitneat_signals);
        copy(to, bitneat_signals + NUM_SIGNALS - NUM_OUTPUTS, NUM_OUTPUTS);
#else
        copy(bitneat_observation, from, NUM_INPUTS);
        poison(bitneat_action, NUM_OUTPUTS);
        STEP(STATE bitneat_observation, bitneat_action);
        copy(to, bitneat_action, NUM_OUTPUTS);
#endif
        from += NUM_INPUTS;
        to += NUM_OUTPUTS;
    }
    bitneat_halt();
}

EXPORTED("bitneat_reset") void bitneat_reset(void)
{
#if NUM_STATE
    poison(bitneat_state, NUM_STATE);
    RESET((void *)bitneat_state);
#endif
    bitneat_halt();
}

#ifdef DECIDE
int32_t DECIDE(const int16_t *action);
int32_t bitneat_choices[BATCH];

EXPORTED("bitneat_decisions") void bitneat_decisions(void)
{
    const int16_t *from = bitneat_outputs;
    for (uint16_t i = 0; i < bitneat_count; i++) {
        bitneat_choices[i] = DECIDE(from);
        from += NUM_OUTPUTS;
    }
    bitneat_halt();
}
#endif
