/* SPDX-License-Identifier: MIT
 *
 * Vectors, rotations, poses and shapes of the plane, in float32 as Box2D has them.
 *
 * Every function rounds after each operation, in the order in which it is written here. That order is part of the contract: it is
 * what makes the simulator equal to Gymnasium's bit for bit. So the sources are compiled without contraction of products and
 * sums (-ffp-contract=off) and without any -ffast-math.
 *
 * The terrain never moves: its shapes are given in world coordinates, and the identity pose that Box2D applies to them
 * changes no bit, so none is applied here.
 */
#ifndef BITNEAT_WALKER_GEOMETRY_H
#define BITNEAT_WALKER_GEOMETRY_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define LINEAR_SLOP 0.005f
#define POLYGON_RADIUS (2.0f * LINEAR_SLOP) /* the skin of every shape */
#define EPSILON 1.1920929e-7f               /* FLT_EPSILON */
#define PI_F 3.14159265359f
#define ANGULAR_SLOP (2.0f / 180.0f * PI_F)

enum { MAX_VERTICES = 5 };

struct vec {
    float x, y;
};

struct rot {
    float s, c;
};

/* A rotation and then a translation. */
struct pose {
    struct vec p;
    struct rot q;
};

/* Convex, counter-clockwise. normal[i] points out of the side from vertex[i] to the next. */
struct polygon {
    int32_t count;
    struct vec vertex[MAX_VERTICES];
    struct vec normal[MAX_VERTICES];
    struct vec centroid;
};

/* A segment of terrain from a to b; the unit normal is (b - a) turned clockwise. */
struct edge {
    struct vec a, b, normal;
};

/* A body's motion during a step: its centre of mass moves from c0 to c, its angle from a0 to a; c0 and a0 hold at time alpha0. */
struct sweep {
    struct vec local_center, c0, c;
    float a0, a, alpha0;
};

/* Two shapes in contact: the points of the one that lie within the skin of a face of the other. Shape A is the terrain. */
enum manifold_kind { FACE_A, FACE_B };

struct manifold_point {
    struct vec local; /* in the frame of the shape that does not own the face */
    float normal_impulse, tangent_impulse;
    uint32_t id; /* which features meet: equal from step to step for as long as they do */
};

struct manifold {
    enum manifold_kind kind;
    int32_t count; /* 0, 1 or 2 */
    struct vec local_normal, local_point;
    struct manifold_point point[2];
};

static inline struct vec vec_make(float x, float y)
{
    struct vec v = {x, y};
    return v;
}

static inline struct vec vec_add(struct vec a, struct vec b)
{
    return vec_make(a.x + b.x, a.y + b.y);
}

static inline struct vec vec_sub(struct vec a, struct vec b)
{
    return vec_make(a.x - b.x, a.y - b.y);
}

static inline struct vec vec_scale(float s, struct vec a)
{
    return vec_make(s * a.x, s * a.y);
}

static inline struct vec vec_negate(struct vec a)
{
    return vec_make(-a.x, -a.y);
}

static inline float vec_dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y;
}

static inline float vec_cross(struct vec a, struct vec b)
{
    return a.x * b.y - a.y * b.x;
}

/* a turned clockwise by a right angle and stretched by s; the product with -s is the exact negation of that with s. */
static inline struct vec vec_cross_scalar(struct vec a, float s)
{
    return vec_make(s * a.y, -s * a.x);
}

/* The length, after scaling *a to length 1; a vector shorter than EPSILON stays as it is and gives 0. */
static inline float vec_normalize(struct vec *a)
{
    float length = sqrtf(a->x * a->x + a->y * a->y);
    if (length < EPSILON) {
        return 0.0f;
    }
    float inverse = 1.0f / length;
    a->x *= inverse;
    a->y *= inverse;
    return length;
}

static inline struct vec rot_apply(struct rot q, struct vec v)
{
    return vec_make(q.c * v.x - q.s * v.y, q.s * v.x + q.c * v.y);
}

static inline struct vec rot_apply_inverse(struct rot q, struct vec v)
{
    return vec_make(q.c * v.x + q.s * v.y, -q.s * v.x + q.c * v.y);
}

static inline struct vec pose_apply(const struct pose *t, struct vec v)
{
    return vec_make((t->q.c * v.x - t->q.s * v.y) + t->p.x, (t->q.s * v.x + t->q.c * v.y) + t->p.y);
}

static inline struct vec pose_apply_inverse(const struct pose *t, struct vec v)
{
    float x = v.x - t->p.x;
    float y = v.y - t->p.y;
    return vec_make(t->q.c * x + t->q.s * y, -t->q.s * x + t->q.c * y);
}

/* The smaller and larger of two, the second of equals, as Box2D's (and SSE's) are. */
static inline float min_f(float a, float b)
{
    return a < b ? a : b;
}

static inline float max_f(float a, float b)
{
    return a > b ? a : b;
}

#endif
