/* SPDX-License-Identifier: MIT
 *
 * Conservative advancement: the distance gives an axis that separates the shapes, B then moves on until it would no longer do
 * so, and that is repeated until the shapes are near enough. The order of the operations is that of Box2D 2.3.10.
 */
#include "impact.h"

#include <float.h>

/* Box2D's limits; the third is the number of vertices that pybox2d allows a polygon. */
enum { MAX_DISTANCE_STEPS = 20, MAX_ADVANCES = 20, MAX_PUSH_BACKS = 16, MAX_ROOT_STEPS = 50 };

/* Shapes touch when TARGET apart, give or take TOLERANCE: their skins then overlap enough to make contact points. */
#define TARGET max_f(LINEAR_SLOP, (POLYGON_RADIUS + POLYGON_RADIUS) - 3.0f * LINEAR_SLOP)
#define TOLERANCE (0.25f * LINEAR_SLOP)

/* What proves that there is no impact: a distance of this much, all the time. The rest above TARGET + TOLERANCE, 0.002, is for
 * rounding; see below. A foot at rest is about 0.015 away. */
#define CLEARANCE 0.00825f

/* The shapes' Minkowski difference B - A is what the search for the distance walks on. A corner of it is a vertex of each. */
struct corner {
    struct vec on_a, on_b, difference;
    float share; /* of the simplex' point nearest to the origin */
    int32_t index_a, index_b;
};

struct simplex {
    int32_t count;
    struct corner corner[3];
};

/* The corners at which the last search ended: a good start for the next one, unless their size changed much. */
struct memory {
    float size;
    int32_t count;
    int32_t index_a[3], index_b[3];
};

struct pair {
    const struct vec *a;
    int32_t count;
    const struct polygon *b;
};

/* How far the shapes are apart along one direction that is fixed to A (POINTS, ON_A) or to B (ON_B). */
struct separation {
    enum { POINTS, ON_A, ON_B } kind;
    struct vec axis;
    struct vec point; /* of the face, in its owner's frame */
};

static struct pose sweep_pose(const struct sweep *sweep, float t)
{
    float rest = 1.0f - t;
    float angle = rest * sweep->a0 + t * sweep->a;
    struct pose pose;
    pose.q.s = sinf(angle);
    pose.q.c = cosf(angle);
    struct vec center = vec_add(vec_scale(rest, sweep->c0), vec_scale(t, sweep->c));
    pose.p = vec_sub(center, rot_apply(pose.q, sweep->local_center));
    return pose;
}

/* The vertex that lies farthest along d, the first of equals. */
static int32_t support(const struct vec *vertex, int32_t count, struct vec d)
{
    int32_t best = 0;
    float farthest = vec_dot(vertex[0], d);
    for (int32_t i = 1; i < count; i++) {
        float value = vec_dot(vertex[i], d);
        if (value > farthest) {
            best = i;
            farthest = value;
        }
    }
    return best;
}

static struct corner corner_make(const struct pair *shapes, const struct pose *pose, int32_t index_a, int32_t index_b)
{
    struct corner corner;
    corner.index_a = index_a;
    corner.index_b = index_b;
    corner.on_a = shapes->a[index_a];
    corner.on_b = pose_apply(pose, shapes->b->vertex[index_b]);
    corner.difference = vec_sub(corner.on_b, corner.on_a);
    corner.share = 1.0f;
    return corner;
}

static float length(struct vec v)
{
    return sqrtf(v.x * v.x + v.y * v.y);
}

/* The length of two corners, twice the area of three. */
static float simplex_size(const struct simplex *s)
{
    if (s->count == 1) {
        return 0.0f;
    }
    if (s->count == 2) {
        return length(vec_sub(s->corner[0].difference, s->corner[1].difference));
    }
    return vec_cross(vec_sub(s->corner[1].difference, s->corner[0].difference),
                     vec_sub(s->corner[2].difference, s->corner[0].difference));
}

static void simplex_recall(struct simplex *s, const struct memory *memory, const struct pair *shapes,
                           const struct pose *pose)
{
    s->count = memory->count;
    for (int32_t i = 0; i < s->count; i++) {
        s->corner[i] = corner_make(shapes, pose, memory->index_a[i], memory->index_b[i]);
    }
    if (s->count > 1) {
        float size = simplex_size(s);
        if (size < 0.5f * memory->size || 2.0f * memory->size < size || size < EPSILON) {
            s->count = 0;
        }
    }
    if (s->count == 0) {
        s->corner[0] = corner_make(shapes, pose, 0, 0);
        s->count = 1;
    }
}

static void keep_one(struct simplex *s, int32_t i)
{
    s->corner[0] = s->corner[i];
    s->corner[0].share = 1.0f;
    s->count = 1;
}

/* Where the origin projects to on the line through two corners: on[0] > 0 says before the second, on[1] > 0 behind the first. */
struct projection {
    float on[2];
};

static struct projection project(struct vec first, struct vec second)
{
    struct vec along = vec_sub(second, first);
    struct projection p = {{vec_dot(second, along), -vec_dot(first, along)}};
    return p;
}

static void keep_two(struct simplex *s, int32_t i, int32_t j, struct projection p)
{
    float inverse = 1.0f / (p.on[0] + p.on[1]);
    struct corner first = s->corner[i];
    struct corner second = s->corner[j];
    first.share = p.on[0] * inverse;
    second.share = p.on[1] * inverse;
    s->corner[0] = first;
    s->corner[1] = second;
    s->count = 2;
}

static void nearest_of_two(struct simplex *s)
{
    struct projection p = project(s->corner[0].difference, s->corner[1].difference);
    if (p.on[1] <= 0.0f) {
        keep_one(s, 0);
    } else if (p.on[0] <= 0.0f) {
        keep_one(s, 1);
    } else {
        keep_two(s, 0, 1, p);
    }
}

/* Leaves three corners iff the origin is within their triangle. Which corners stay first decides later bits: of 2 and 3 it is the
 * third that takes the first place. */
static void nearest_of_three(struct simplex *s)
{
    struct vec w1 = s->corner[0].difference;
    struct vec w2 = s->corner[1].difference;
    struct vec w3 = s->corner[2].difference;
    struct projection p12 = project(w1, w2);
    struct projection p13 = project(w1, w3);
    struct projection p23 = project(w2, w3);
    float area = vec_cross(vec_sub(w2, w1), vec_sub(w3, w1));
    float inside1 = area * vec_cross(w2, w3);
    float inside2 = area * vec_cross(w3, w1);
    float inside3 = area * vec_cross(w1, w2);

    if (p12.on[1] <= 0.0f && p13.on[1] <= 0.0f) {
        keep_one(s, 0);
    } else if (p12.on[0] > 0.0f && p12.on[1] > 0.0f && inside3 <= 0.0f) {
        keep_two(s, 0, 1, p12);
    } else if (p13.on[0] > 0.0f && p13.on[1] > 0.0f && inside2 <= 0.0f) {
        keep_two(s, 0, 2, p13);
    } else if (p12.on[0] <= 0.0f && p23.on[1] <= 0.0f) {
        keep_one(s, 1);
    } else if (p13.on[0] <= 0.0f && p23.on[0] <= 0.0f) {
        keep_one(s, 2);
    } else if (p23.on[0] > 0.0f && p23.on[1] > 0.0f && inside1 <= 0.0f) {
        struct projection p32 = {{p23.on[1], p23.on[0]}};
        keep_two(s, 2, 1, p32);
    }
}

static struct vec search_direction(const struct simplex *s)
{
    struct vec first = s->corner[0].difference;
    if (s->count == 1) {
        return vec_negate(first);
    }
    struct vec along = vec_sub(s->corner[1].difference, first);
    struct vec right = vec_make(along.y, -along.x);
    return vec_cross(along, vec_negate(first)) > 0.0f ? vec_negate(right) : right;
}

static bool simplex_has(const struct memory *before, int32_t index_a, int32_t index_b)
{
    for (int32_t i = 0; i < before->count; i++) {
        if (before->index_a[i] == index_a && before->index_b[i] == index_b) {
            return true;
        }
    }
    return false;
}

static void remember(struct memory *memory, const struct simplex *s)
{
    memory->count = s->count;
    for (int32_t i = 0; i < s->count; i++) {
        memory->index_a[i] = s->corner[i].index_a;
        memory->index_b[i] = s->corner[i].index_b;
    }
}

/* The distance without skins (Gilbert, Johnson and Keerthi), 0 for shapes of which the one covers a corner of the other. */
static float distance(struct memory *memory, const struct pair *shapes, const struct pose *pose)
{
    struct simplex s;
    simplex_recall(&s, memory, shapes, pose);
    for (int32_t step = 0; step < MAX_DISTANCE_STEPS; step++) {
        struct memory before;
        remember(&before, &s);
        if (s.count == 2) {
            nearest_of_two(&s);
        } else if (s.count == 3) {
            nearest_of_three(&s);
            if (s.count == 3) {
                return 0.0f;
            }
        }
        struct vec d = search_direction(&s);
        if (d.x * d.x + d.y * d.y < EPSILON * EPSILON) {
            break;
        }
        int32_t index_a = support(shapes->a, shapes->count, vec_negate(d));
        int32_t index_b = support(shapes->b->vertex, shapes->b->count, rot_apply_inverse(pose->q, d));
        if (simplex_has(&before, index_a, index_b)) {
            break;
        }
        s.corner[s.count++] = corner_make(shapes, pose, index_a, index_b);
    }
    memory->size = simplex_size(&s);
    remember(memory, &s);
    if (s.count == 3) {
        return 0.0f;
    }
    if (s.count == 1) {
        return length(vec_sub(s.corner[0].on_a, s.corner[0].on_b));
    }
    struct vec on_a =
        vec_add(vec_scale(s.corner[0].share, s.corner[0].on_a), vec_scale(s.corner[1].share, s.corner[1].on_a));
    struct vec on_b =
        vec_add(vec_scale(s.corner[0].share, s.corner[0].on_b), vec_scale(s.corner[1].share, s.corner[1].on_b));
    return length(vec_sub(on_a, on_b));
}

static struct vec middle(struct vec a, struct vec b)
{
    return vec_scale(0.5f, vec_add(a, b));
}

/* The apartness of two points, or of a point and the face; what does not belong to the face is looked up by its index. */
static float separation_at(const struct separation *s, const struct pair *shapes, const struct pose *pose,
                           int32_t index_a, int32_t index_b)
{
    if (s->kind == ON_B) {
        struct vec point = pose_apply(pose, s->point);
        return vec_dot(vec_sub(shapes->a[index_a], point), rot_apply(pose->q, s->axis));
    }
    struct vec on_a = s->kind == POINTS ? shapes->a[index_a] : s->point;
    return vec_dot(vec_sub(pose_apply(pose, shapes->b->vertex[index_b]), on_a), s->axis);
}

/* The direction across the features that the search for the distance found nearest, from A to B or from B to A by owner. */
static struct separation separation_make(const struct memory *nearest, const struct pair *shapes,
                                         const struct pose *pose)
{
    struct separation s;
    int32_t index_a = nearest->index_a[0];
    int32_t index_b = nearest->index_b[0];
    if (nearest->count == 1) {
        s.kind = POINTS;
        s.point = vec_make(0.0f, 0.0f);
        s.axis = vec_sub(pose_apply(pose, shapes->b->vertex[index_b]), shapes->a[index_a]);
        vec_normalize(&s.axis);
        return s;
    }
    struct vec first, second;
    if (index_a == nearest->index_a[1]) {
        s.kind = ON_B;
        first = shapes->b->vertex[index_b];
        second = shapes->b->vertex[nearest->index_b[1]];
    } else {
        s.kind = ON_A;
        first = shapes->a[index_a];
        second = shapes->a[nearest->index_a[1]];
    }
    s.axis = vec_cross_scalar(vec_sub(second, first), 1.0f);
    vec_normalize(&s.axis);
    s.point = middle(first, second);
    if (separation_at(&s, shapes, pose, index_a, index_b) < 0.0f) {
        s.axis = vec_negate(s.axis);
    }
    return s;
}

/* The least apartness at a time, and the vertices that have it. */
static float separation_least(const struct separation *s, const struct pair *shapes, const struct pose *pose,
                              int32_t *index_a, int32_t *index_b)
{
    *index_a = *index_b = 0;
    if (s->kind == POINTS) {
        *index_a = support(shapes->a, shapes->count, s->axis);
    } else if (s->kind == ON_B) {
        *index_a = support(shapes->a, shapes->count, vec_negate(rot_apply(pose->q, s->axis)));
    }
    if (s->kind != ON_B) {
        *index_b = support(shapes->b->vertex, shapes->b->count, rot_apply_inverse(pose->q, vec_negate(s->axis)));
    }
    return separation_at(s, shapes, pose, *index_a, *index_b);
}

/* A time between t1 and t2, at which the two features are s1 > TARGET and s2 < TARGET apart, when they are TARGET apart. Without
 * success t2 stays as it is. */
static void find_root(const struct separation *s, const struct pair *shapes, const struct sweep *sweep, int32_t index_a,
                      int32_t index_b, float t1, float s1, float *t2, float s2)
{
    float low = t1;
    float high = *t2;
    for (int32_t step = 0; step < MAX_ROOT_STEPS; step++) {
        /* Bisection brings progress for sure, the secant is fast near the root. */
        float t = step & 1 ? low + (TARGET - s1) * (high - low) / (s2 - s1) : 0.5f * (low + high);
        struct pose pose = sweep_pose(sweep, t);
        float value = separation_at(s, shapes, &pose, index_a, index_b);
        if (fabsf(value - TARGET) < TOLERANCE) {
            *t2 = t;
            return;
        }
        if (value > TARGET) {
            low = t;
            s1 = value;
        } else {
            high = t;
            s2 = value;
        }
    }
}

bool time_of_impact(const struct vec *a, int32_t count, const struct polygon *b, const struct sweep *sweep, float *t)
{
    const struct pair shapes = {a, count, b};
    struct sweep motion = *sweep;
    float turns = 2.0f * PI_F * floorf(motion.a0 / (2.0f * PI_F));
    motion.a0 -= turns;
    motion.a -= turns;

    struct memory memory;
    memory.count = 0;
    memory.size = 0.0f;
    const struct pose end = sweep_pose(&motion, 1.0f);
    float t1 = 0.0f;
    for (int32_t advance = 0; advance < MAX_ADVANCES; advance++) {
        const struct pose pose1 = sweep_pose(&motion, t1);
        float apart = distance(&memory, &shapes, &pose1);
        if (apart <= 0.0f) {
            return false;
        }
        if (apart < TARGET + TOLERANCE) {
            *t = t1;
            return true;
        }
        const struct separation s = separation_make(&memory, &shapes, &pose1);
        float t2 = 1.0f;
        struct pose pose2 = end;
        for (int32_t push_back = 0; push_back < MAX_PUSH_BACKS; push_back++) {
            int32_t index_a, index_b;
            float s2 = separation_least(&s, &shapes, &pose2, &index_a, &index_b);
            if (s2 > TARGET + TOLERANCE) {
                return false;
            }
            if (s2 > TARGET - TOLERANCE) {
                t1 = t2;
                break;
            }
            float s1 = separation_at(&s, &shapes, &pose1, index_a, index_b);
            if (s1 < TARGET - TOLERANCE) {
                return false;
            }
            if (s1 <= TARGET + TOLERANCE) {
                *t = t1;
                return true;
            }
            find_root(&s, &shapes, &motion, index_a, index_b, t1, s1, &t2, s2);
            pose2 = sweep_pose(&motion, t2);
        }
    }
    return false;
}

/*
 * Why a fixed axis can rule an impact out
 *
 * Let D(t) be the shapes' true distance, and suppose that along some fixed unit vector they are CLEARANCE apart at every time of
 * the sweep; then D(t) >= CLEARANCE. time_of_impact says true in two places only.
 *
 * 1. apart < TARGET + TOLERANCE = 0.00625. `apart` is 0 (then it says false), or the distance of two points, each of them a mean
 *    of a shape's vertices by shares that are positive and add up to 1. However well or badly the search went, such points
 *    are D(t1) apart at least. Rounding: a coordinate below 200 is off by 8e-6 after each operation, there are about five of
 *    them to a coordinate, and shares that add up to 1 + 1e-7 move both points alike; that makes less than 1e-4.
 *
 * 2. s1 <= TARGET + TOLERANCE. s1 is the apartness at t1 of two features along the axis that the search for the distance found at
 *    t1, and so at least the least apartness of all features along it. The search ends when the farthest corner against its
 *    direction is one that it had already, that is when the direction is that of the nearest points, up to what the dot
 *    products round (7e-5: coordinates below 200, and a shorter direction scales the error along); along that direction
 *    the least apartness is D(t1). (It also ends at a direction of no length. That is not one corner, which is CLEARANCE from the
 *    origin; it is two in one place, and the later one was the farthest along the direction that led to it.) POINTS and ON_B
 *    take the same direction again. So does ON_A with one vertex of B. ON_A with two has A's side for it, which then
 *    is perpendicular to the direction up to those same errors over the side's length, above 0.4: 2e-4, times the size of B's
 *    reach, 2, is 4e-4. So s1 > CLEARANCE - 0.001 > TARGET + TOLERANCE. This argument leaves out a search that gives up after
 *    MAX_DISTANCE_STEPS: in 800 000 random sweeps of the walker's shapes none took more than five steps.
 *
 * With both, the only ends left are "separated", "overlapped", "got stuck": false. Whatever t1 is makes no difference.
 *
 * How far apart the shapes are along an axis n during the sweep: B's vertex v is at c(t) + R(t) r, where c is linear in t and R
 * turns evenly by `angle_change` in all. The second derivative of n . v has |r| angle_change^2 for its bound, so n . v departs from
 * the straight line between its values at both ends by |r| angle_change^2 / 8 at most, by the error of linear interpolation,
 * which holds for any angle. Hence a vertex is never nearer than at the nearer end, less that much.
 *
 * Here too rounding is within 1e-4: of products, of a pose that is not of the very angle that time_of_impact takes (it drops
 * full turns; angles below 1000 are off by 1e-4 / 2 then), and of the centre of mass that is the centroid but for rounding. The
 * margin of 0.002 covers the sum of it all, with room to spare.
 */

/* The least of axis . vertex. */
static inline float lowest(const struct vec *vertex, int32_t count, struct vec axis)
{
    float low = vec_dot(vertex[0], axis);
    for (int32_t i = 1; i < count; i++) {
        low = min_f(low, vec_dot(vertex[i], axis));
    }
    return low;
}

/* The least of axis . (point - origin) over B's points at both ends of its sweep. */
static inline float sweep_lowest(const struct polygon *b, const struct pose *start, const struct pose *end,
                                 struct vec axis, struct vec origin)
{
    float at_start = lowest(b->vertex, b->count, rot_apply_inverse(start->q, axis));
    float at_end = lowest(b->vertex, b->count, rot_apply_inverse(end->q, axis));
    return min_f(at_start + vec_dot(axis, vec_sub(start->p, origin)), at_end + vec_dot(axis, vec_sub(end->p, origin)));
}

/* How far apart the shapes have to be at both ends: the path of a vertex may depart from a straight line. */
static inline float clearance(const struct polygon *b, float angle_change)
{
    float farthest = 0.0f;
    for (int32_t i = 0; i < b->count; i++) {
        struct vec r = vec_sub(b->vertex[i], b->centroid);
        farthest = max_f(farthest, vec_dot(r, r));
    }
    return CLEARANCE + sqrtf(farthest) * (0.125f * angle_change * angle_change);
}

static bool parted_along(struct vec axis, const struct vec *a, int32_t count, const struct polygon *b,
                         const struct pose *start, const struct pose *end, float apart)
{
    float highest = vec_dot(a[0], axis);
    struct vec origin = a[0];
    for (int32_t i = 1; i < count; i++) {
        float value = vec_dot(a[i], axis);
        origin = value > highest ? a[i] : origin;
        highest = max_f(value, highest);
    }
    return sweep_lowest(b, start, end, axis, origin) > apart;
}

/* Along the side of B that faces A most at the start: what separates a corner of A from the middle of that side. */
static bool parted_by_side(const struct vec *a, int32_t count, const struct polygon *b, const struct pose *start,
                           const struct pose *end, float apart)
{
    struct vec local[MAX_VERTICES];
    for (int32_t i = 0; i < count; i++) {
        local[i] = pose_apply_inverse(start, a[i]);
    }
    float widest = -FLT_MAX;
    int32_t side = 0;
    for (int32_t i = 0; i < b->count; i++) {
        float least = FLT_MAX;
        for (int32_t j = 0; j < count; j++) {
            least = min_f(least, vec_dot(b->normal[i], vec_sub(local[j], b->vertex[i])));
        }
        if (least > widest) {
            widest = least;
            side = i;
        }
    }
    return widest > apart &&
           parted_along(vec_negate(rot_apply(start->q, b->normal[side])), a, count, b, start, end, apart);
}

static __attribute__((noinline)) bool impact_possible_apart(const struct vec *a, int32_t count, const struct polygon *b,
                                                            const struct pose *start, const struct pose *end,
                                                            float apart)
{
    return !(parted_along(vec_make(0.0f, 1.0f), a, count, b, start, end, apart) ||
             parted_along(vec_make(-1.0f, 0.0f), a, count, b, start, end, apart) ||
             parted_along(vec_make(1.0f, 0.0f), a, count, b, start, end, apart) ||
             parted_along(vec_make(0.0f, -1.0f), a, count, b, start, end, apart) ||
             parted_by_side(a, count, b, start, end, apart));
}

bool impact_possible(const struct vec *a, int32_t count, const struct polygon *b, const struct pose *start,
                     const struct pose *end, float angle_change)
{
    return impact_possible_apart(a, count, b, start, end, clearance(b, angle_change));
}

bool impact_possible_edge(const struct edge *a, const struct polygon *b, const struct pose *start,
                          const struct pose *end, float angle_change)
{
    float apart = clearance(b, angle_change);
    if (sweep_lowest(b, start, end, vec_negate(a->normal), a->a) > apart) {
        return false;
    }
    const struct vec ends[2] = {a->a, a->b};
    return impact_possible_apart(ends, 2, b, start, end, apart);
}
