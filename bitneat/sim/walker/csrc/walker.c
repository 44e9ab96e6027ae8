/* SPDX-License-Identifier: MIT
 *
 * What a step does to one walker before and after the solver: contacts with the ground, broad phase, sleep, and impacts.
 */
#include "walker.h"

#include <stddef.h>
#include <string.h>

#include "collide.h"
#include "impact.h"
#include "trig.h"

#define FAT_MARGIN 0.1f
#define FAT_PREDICTION 2.0f
#define TIME_TO_SLEEP 0.5f
#define LINEAR_SLEEP_TOLERANCE 0.01f
#define GRAVITY (-10.0f)

enum { MAX_IMPACTS = 8 };

static bool overlap(const struct box *a, const struct box *b)
{
    return !(b->low.x - a->high.x > 0.0f || b->low.y - a->high.y > 0.0f || a->low.x - b->high.x > 0.0f ||
             a->low.y - b->high.y > 0.0f);
}

static const struct box *fat_box(const struct terrain *ground, int shape)
{
    return shape < NUM_EDGES ? &ground->edge_fat[shape] : &ground->polygon_fat[shape - NUM_EDGES];
}

static void wake(struct body *body)
{
    if (!body->awake) {
        body->awake = true;
        body->sleep_time = 0.0f;
    }
}

static void add_contact(struct walker *w, struct body *body, int shape)
{
    for (int32_t i = 0; i < body->num_contacts; ++i) {
        if (body->contact[i].shape == shape) {
            return;
        }
    }
    if (body->num_contacts == MAX_CONTACTS) {
        w->overflow = true;
        return;
    }
    struct contact *contact = &body->contact[body->num_contacts++];
    contact->shape = (int16_t)shape;
    contact->impacts = 0;
    contact->touching = contact->has_impact = false;
    contact->enabled = true;
    contact->manifold.count = 0;
    wake(body);
}

/* Edges stand side by side, so only those under the box are looked at. */
static void find_contacts(struct walker *w, struct body *body)
{
    const struct terrain *ground = w->ground;
    for (int32_t i = 0; i < ground->num_polygons; ++i) {
        if (overlap(&body->fat, &ground->polygon_fat[i])) {
            add_contact(w, body, NUM_EDGES + i);
        }
    }
    const float per_step = 30.0f / 14.0f;
    const float first = body->fat.low.x * per_step - 2.0f;
    const float last = body->fat.high.x * per_step + 2.0f;
    const int begin = first > 0.0f ? (first < NUM_EDGES ? (int)first : NUM_EDGES) : 0;
    const int end = last < NUM_EDGES - 1 ? (last > -1.0f ? (int)last + 1 : 0) : NUM_EDGES;
    for (int i = begin; i < end; ++i) {
        if (overlap(&body->fat, &ground->edge_fat[i])) {
            add_contact(w, body, i);
        }
    }
}

static void begin_contact(struct walker *w, int index)
{
    if (index == HULL) {
        w->fallen = true;
    } else if (index == LOWER_1 || index == LOWER_2) {
        w->leg_contact[index == LOWER_2] = true;
    }
}

/* Gymnasium says that a leg is in the air as soon as any of its contacts ends, and so do we. */
static void end_contact(struct walker *w, int index)
{
    if (index == LOWER_1 || index == LOWER_2) {
        w->leg_contact[index == LOWER_2] = false;
    }
}

static void update_contact(struct walker *w, int index, struct contact *contact)
{
    struct body *body = &w->body[index];
    struct manifold *m = &contact->manifold;
    const struct manifold_point old[2] = {m->point[0], m->point[1]};
    const int32_t old_count = m->count;
    if (contact->shape < NUM_EDGES) {
        collide_edge(m, &w->ground->edge[contact->shape], &walker_model.body[index].shape, &body->pose);
    } else {
        collide_polygon(m, &w->ground->polygon[contact->shape - NUM_EDGES], &walker_model.body[index].shape,
                        &body->pose);
    }
    contact->enabled = true;
    for (int32_t i = 0; i < m->count; ++i) {
        m->point[i].normal_impulse = m->point[i].tangent_impulse = 0.0f;
        for (int32_t j = 0; j < old_count; ++j) {
            if (old[j].id == m->point[i].id) {
                m->point[i].normal_impulse = old[j].normal_impulse;
                m->point[i].tangent_impulse = old[j].tangent_impulse;
                break;
            }
        }
    }
    const bool touching = m->count > 0;
    if (touching == contact->touching) {
        return;
    }
    contact->touching = touching;
    wake(body);
    if (touching) {
        begin_contact(w, index);
    } else {
        end_contact(w, index);
    }
}

static void collide(struct walker *w, int index)
{
    struct body *body = &w->body[index];
    for (int32_t i = body->num_contacts; i-- > 0;) {
        struct contact *contact = &body->contact[i];
        if (overlap(fat_box(w->ground, contact->shape), &body->fat)) {
            update_contact(w, index, contact);
            continue;
        }
        if (contact->touching) {
            end_contact(w, index);
        }
        --body->num_contacts;
        memmove(contact, contact + 1, (size_t)(body->num_contacts - i) * sizeof *contact);
    }
}

static struct box fatten(struct box box)
{
    const struct vec margin = {FAT_MARGIN, FAT_MARGIN};
    box.low = vec_sub(box.low, margin);
    box.high = vec_add(box.high, margin);
    return box;
}

static bool contains(const struct box *outer, const struct box *inner)
{
    return outer->low.x <= inner->low.x && outer->low.y <= inner->low.y && inner->high.x <= outer->high.x &&
           inner->high.y <= outer->high.y;
}

/* Follows a body that went from its start to its pose with its box in the broad phase, if it has left that. */
static void follow(struct walker *w, int index)
{
    struct body *body = &w->body[index];
    const struct polygon *shape = &walker_model.body[index].shape;
    const struct box from = polygon_bounds(shape, &body->start);
    const struct box to = polygon_bounds(shape, &body->pose);
    const struct box swept = {
        {min_f(from.low.x, to.low.x), min_f(from.low.y, to.low.y)},
        {max_f(from.high.x, to.high.x), max_f(from.high.y, to.high.y)},
    };
    if (contains(&body->fat, &swept)) {
        return;
    }
    const struct vec ahead = vec_scale(FAT_PREDICTION, vec_sub(body->pose.p, body->start.p));
    body->fat = fatten(swept);
    *(ahead.x < 0.0f ? &body->fat.low.x : &body->fat.high.x) += ahead.x;
    *(ahead.y < 0.0f ? &body->fat.low.y : &body->fat.high.y) += ahead.y;
    find_contacts(w, body);
}

static struct pose pose_at(struct vec center, struct rot q, struct vec local_center)
{
    const struct pose pose = {vec_sub(center, rot_apply(q, local_center)), q};
    return pose;
}

void walker_reset(struct walker *w, const struct terrain *ground)
{
    memset(w, 0, sizeof *w);
    w->ground = ground;
    w->force = ground->start_force;
    w->rays = (1U << NUM_RAYS) - 1U;
    for (int i = 0; i < NUM_BODIES; ++i) {
        struct body *body = &w->body[i];
        const struct body_model *model = &walker_model.body[i];
        body->pose.p = model->start;
        body->pose.q = rot_from_angle(model->start_angle);
        body->a = model->start_angle;
        body->c = pose_apply(&body->pose, model->center);
        body->sweep.local_center = model->center;
        body->awake = true;
        body->fat = fatten(polygon_bounds(&model->shape, &body->pose));
        find_contacts(w, body);
    }
}

void walker_begin(struct walker *w, const float *action)
{
    for (int i = 0; i < NUM_JOINTS; ++i) {
        const float a = action[i];
        const float size = fabsf(a);
        w->joint[i].speed = a > 0.0f ? walker_model.joint[i].speed : a < 0.0f ? -walker_model.joint[i].speed : 0.0f;
        w->joint[i].max_torque = 80.0f * (size < 1.0f ? size : 1.0f);
    }
    for (int i = 0; i < NUM_BODIES; ++i) {
        wake(&w->body[i]); /* as setting a motor does */
    }
    const float h = walker_model.time_step;
    for (int i = 0; i < NUM_BODIES; ++i) {
        struct body *body = &w->body[i];
        collide(w, i);
        body->start = pose_at(body->c, body->pose.q, body->sweep.local_center);
        body->sweep.c0 = body->c;
        body->sweep.a0 = body->a;
        body->sweep.alpha0 = 0.0f;
        body->v.x += h * (walker_model.body[i].inverse_mass * (i == HULL ? w->force : 0.0f));
        body->v.y += h * GRAVITY;
    }
    w->force = 0.0f;
}

/* The walker falls asleep as a whole, once all its bodies have been still for a while. */
static void fall_asleep(struct walker *w)
{
    float shortest = TIME_TO_SLEEP;
    for (int i = 0; i < NUM_BODIES; ++i) {
        struct body *body = &w->body[i];
        if (body->w * body->w > ANGULAR_SLOP * ANGULAR_SLOP ||
            vec_dot(body->v, body->v) > LINEAR_SLEEP_TOLERANCE * LINEAR_SLEEP_TOLERANCE) {
            body->sleep_time = 0.0f;
            shortest = 0.0f;
        } else {
            body->sleep_time += walker_model.time_step;
            shortest = min_f(shortest, body->sleep_time);
        }
    }
    if (shortest < TIME_TO_SLEEP || !w->positions_solved) {
        return;
    }
    for (int i = 0; i < NUM_BODIES; ++i) {
        struct body *body = &w->body[i];
        body->awake = false;
        body->sleep_time = 0.0f;
        body->v = vec_make(0.0f, 0.0f);
        body->w = 0.0f;
    }
}

/* When a contact's shapes meet in what is left of the step; 1 if they do not. */
static float impact_of(const struct walker *w, int index, const struct contact *contact)
{
    const struct body *body = &w->body[index];
    const struct sweep *sweep = &body->sweep;
    const struct polygon *shape = &walker_model.body[index].shape;
    const float turn = sweep->a - sweep->a0;
    float t;
    bool touching;
    if (contact->shape < NUM_EDGES) {
        const struct edge *edge = &w->ground->edge[contact->shape];
        const struct vec ends[2] = {edge->a, edge->b};
        touching = impact_possible_edge(edge, shape, &body->start, &body->pose, turn) &&
                   time_of_impact(ends, 2, shape, sweep, &t);
    } else {
        const struct polygon *polygon = &w->ground->polygon[contact->shape - NUM_EDGES];
        touching = impact_possible(polygon->vertex, polygon->count, shape, &body->start, &body->pose, turn) &&
                   time_of_impact(polygon->vertex, polygon->count, shape, sweep, &t);
    }
    return touching ? min_f(sweep->alpha0 + (1.0f - sweep->alpha0) * t, 1.0f) : 1.0f;
}

/* Moves a body to where it is at a time of its sweep, and makes that its end. */
static void advance(struct body *body, float time)
{
    struct sweep *sweep = &body->sweep;
    const float beta = (time - sweep->alpha0) / (1.0f - sweep->alpha0);
    sweep->c0 = vec_add(vec_scale(1.0f - beta, sweep->c0), vec_scale(beta, sweep->c));
    sweep->a0 = (1.0f - beta) * sweep->a0 + beta * sweep->a;
    sweep->alpha0 = time;
    sweep->c = sweep->c0;
    sweep->a = sweep->a0;
    body->pose = pose_at(sweep->c, rot_from_angle(sweep->a), sweep->local_center);
}

/* The body stops at its impact, and what is left of the step is solved for it alone. */
static void handle_impact(struct walker *w, int index, struct contact *first, float time)
{
    struct body *body = &w->body[index];
    const struct sweep backup = body->sweep;
    advance(body, time);
    update_contact(w, index, first);
    first->has_impact = false;
    ++first->impacts;
    if (!first->touching) {
        first->enabled = false;
        body->sweep = backup;
        body->pose = pose_at(backup.c, rot_from_angle(backup.a), backup.local_center);
        return;
    }
    wake(body);
    struct contact *island[MAX_ISLAND_CONTACTS] = {first};
    int count = 1;
    for (int32_t i = body->num_contacts; i-- > 0 && count < MAX_ISLAND_CONTACTS;) {
        struct contact *contact = &body->contact[i];
        if (contact == first) {
            continue;
        }
        update_contact(w, index, contact);
        if (contact->touching) {
            island[count++] = contact;
        }
    }
    walker_substep(body, index, island, count, (1.0f - time) * walker_model.time_step);
    body->start = pose_at(body->sweep.c0, rot_from_angle(body->sweep.a0), body->sweep.local_center);
    body->pose = pose_at(body->sweep.c, rot_from_angle(body->sweep.a), body->sweep.local_center);
    for (int32_t i = 0; i < body->num_contacts; ++i) {
        body->contact[i].has_impact = false;
    }
    follow(w, index);
}

/* Impacts of one body, in the order of time. Those of different bodies do not touch one another: joints are not looked at here, and
 * the ground does not move. */
static void handle_impacts(struct walker *w, int index)
{
    struct body *body = &w->body[index];
    for (int32_t i = 0; i < body->num_contacts; ++i) {
        body->contact[i].has_impact = false;
        body->contact[i].impacts = 0;
    }
    for (;;) {
        struct contact *first = NULL;
        float earliest = 1.0f;
        for (int32_t i = body->num_contacts; i-- > 0;) {
            struct contact *contact = &body->contact[i];
            if (!contact->enabled || contact->impacts > MAX_IMPACTS) {
                continue;
            }
            if (!contact->has_impact) {
                if (!body->awake) {
                    continue;
                }
                contact->impact = impact_of(w, index, contact);
                contact->has_impact = true;
            }
            if (contact->impact < earliest) {
                first = contact;
                earliest = contact->impact;
            }
        }
        if (first == NULL || 1.0f - 10.0f * EPSILON < earliest) {
            break;
        }
        handle_impact(w, index, first, earliest);
    }
    body->c = body->sweep.c;
    body->a = body->sweep.a;
}

void walker_end(struct walker *w)
{
    fall_asleep(w);
    for (int i = 0; i < NUM_BODIES; ++i) {
        struct body *body = &w->body[i];
        body->sweep.c = body->c;
        body->sweep.a = body->a;
        follow(w, i);
        if (body->num_contacts > 0) {
            handle_impacts(w, i);
        }
    }
}
