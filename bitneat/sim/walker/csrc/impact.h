/* SPDX-License-Identifier: MIT
 *
 * Time of impact: when, during a step, a moving polygon first comes as near to a terrain shape as the skin allows.
 *
 * Nearly always it does not, and a fixed axis shows that for far less than the search costs: ask impact_possible (or, of an edge,
 * impact_possible_edge) first and time_of_impact only if that says true. Either way the answer is the same, bit for bit.
 */
#ifndef BITNEAT_WALKER_IMPACT_H
#define BITNEAT_WALKER_IMPACT_H

#include "geometry.h"

/* True, and the time in *t, iff the shapes touch. Shape A is `count` vertices in world coordinates; B moves along `sweep`, whose
 * part from c0, a0 (time 0) to c, a (time 1) counts; alpha0 is not looked at. */
bool time_of_impact(const struct vec *a, int32_t count, const struct polygon *b, const struct sweep *sweep, float *t);

/* False only if time_of_impact would return false. `start` and `end` are B's poses at times 0 and 1, `angle_change` is the
 * sweep's a - a0. B's centre of mass is its polygon's centroid; coordinates are within 200, angles within 1000, sides of A above
 * 0.4. What lies behind an edge, where its normal points to, is not ruled out as well as what lies before it. */
bool impact_possible(const struct vec *a, int32_t count, const struct polygon *b, const struct pose *start,
                     const struct pose *end, float angle_change);
bool impact_possible_edge(const struct edge *a, const struct polygon *b, const struct pose *start,
                          const struct pose *end, float angle_change);

#endif
