/* SPDX-License-Identifier: MIT */
#include "simulator.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "bitneat/runtime.h"
#include "trig.h"

enum { MAX_LANES = 16, MAX_THREADS = 256, MAX_WORKSPACE = 1 << 16 };

static const float STILL[NUM_ACTIONS] = {0.0f, 0.0f, 0.0f, 0.0f};

bool simulator_open(void)
{
    walker_model_build();
    const bool equal = trig_self_test();
    walker_set_trig(equal);
    return equal;
}

int64_t simulator_environment_size(void)
{
    return (int64_t)sizeof(struct environment);
}

int32_t simulator_widest(void)
{
#if defined(__AVX512F__)
    return 16;
#elif defined(__AVX2__)
    return 8;
#else
    return 4;
#endif
}

void simulator_seed(struct environment *environments, int32_t index, const struct pcg64 *rng, int32_t hardcore)
{
    environments[index].rng = *rng;
    environments[index].hardcore = hardcore;
}

void simulator_random_state(const struct environment *environments, int32_t index, struct pcg64 *rng)
{
    *rng = environments[index].rng;
}

static void solve(struct walker *const *walkers, int count, int lanes, void *scratch)
{
    switch (lanes) {
    case 16:
        walker_solve_16(walkers, count, scratch);
        break;
    case 8:
        walker_solve_8(walkers, count, scratch);
        break;
    case 4:
        walker_solve_4(walkers, count, scratch);
        break;
    default:
        walker_solve_1(walkers, count, scratch);
        break;
    }
}

static void *new_scratch(int lanes)
{
    const size_t size = lanes == 16  ? walker_scratch_16()
                        : lanes == 8 ? walker_scratch_8()
                        : lanes == 4 ? walker_scratch_4()
                                     : walker_scratch_1();
    return aligned_alloc(64, (size + 63) / 64 * 64);
}

/* Work that threads share: pieces are taken in turn. */
struct work {
    void (*piece)(void *context, int64_t index, void *scratch);
    void *context;
    int64_t count, next, done;
    int lanes;
};

static void *work_on(void *argument)
{
    struct work *work = argument;
    void *scratch = new_scratch(work->lanes);
    while (scratch != NULL) {
        const int64_t index = __atomic_fetch_add(&work->next, 1, __ATOMIC_RELAXED);
        if (index >= work->count) {
            break;
        }
        work->piece(work->context, index, scratch);
        __atomic_fetch_add(&work->done, 1, __ATOMIC_RELAXED);
    }
    free(scratch);
    return NULL;
}

/* A thread that cannot be made is done without. False if memory ran out before all was done. */
static bool share(void (*piece)(void *, int64_t, void *), void *context, int64_t count, int32_t threads, int lanes)
{
    struct work work = {piece, context, count, 0, 0, lanes};
    pthread_t others[MAX_THREADS];
    int started = 0;
    while (started + 1 < threads && started + 1 < count && started < MAX_THREADS &&
           pthread_create(&others[started], NULL, work_on, &work) == 0) {
        ++started;
    }
    work_on(&work);
    while (started > 0) {
        pthread_join(others[--started], NULL);
    }
    return work.done == count;
}

struct step_context {
    struct environment *environments;
    const int32_t *which;
    int32_t count, lanes;
    bool reset;
    const float *actions;
    float *observations;
    double *rewards;
    uint8_t *terminated;
    int32_t overflow;
};

static void step_piece(void *argument, int64_t index, void *scratch)
{
    struct step_context *s = argument;
    const int32_t first = (int32_t)index * s->lanes;
    const int32_t count = s->count - first < s->lanes ? s->count - first : s->lanes;
    struct walker *walkers[MAX_LANES] = {NULL};
    for (int32_t i = 0; i < count; ++i) {
        struct environment *e = &s->environments[s->which[first + i]];
        walkers[i] = &e->walker;
        if (s->reset) {
            terrain_generate(&e->ground, &e->rng, e->hardcore != 0);
            walker_reset(&e->walker, &e->ground);
        }
        walker_begin(walkers[i], s->reset ? STILL : s->actions + (int64_t)(first + i) * NUM_ACTIONS);
    }
    solve(walkers, count, s->lanes, scratch);
    for (int32_t i = 0; i < count; ++i) {
        const int64_t row = first + i;
        const float *action = s->reset ? STILL : s->actions + row * NUM_ACTIONS;
        bool terminated;
        walker_end(walkers[i]);
        walker_observe(walkers[i], s->observations + row * NUM_OBSERVATIONS);
        const double reward = walker_reward(walkers[i], action, &terminated);
        if (!s->reset) {
            s->rewards[row] = reward;
            s->terminated[row] = terminated;
        }
        if (walkers[i]->overflow) {
            __atomic_store_n(&s->overflow, 1, __ATOMIC_RELAXED);
        }
    }
}

bool simulator_reset(struct environment *environments, const int32_t *which, int32_t count, float *observations,
                     int32_t lanes, int32_t threads)
{
    struct step_context s = {.environments = environments,
                             .which = which,
                             .count = count,
                             .lanes = lanes,
                             .reset = true,
                             .observations = observations};
    return share(step_piece, &s, (count + lanes - 1) / lanes, threads, lanes);
}

bool simulator_step(struct environment *environments, const int32_t *which, int32_t count, const float *actions,
                    float *observations, double *rewards, uint8_t *terminated, int32_t lanes, int32_t threads)
{
    struct step_context s = {.environments = environments,
                             .which = which,
                             .count = count,
                             .lanes = lanes,
                             .actions = actions,
                             .observations = observations,
                             .rewards = rewards,
                             .terminated = terminated};
    const bool done = share(step_piece, &s, (count + lanes - 1) / lanes, threads, lanes);
    return done && s.overflow == 0;
}

struct run_context {
    const struct policy *policies;
    const struct pcg64 *grounds;
    bool hardcore;
    const struct episode *episodes;
    int64_t count, next;
    const struct shaping *shaping;
    struct result *results;
    int32_t lanes;
    const volatile int32_t *stop;
};

/* An episode under way. */
struct run {
    struct walker walker;
    struct terrain ground;
    int32_t ground_index; /* whose ground this is, -1 for none */
    int64_t episode;
    const struct policy *policy;
    int16_t *state; /* of the controller's delayed links */
    float action[NUM_ACTIONS];
    double total, best;
    int32_t best_step, steps;
    bool starting; /* the step of zeros that a reset ends with */
};

/* What a thread computes in: signals of a controller, or of a float network. */
union workspace {
    int16_t integer[MAX_WORKSPACE];
    double real[MAX_WORKSPACE];
};

static void act_by_network(struct run *run, const float *observation, double *signals)
{
    double outputs[NUM_ACTIONS];
    for (int i = 0; i < NUM_OBSERVATIONS; ++i) {
        signals[i] = observation[i];
    }
    network_step(run->policy->network, signals, outputs);
    for (int i = 0; i < NUM_ACTIONS; ++i) {
        const double low = outputs[i] < 1.0 ? outputs[i] : 1.0;
        const double y = low > -1.0 ? low : -1.0;
        run->action[i] = (float)(-1.0 + (y + 1.0) / 2.0 * 2.0); /* the order of operations of bitneat.network.decode */
    }
}

/* The action for what the walker observes. */
static void act(struct run *run, union workspace *memory)
{
    const struct policy *policy = run->policy;
    const struct bn_controller *controller = policy->controller;
    int16_t *workspace = memory->integer;
    float observation[NUM_OBSERVATIONS];
    walker_observe(&run->walker, observation);
    if (controller == NULL) {
        act_by_network(run, observation, memory->real);
        return;
    }
    for (int i = 0; i < NUM_OBSERVATIONS; ++i) {
        const double value = rint(observation[i] * policy->factor[i]);
        const double low = value < policy->limit[i] ? value : policy->limit[i];
        workspace[i] = (int16_t)(low > -policy->limit[i] ? low : -policy->limit[i]);
    }
    bn_run(controller, run->state, workspace);
    const int16_t *outputs = workspace + controller->workspace_length - NUM_ACTIONS;
    for (int i = 0; i < NUM_ACTIONS; ++i) {
        const int32_t y = outputs[i] < -policy->one  ? -policy->one
                          : outputs[i] > policy->one ? policy->one
                                                     : outputs[i];
        run->action[i] = policy->actions[i * (2 * policy->one + 1) + policy->one + y];
    }
}

static bool start(struct run_context *c, struct run *run)
{
    const int64_t episode = *c->stop != 0 ? c->count : __atomic_fetch_add(&c->next, 1, __ATOMIC_RELAXED);
    if (episode >= c->count) {
        return false;
    }
    const struct episode *e = &c->episodes[episode];
    run->episode = episode;
    run->policy = &c->policies[e->policy];
    if (run->ground_index != e->ground) {
        struct pcg64 rng = c->grounds[e->ground];
        terrain_generate(&run->ground, &rng, c->hardcore);
        run->ground_index = e->ground;
    }
    const struct bn_controller *controller = run->policy->controller;
    if (controller != NULL) {
        int16_t *state = realloc(run->state, (size_t)(controller->num_state + 1) * sizeof *state);
        if (state == NULL) {
            return false; /* the episode stays undone */
        }
        run->state = state;
        bn_reset(controller, run->state);
    }
    walker_reset(&run->walker, &run->ground);
    run->walker.rays = run->policy->rays;
    memcpy(run->action, STILL, sizeof STILL);
    run->total = run->best = 0.0;
    run->best_step = run->steps = 0;
    run->starting = true;
    return true;
}

/* Counts the step that was just taken; true if it was the last one. */
static bool account(const struct run_context *c, struct run *run)
{
    const struct shaping *shaping = c->shaping;
    struct result *result = &c->results[run->episode];
    bool terminated;
    const double reward = walker_reward(&run->walker, run->action, &terminated);
    if (run->starting) {
        run->starting = false;
        return false;
    }
    run->total += reward;
    ++run->steps;
    bool stalled = false;
    if (run->total > run->best + shaping->stall_gain) {
        run->best = run->total;
        run->best_step = run->steps;
    } else {
        stalled = run->steps - run->best_step >= shaping->stall_steps;
    }
    if (!terminated && !stalled && run->steps < shaping->max_steps && !run->walker.overflow) {
        return false;
    }
    result->reward = result->shaped = run->total;
    if (terminated && reward == shaping->fall_reward) {
        result->shaped += shaping->fall_value - reward;
    } else if (terminated) {
        result->shaped += shaping->finish_bonus * (1.0 - (double)run->steps / shaping->max_steps);
    }
    result->steps = run->steps;
    result->terminated = terminated;
    result->stalled = stalled;
    result->failed = run->walker.overflow ? EPISODE_OVERFLOW : EPISODE_DONE;
    return true;
}

/* One thread's part: a lane that finishes an episode takes the next one at once. */
static void run_piece(void *argument, int64_t index, void *scratch)
{
    struct run_context *c = argument;
    (void)index;
    struct run *runs = calloc((size_t)c->lanes, sizeof *runs);
    union workspace *workspace = malloc(sizeof *workspace);
    struct walker *walkers[MAX_LANES];
    struct run *active[MAX_LANES];
    int count = 0;
    if (runs == NULL || workspace == NULL) {
        free(runs);
        free(workspace);
        return;
    }
    for (int i = 0; i < c->lanes; ++i) {
        runs[i].ground_index = -1;
        if (start(c, &runs[i])) {
            active[count++] = &runs[i];
        }
    }
    while (count > 0) {
        for (int i = 0; i < count; ++i) {
            walkers[i] = &active[i]->walker;
            if (!active[i]->starting) {
                act(active[i], workspace);
            }
            walker_begin(walkers[i], active[i]->action);
        }
        solve(walkers, count, c->lanes, scratch);
        for (int i = count; i-- > 0;) {
            walker_end(walkers[i]);
            if (account(c, active[i]) && !start(c, active[i])) {
                active[i] = active[--count];
            }
        }
        if (*c->stop != 0) {
            break;
        }
    }
    for (int i = 0; i < c->lanes; ++i) {
        free(runs[i].state);
    }
    free(runs);
    free(workspace);
}

bool simulator_run(const struct policy *policies, const struct pcg64 *grounds, int32_t hardcore,
                   const struct episode *episodes, int64_t count, const struct shaping *shaping, struct result *results,
                   int32_t lanes, int32_t threads, const volatile int32_t *stop)
{
    struct run_context c = {policies, grounds, hardcore != 0, episodes, count, 0, shaping, results, lanes, stop};
    for (int64_t i = 0; i < count; ++i) {
        results[i].failed = EPISODE_UNDONE;
    }
    (void)share(run_piece, &c, threads, threads, lanes); /* an episode that was not run says so */
    return *stop == 0;
}
