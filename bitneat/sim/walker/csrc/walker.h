/* SPDX-License-Identifier: MIT
 *
 * One walker on its terrain: five bodies, four joints, and the contacts of each body with the ground.
 *
 * A step is split in two: what differs from walker to walker in its course (collision, broad phase, continuous collision, lidar)
 * is scalar code and lies in walker.c; the solver, where nearly all arithmetic is, takes LANES walkers at a time (solver.c).
 *
 * The walker's bodies collide with the ground only, never with one another. So contacts of different bodies share no moving
 * body, their order among one another changes no bit, and each body keeps a list of its own, in the order in which Box2D would
 * have made them. Box2D walks its lists from the newest to the oldest.
 */
#ifndef BITNEAT_WALKER_WALKER_H
#define BITNEAT_WALKER_WALKER_H

#include <stddef.h>

#include "geometry.h"
#include "terrain.h"

/* In the order in which Gymnasium makes them; the legs come as upper and lower, first -1 and then +1. */
enum { HULL, UPPER_1, LOWER_1, UPPER_2, LOWER_2, NUM_BODIES };
enum { HIP_1, KNEE_1, HIP_2, KNEE_2, NUM_JOINTS };

enum { NUM_OBSERVATIONS = 24, NUM_ACTIONS = 4, NUM_RAYS = 10, FIRST_RAY = 14 };

/* Of one body. Play needs ten at most. A body thrown at 100 m/s was seen to need 35, as every impact of a step leaves it a larger box; a
 * walker that needs more than there is room for says so. */
enum { MAX_CONTACTS = 64, MAX_ISLAND_CONTACTS = 32 };

enum { VELOCITY_ITERATIONS = 180, POSITION_ITERATIONS = 60, SUBSTEP_POSITION_ITERATIONS = 20 };

struct body_model {
    struct polygon shape;
    float inverse_mass, inverse_inertia;
    float friction;    /* against the ground: the mixture of both */
    struct vec center; /* of mass, in the body's frame */
    struct vec start;
    float start_angle;
};

struct joint_model {
    int32_t a, b;                  /* bodies */
    struct vec anchor_a, anchor_b; /* from the bodies' centres of mass */
    float reference, lower, upper; /* angles */
    float speed;                   /* of the motor at full action */
};

/* What is the same for every walker. */
struct model {
    struct body_model body[NUM_BODIES];
    struct joint_model joint[NUM_JOINTS];
    float time_step, step_ratio; /* seconds, and the factor of impulses taken over from the step before */
    double ray_across[NUM_RAYS], ray_down[NUM_RAYS];
    double goal;
    float effort; /* cost of a full action */
};

extern struct model walker_model;

/* Fills in walker_model; call it once before anything else. */
void walker_model_build(void);

struct contact {
    int16_t shape;   /* an edge's index, or NUM_EDGES plus a polygon's */
    uint8_t impacts; /* times of impact handled in this step */
    bool touching, enabled, has_impact;
    float impact; /* when, if has_impact */
    struct manifold manifold;
};

struct body {
    struct vec c, v;
    float a, w;
    struct pose pose;
    struct pose start;  /* at the start of the sweep */
    struct sweep sweep; /* of the step */
    struct box fat;
    float sleep_time;
    bool awake;
    int32_t num_contacts;
    struct contact contact[MAX_CONTACTS];
};

enum limit { AT_LOWER = -1, BETWEEN = 0, AT_UPPER = 1 };

struct joint {
    float impulse_x, impulse_y, impulse_z, motor_impulse;
    float limit;             /* an enum limit */
    float speed, max_torque; /* of the motor */
};

struct walker {
    const struct terrain *ground;
    float force; /* on the hull, along x, in the next step */
    bool fallen, leg_contact[2];
    bool positions_solved, overflow;
    bool has_shaping;
    uint32_t rays; /* bit i: cast ray i */
    double shaping;
    struct joint joint[NUM_JOINTS];
    struct body body[NUM_BODIES];
};

/* Puts the walker at the start of `ground`, which must outlive it. A step with an action of zeros must follow, as in Gymnasium's reset. */
void walker_reset(struct walker *w, const struct terrain *ground);

/* The step's parts, in this order. `action` is 4 numbers, none of them a NaN. */
void walker_begin(struct walker *w, const float *action);
void walker_solve_1(struct walker *const *walkers, int count, void *scratch);
void walker_solve_4(struct walker *const *walkers, int count, void *scratch);
void walker_solve_8(struct walker *const *walkers, int count, void *scratch);
void walker_solve_16(struct walker *const *walkers, int count, void *scratch);
void walker_end(struct walker *w);

/* How much memory each needs besides, aligned to 64 bytes. */
size_t walker_scratch_1(void);
size_t walker_scratch_4(void);
size_t walker_scratch_8(void);
size_t walker_scratch_16(void);

/* The rest of a step of one body after an impact: it lasts `time_step`; sweep, v and w are updated. */
void walker_substep(struct body *body, int index, struct contact *const *contacts, int count, float time_step);

/* After walker_end. The reward is Gymnasium's, float32 as it comes from float32 actions. Rays that are not cast read 1. */
void walker_observe(const struct walker *w, float *observation);
double walker_reward(struct walker *w, const float *action, bool *terminated);

#endif
