/* SPDX-License-Identifier: MIT
 *
 * What Python calls: environments that are stepped from outside, and whole episodes of controllers.
 */
#ifndef BITNEAT_WALKER_SIMULATOR_H
#define BITNEAT_WALKER_SIMULATOR_H

#include "network.h"
#include "walker.h"

/* A walker with its own ground and random numbers. */
struct environment {
    struct walker walker;
    struct terrain ground;
    struct pcg64 rng;
    int32_t hardcore;
};

/* How an episode counts for the search, and when it stops early: see bitneat.sim.environment.Shaping. */
struct shaping {
    double fall_reward, fall_value, finish_bonus, stall_gain;
    int32_t max_steps, stall_steps;
};

/* A controller and how it sees and acts: factor and limit for each input, and a table of actions, 2 One + 1 for each output. Or a
 * float network, which needs none of these; then `controller` is NULL. */
struct policy {
    const void *controller;        /* a struct bn_controller of num_inputs 24 and num_outputs 4, valid */
    const struct network *network; /* likewise */
    const double *factor, *limit;
    const float *actions;
    int32_t one;
    uint32_t rays; /* the lidar rays that it reads, as bits */
};

struct episode {
    int32_t policy, ground; /* indices */
};

/* An episode is undone if memory ran out or it was stopped, and overflowed if a body touched more shapes than there is room for. */
enum { EPISODE_DONE, EPISODE_UNDONE, EPISODE_OVERFLOW };

struct result {
    double reward, shaped;
    int32_t steps;
    uint8_t terminated, stalled, failed;
};

/* Once, before all else. True iff the vector sine and cosine equal libm's; if not, libm's are called one by one. */
bool simulator_open(void);

int64_t simulator_environment_size(void);

/* The widest lanes that this machine has instructions for. */
int32_t simulator_widest(void);

/* Gives an environment its random numbers and its mode; the first takes effect in the next reset. And reads them back. */
void simulator_seed(struct environment *environments, int32_t index, const struct pcg64 *rng, int32_t hardcore);
void simulator_random_state(const struct environment *environments, int32_t index, struct pcg64 *rng);

/* Start new episodes in the environments `which[0..count)`, from the random numbers that each has. Observations go to rows of
 * `observations` in the order of `which`. False if memory ran out. */
bool simulator_reset(struct environment *environments, const int32_t *which, int32_t count, float *observations,
                     int32_t lanes, int32_t threads);

/* One step of each; row i of everything belongs to which[i]. False if a walker had more contacts than there is room for, or memory
 * ran out. */
bool simulator_step(struct environment *environments, const int32_t *which, int32_t count, const float *actions,
                    float *observations, double *rewards, uint8_t *terminated, int32_t lanes, int32_t threads);

/* Runs episodes[i] into results[i]; which thread runs which episode, and beside which others, changes no bit. `*stop` is looked at
 * now and then: once it is not 0, the rest is left undone and false returned. */
bool simulator_run(const struct policy *policies, const struct pcg64 *grounds, int32_t hardcore,
                   const struct episode *episodes, int64_t count, const struct shaping *shaping, struct result *results,
                   int32_t lanes, int32_t threads, const volatile int32_t *stop);

#endif
