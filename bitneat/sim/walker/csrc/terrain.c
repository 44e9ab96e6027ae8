/* SPDX-License-Identifier: MIT
 *
 * The ground is computed in double, as Python computes it, and rounded to float32 once, where Gymnasium hands it to Box2D. Which
 * random numbers are drawn, and when, decides everything that follows; so every draw is here, those that nobody sees included.
 */
#include <stddef.h>

#include "terrain.h"

__extension__ typedef unsigned __int128 wide;

#define SCALE 30.0
#define STEP (14 / SCALE) /* from one point of the ground to the next */
#define LEVEL_AT_START (400 / SCALE / 4)
#define PIT_DEPTH (4 * STEP)
#define FORCE_LIMIT 5.0
#define FAT_MARGIN 0.1f

enum {
    START_PAD = 20, /* points of level ground at the left end */
    GRASS_SHORTEST = 5,
    GRASS_LIMIT = 10,
    STAIR_WIDTH = 4,
    CLOUDS = 10,
    DRAWS_PER_CLOUD = 1 + 2 * 5, /* its place, and five corners */
};

/* What the ground consists of, numbered as it is drawn. */
enum segment { GRASS, STUMP, STAIRS, PIT, NUM_SEGMENTS };

/* The bit generator while it is at work: words joined, and in a variable of its own so that it can stay in registers. */
struct source {
    wide state, increment;
    uint32_t has_half, half;
};

/* The point that the next height is for, and what carries over from one segment to the next. */
struct walk {
    int32_t i;
    double y, velocity;
    double *height;
};

static inline void advance(struct source *rng)
{
    const wide multiplier = (wide)0x2360ed051fc65da4u << 64 | 0x4385df649fccf645u;
    rng->state = rng->state * multiplier + rng->increment;
}

static inline uint64_t draw_64(struct source *rng)
{
    advance(rng);
    uint64_t high = (uint64_t)(rng->state >> 64);
    uint64_t folded = high ^ (uint64_t)rng->state;
    uint32_t turn = (uint32_t)(high >> 58);
    return folded >> turn | folded << (-turn & 63);
}

/* Each 64-bit number serves two draws, its low half first; what draws 64 bits in between leaves the kept half alone. */
static inline uint32_t draw_32(struct source *rng)
{
    if (rng->has_half) {
        rng->has_half = 0;
        return rng->half;
    }
    uint64_t both = draw_64(rng);
    rng->has_half = 1;
    rng->half = (uint32_t)(both >> 32);
    return (uint32_t)both;
}

/* Generator.random. */
static inline double draw_fraction(struct source *rng)
{
    return (double)(draw_64(rng) >> 11) * 0x1p-53;
}

/* Generator.uniform. */
static inline double draw_uniform(struct source *rng, double low, double high)
{
    return low + (high - low) * draw_fraction(rng);
}

/* Generator.integers, low <= result < high. One number to choose from takes no draw: do not call it then. */
static inline int32_t draw_integer(struct source *rng, int32_t low, int32_t high)
{
    uint32_t choices = (uint32_t)(high - low);
    uint64_t product = (uint64_t)draw_32(rng) * choices;
    if ((uint32_t)product < choices) {
        uint32_t uneven = -choices % choices; /* 2**32 modulo the choices: so many products would favour some of them */
        while ((uint32_t)product < uneven) {
            product = (uint64_t)draw_32(rng) * choices;
        }
    }
    return low + (int32_t)(product >> 32);
}

/* The first hull vertex is the rightmost point, and of several the lowest. */
static int32_t rightmost(const struct vec *points, int32_t count)
{
    int32_t best = 0;
    for (int32_t i = 1; i < count; ++i) {
        struct vec p = points[i], q = points[best];
        if (p.x > q.x || (p.x == q.x && p.y < q.y)) {
            best = i;
        }
    }
    return best;
}

/* The hull vertex that follows `from` counter-clockwise: no point lies to the right of the way there, and of those on it the
 * farthest is taken. */
static int32_t wrap(const struct vec *points, int32_t count, int32_t from)
{
    int32_t best = 0;
    for (int32_t i = 1; i < count; ++i) {
        if (best == from) {
            best = i;
            continue;
        }
        struct vec along = vec_sub(points[best], points[from]);
        struct vec other = vec_sub(points[i], points[from]);
        float side = vec_cross(along, other);
        if (side < 0.0f || (side == 0.0f && vec_dot(other, other) > vec_dot(along, along))) {
            best = i;
        }
    }
    return best;
}

/* The mean of the triangles between the origin and each side, weighted with their areas. */
static struct vec area_center(const struct polygon *shape)
{
    struct vec sum = {0.0f, 0.0f};
    float area = 0.0f;
    for (int32_t i = 0; i < shape->count; ++i) {
        struct vec p = shape->vertex[i];
        struct vec q = shape->vertex[i + 1 < shape->count ? i + 1 : 0];
        float part = 0.5f * vec_cross(p, q);
        area += part;
        sum = vec_add(sum, vec_scale(part * (1.0f / 3.0f), vec_add(p, q)));
    }
    return vec_scale(1.0f / area, sum);
}

void polygon_set(struct polygon *shape, const struct vec *points, int32_t count)
{
    int32_t start = rightmost(points, count);
    int32_t from = start;
    int32_t n = 0;
    do { /* points that rounding makes contradict each other could go round without coming back to the start */
        shape->vertex[n++] = points[from];
        from = wrap(points, count, from);
    } while (from != start && n < count);
    shape->count = n;
    for (int32_t i = 0; i < n; ++i) {
        struct vec side = vec_sub(shape->vertex[i + 1 < n ? i + 1 : 0], shape->vertex[i]);
        shape->normal[i] = vec_cross_scalar(side, 1.0f);
        vec_normalize(&shape->normal[i]);
    }
    shape->centroid = area_center(shape);
}

static inline struct box grown(struct box b, float margin)
{
    struct vec r = {margin, margin};
    struct box larger = {vec_sub(b.low, r), vec_add(b.high, r)};
    return larger;
}

static inline struct box box_of_two(struct vec a, struct vec b)
{
    struct box bounds = {{min_f(a.x, b.x), min_f(a.y, b.y)}, {max_f(a.x, b.x), max_f(a.y, b.y)}};
    return bounds;
}

struct box polygon_bounds(const struct polygon *shape, const struct pose *pose)
{
    struct box bounds = {{0.0f, 0.0f}, {0.0f, 0.0f}};
    for (int32_t i = 0; i < shape->count; ++i) {
        struct vec v = pose ? pose_apply(pose, shape->vertex[i]) : shape->vertex[i];
        if (i == 0) {
            bounds.low = bounds.high = v;
        } else {
            bounds.low = vec_make(min_f(bounds.low.x, v.x), min_f(bounds.low.y, v.y));
            bounds.high = vec_make(max_f(bounds.high.x, v.x), max_f(bounds.high.y, v.y));
        }
    }
    return grown(bounds, POLYGON_RADIUS);
}

/* The corners' order is free: the hull of a rectangle comes out the same from any. */
static void add_rectangle(struct terrain *ground, double left, double right, double bottom, double top)
{
    float x0 = (float)left, x1 = (float)right, y0 = (float)bottom, y1 = (float)top;
    const struct vec corners[] = {{x1, y0}, {x1, y1}, {x0, y1}, {x0, y0}};
    /* There is always room: nothing is denser than two rectangles to 10 points, a pit of 5 and a grass of 5. */
    int32_t n = ground->num_polygons++;
    polygon_set(&ground->polygon[n], corners, 4);
    ground->polygon_fat[n] = grown(polygon_bounds(&ground->polygon[n], NULL), FAT_MARGIN);
}

/* Where a segment of this length stops: where it ends, or where the ground does. */
static inline int32_t stop_at(const struct walk *at, int32_t length)
{
    int32_t end = at->i + length;
    return end < TERRAIN_LENGTH ? end : TERRAIN_LENGTH;
}

static void level(struct walk *at, int32_t length)
{
    for (int32_t stop = stop_at(at, length); at->i < stop; ++at->i) {
        at->height[at->i] = at->y;
    }
}

/* Rolling ground, drawn back to the level of the start; its first point continues what was before. */
static void grass(struct walk *at, int32_t length, struct source *rng)
{
    int32_t stop = stop_at(at, length);
    double y = at->y, velocity = at->velocity;
    at->height[at->i] = y;
    for (int32_t i = at->i + 1; i < stop; ++i) {
        double away = LEVEL_AT_START - y;
        velocity = 0.8 * velocity + 0.01 * ((away > 0.0) - (away < 0.0));
        velocity += draw_uniform(rng, -1.0, 1.0) / SCALE;
        y += velocity;
        at->height[i] = y;
    }
    at->y = y;
    at->velocity = velocity;
    at->i = stop;
}

static int32_t stump(struct walk *at, struct source *rng, struct terrain *ground)
{
    int32_t size = draw_integer(rng, 1, 3);
    double x = at->i * STEP;
    add_rectangle(ground, x, x + size * STEP, at->y, at->y + size * STEP);
    level(at, size);
    return size;
}

static int32_t stairs(struct walk *at, struct source *rng, struct terrain *ground)
{
    int32_t up = draw_fraction(rng) > 0.5 ? 1 : -1;
    int32_t steps = draw_integer(rng, 3, 5); /* the width is drawn before it, from one number: no draw */
    int32_t length = steps * STAIR_WIDTH;
    int32_t start = at->i, stop = stop_at(at, length);
    double x = start * STEP, base = at->y;
    for (int32_t s = 0; s < steps; ++s) {
        double left = x + (s * STAIR_WIDTH) * STEP, right = x + ((1 + s) * STAIR_WIDTH) * STEP;
        add_rectangle(ground, left, right, base + (-1 + s * up) * STEP, base + (s * up) * STEP);
    }
    at->height[start] = base;
    for (int32_t i = start + 1; i < stop; ++i) {
        double risen = (double)(i - start - up) / STAIR_WIDTH;
        at->y = base + (risen * up) * STEP;
        at->height[i] = at->y;
    }
    at->i = stop;
    return length;
}

/* Two walls, with a gap of `gap` points between their left sides; the ground between them lies deep, its last point does not. */
static int32_t pit(struct walk *at, struct source *rng, struct terrain *ground)
{
    int32_t gap = draw_integer(rng, 3, 5);
    int32_t length = gap + 2;
    int32_t start = at->i, stop = stop_at(at, length);
    double x = start * STEP, bottom = at->y - PIT_DEPTH;
    add_rectangle(ground, x, x + STEP, bottom, at->y);
    add_rectangle(ground, x + STEP * gap, (x + STEP) + STEP * gap, bottom, at->y);
    for (int32_t i = start; i < stop; ++i) {
        bool rim = i == start || i == start + length - 1;
        at->height[i] = rim ? at->y : bottom;
    }
    at->i = stop;
    return length;
}

/* One segment after another; the next is drawn at the last point of each, even if that is the last point of all. */
static void lay_ground(struct terrain *ground, double *height, struct source *rng, bool hardcore)
{
    struct walk at = {0, LEVEL_AT_START, 0.0, height};
    enum segment kind = GRASS;
    int32_t length = START_PAD;
    level(&at, START_PAD); /* grass, but nothing is drawn for it and nothing moves it */
    for (int32_t end = START_PAD;;) {
        if (at.i == end) {
            length = draw_integer(rng, GRASS_SHORTEST, GRASS_LIMIT);
            kind = hardcore && kind == GRASS ? (enum segment)draw_integer(rng, 1, NUM_SEGMENTS) : GRASS;
        }
        if (at.i == TERRAIN_LENGTH) {
            return;
        }
        end = at.i;
        switch (kind) {
        case STUMP:
            end += stump(&at, rng, ground);
            break;
        case STAIRS:
            end += stairs(&at, rng, ground);
            break;
        case PIT:
            end += pit(&at, rng, ground);
            break;
        default:
            grass(&at, length, rng);
            end += length;
        }
    }
}

static void set_edges(struct terrain *ground, const double *height)
{
    struct vec a = vec_make(0.0f, (float)height[0]);
    for (int32_t i = 0; i < NUM_EDGES; ++i) {
        struct vec b = vec_make((float)((i + 1) * STEP), (float)height[i + 1]);
        struct vec along = vec_sub(b, a);
        vec_normalize(&along);
        struct edge segment = {a, b, {along.y, -along.x}};
        ground->edge[i] = segment;
        ground->edge_fat[i] = grown(grown(box_of_two(a, b), POLYGON_RADIUS), FAT_MARGIN);
        a = b;
    }
}

void terrain_generate(struct terrain *ground, struct pcg64 *rng, bool hardcore)
{
    struct source draws = {
        (wide)rng->state[0] << 64 | rng->state[1],
        (wide)rng->increment[0] << 64 | rng->increment[1],
        rng->has_uint32,
        rng->uinteger,
    };
    double height[TERRAIN_LENGTH];
    ground->num_polygons = 0;
    lay_ground(ground, height, &draws, hardcore);
    set_edges(ground, height);
    for (int32_t i = 0; i < CLOUDS * DRAWS_PER_CLOUD; ++i) {
        advance(&draws);
    }
    ground->start_force = (float)draw_uniform(&draws, -FORCE_LIMIT, FORCE_LIMIT);
    rng->state[0] = (uint64_t)(draws.state >> 64);
    rng->state[1] = (uint64_t)draws.state;
    rng->has_uint32 = draws.has_half;
    rng->uinteger = draws.half;
}
