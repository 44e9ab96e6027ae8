/* SPDX-License-Identifier: MIT
 *
 * Where a polygon of the walker touches the terrain.
 */
#ifndef BITNEAT_WALKER_COLLIDE_H
#define BITNEAT_WALKER_COLLIDE_H

#include "geometry.h"

/* Fill in a manifold, all but the impulses of its points. Shape A is the terrain's, in world coordinates; `pose` is that of B. A
 * count of 0 leaves the other fields undefined. */
void collide_edge(struct manifold *m, const struct edge *a, const struct polygon *b, const struct pose *pose);
void collide_polygon(struct manifold *m, const struct polygon *a, const struct polygon *b, const struct pose *pose);

#endif
