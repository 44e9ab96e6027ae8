/* SPDX-License-Identifier: MIT
 *
 * The ground of one episode, drawn from the same random numbers as Gymnasium draws it.
 */
#ifndef BITNEAT_WALKER_TERRAIN_H
#define BITNEAT_WALKER_TERRAIN_H

#include "geometry.h"

enum { TERRAIN_LENGTH = 200, NUM_EDGES = TERRAIN_LENGTH - 1, MAX_POLYGONS = 64 };

/* The state of NumPy's PCG64 bit generator: two 128-bit numbers, and the half of a 64-bit draw that is kept for the next
 * 32-bit one. The fields are those of `numpy.random.PCG64().state`, high word first. */
struct pcg64 {
    uint64_t state[2], increment[2];
    uint32_t has_uint32, uinteger;
};

struct box {
    struct vec low, high;
};

struct terrain {
    struct edge edge[NUM_EDGES]; /* from left to right; the end of one is the start of the next */
    struct box edge_fat[NUM_EDGES];
    int32_t num_polygons; /* 0 but for hardcore; in the order of their making */
    struct polygon polygon[MAX_POLYGONS];
    struct box polygon_fat[MAX_POLYGONS]; /* bounding boxes with the skin, and with the broad phase's margin of 0.1 */
    float start_force;                    /* on the hull in the first step, along x */
};

/* Draws the ground, the clouds (which nobody sees) and the starting force of an episode; `rng` is left as Gymnasium leaves it. */
void terrain_generate(struct terrain *ground, struct pcg64 *rng, bool hardcore);

/* A polygon from 3 to MAX_VERTICES points, as Box2D's b2PolygonShape::Set makes it (convex hull, normals, centroid). */
void polygon_set(struct polygon *shape, const struct vec *points, int32_t count);

/* A polygon's bounding box in a pose (null for world coordinates), with its skin. */
struct box polygon_bounds(const struct polygon *shape, const struct pose *pose);

#endif
