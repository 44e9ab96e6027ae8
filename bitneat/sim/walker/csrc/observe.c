/* SPDX-License-Identifier: MIT
 *
 * What a walker sees and earns: observation, lidar and reward, as Gymnasium computes them.
 */
#include "walker.h"

/* Gymnasium's numbers, in double as Python has them. */
static const double SCALE = 30.0;
static const double FRAMES_PER_SECOND = 50.0;

/* How far along a ray an edge is, as part of the ray's length; `nearest` if it is no nearer than that. */
static float cast_at_edge(const struct edge *edge, struct vec from, struct vec ray, float nearest)
{
    const float numerator = vec_dot(edge->normal, vec_sub(edge->a, from));
    const float denominator = vec_dot(edge->normal, ray);
    if (denominator == 0.0f) {
        return nearest;
    }
    const float t = numerator / denominator;
    if (t < 0.0f || nearest < t) {
        return nearest;
    }
    const struct vec along = vec_sub(edge->b, edge->a);
    const struct vec hit = vec_add(from, vec_scale(t, ray));
    const float s = vec_dot(vec_sub(hit, edge->a), along) / vec_dot(along, along);
    return s < 0.0f || 1.0f < s ? nearest : t;
}

static float cast_at_polygon(const struct polygon *polygon, struct vec from, struct vec ray, float nearest)
{
    float lower = 0.0f;
    float upper = nearest;
    bool hit = false;
    for (int32_t i = 0; i < polygon->count; ++i) {
        const float numerator = vec_dot(polygon->normal[i], vec_sub(polygon->vertex[i], from));
        const float denominator = vec_dot(polygon->normal[i], ray);
        if (denominator == 0.0f) {
            if (numerator < 0.0f) {
                return nearest;
            }
        } else if (denominator < 0.0f && numerator < lower * denominator) {
            lower = numerator / denominator;
            hit = true;
        } else if (denominator > 0.0f && numerator < upper * denominator) {
            upper = numerator / denominator;
        }
        if (upper < lower) {
            return nearest;
        }
    }
    return hit ? lower : nearest;
}

static float cast_ray(const struct terrain *ground, struct vec from, struct vec to)
{
    const struct vec ray = vec_sub(to, from);
    float nearest = 1.0f;
    for (int32_t i = 0; i < ground->num_polygons; ++i) {
        const struct box *box = &ground->polygon_fat[i];
        if (box->low.x <= to.x && from.x <= box->high.x) {
            nearest = cast_at_polygon(&ground->polygon[i], from, ray, nearest);
        }
    }
    const float per_step = 30.0f / 14.0f;
    const float first = from.x * per_step - 2.0f;
    const float last = to.x * per_step + 2.0f;
    const int begin = first > 0.0f ? (first < NUM_EDGES ? (int)first : NUM_EDGES) : 0;
    const int end = last < NUM_EDGES - 1 ? (last > -1.0f ? (int)last + 1 : 0) : NUM_EDGES;
    for (int i = begin; i < end; ++i) {
        nearest = cast_at_edge(&ground->edge[i], from, ray, nearest);
    }
    return nearest;
}

void walker_observe(const struct walker *w, float *observation)
{
    const struct body *hull = &w->body[HULL];
    observation[0] = hull->a;
    observation[1] = (float)(2.0 * hull->w / FRAMES_PER_SECOND);
    observation[2] = (float)(0.3 * hull->v.x * (600 / SCALE) / FRAMES_PER_SECOND);
    observation[3] = (float)(0.3 * hull->v.y * (400 / SCALE) / FRAMES_PER_SECOND);
    for (int leg = 0; leg < 2; ++leg) {
        float *out = observation + 4 + 5 * leg;
        for (int i = 0; i < 2; ++i) {
            const struct joint_model *joint = &walker_model.joint[2 * leg + i];
            const struct body *a = &w->body[joint->a];
            const struct body *b = &w->body[joint->b];
            const float angle = b->a - a->a - joint->reference;
            out[2 * i] = i == 0 ? angle : (float)(angle + 1.0);
            out[2 * i + 1] = (float)((double)(b->w - a->w) / joint->speed);
        }
        out[4] = w->leg_contact[leg] ? 1.0f : 0.0f;
    }
    for (int i = 0; i < NUM_RAYS; ++i) {
        observation[FIRST_RAY + i] = 1.0f;
        if ((w->rays >> i & 1U) != 0) {
            const struct vec to = vec_make((float)(hull->pose.p.x + walker_model.ray_across[i]),
                                           (float)(hull->pose.p.y - walker_model.ray_down[i]));
            observation[FIRST_RAY + i] = cast_ray(w->ground, hull->pose.p, to);
        }
    }
}

double walker_reward(struct walker *w, const float *action, bool *terminated)
{
    const double x = w->body[HULL].pose.p.x;
    const double shaping = 130 * x / SCALE - 5.0 * fabs((double)w->body[HULL].a);
    float reward = w->has_shaping ? (float)(shaping - w->shaping) : 0.0f;
    w->shaping = shaping;
    w->has_shaping = true;
    for (int i = 0; i < NUM_ACTIONS; ++i) {
        const float size = fabsf(action[i]);
        reward -= walker_model.effort * (size < 1.0f ? size : 1.0f);
    }
    const bool lost = w->fallen || x < 0.0;
    *terminated = lost || x > walker_model.goal;
    return lost ? -100.0 : (double)reward;
}
