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

/* Gymnasium's numbers, in double as Python has them. */
static const double SCALE = 30.0;
static const double FRAMES_PER_SECOND = 50.0;

struct model walker_model;

static float mix_friction(float a, float b)
{
    return sqrtf(a * b);
}

/* Mass, centre and inertia of a polygon of even density: sums over triangles around the mean of its vertices. */
static void weigh(struct body_model *body, float density)
{
    const struct polygon *shape = &body->shape;
    const float third = 1.0f / 3.0f;
    struct vec mean = {0.0f, 0.0f};
    for (int i = 0; i < shape->count; ++i) {
        mean = vec_add(mean, shape->vertex[i]);
    }
    mean = vec_scale(1.0f / (float)shape->count, mean);
    struct vec center = {0.0f, 0.0f};
    float area = 0.0f;
    float inertia = 0.0f;
    for (int i = 0; i < shape->count; ++i) {
        const struct vec e1 = vec_sub(shape->vertex[i], mean);
        const struct vec e2 = vec_sub(shape->vertex[i + 1 < shape->count ? i + 1 : 0], mean);
        const float cross = vec_cross(e1, e2);
        const float triangle = 0.5f * cross;
        area += triangle;
        center = vec_add(center, vec_scale(triangle * third, vec_add(e1, e2)));
        const float xx = e1.x * e1.x + e2.x * e1.x + e2.x * e2.x;
        const float yy = e1.y * e1.y + e2.y * e1.y + e2.y * e2.y;
        inertia += (0.25f * third * cross) * (xx + yy);
    }
    const float mass = density * area;
    center = vec_scale(1.0f / area, center);
    const struct vec absolute = vec_add(center, mean);
    inertia = density * inertia;
    inertia += mass * (vec_dot(absolute, absolute) - vec_dot(center, center));
    body->inverse_mass = 1.0f / mass;
    body->center = vec_scale(body->inverse_mass, vec_scale(mass, absolute));
    inertia -= mass * vec_dot(body->center, body->center);
    body->inverse_inertia = 1.0f / inertia;
}

static void make_box(struct polygon *shape, double half_width, double half_height)
{
    const float x = (float)half_width;
    const float y = (float)half_height;
    shape->count = 4;
    shape->vertex[0] = vec_make(-x, -y);
    shape->vertex[1] = vec_make(x, -y);
    shape->vertex[2] = vec_make(x, y);
    shape->vertex[3] = vec_make(-x, y);
    shape->normal[0] = vec_make(0.0f, -1.0f);
    shape->normal[1] = vec_make(1.0f, 0.0f);
    shape->normal[2] = vec_make(0.0f, 1.0f);
    shape->normal[3] = vec_make(-1.0f, 0.0f);
    shape->centroid = vec_make(0.0f, 0.0f);
}

static void model_joint(int index, int a, int b, double anchor_a, double anchor_b, float lower, float upper,
                        float speed)
{
    struct joint_model *joint = &walker_model.joint[index];
    const struct body_model *body_a = &walker_model.body[a];
    const struct body_model *body_b = &walker_model.body[b];
    joint->a = a;
    joint->b = b;
    joint->anchor_a = vec_sub(vec_make(0.0f, (float)anchor_a), body_a->center);
    joint->anchor_b = vec_sub(vec_make(0.0f, (float)anchor_b), body_b->center);
    joint->reference = (float)((double)body_b->start_angle - (double)body_a->start_angle);
    joint->lower = lower;
    joint->upper = upper;
    joint->speed = speed;
}

void walker_model_build(void)
{
    static const double hull[5][2] = {{-30, 9}, {6, 9}, {34, 1}, {34, -8}, {-30, -8}};
    const double leg_down = -8 / SCALE;
    const double leg_width = 8 / SCALE;
    const double leg_height = 34 / SCALE;
    const double terrain_step = 14 / SCALE;
    const double x = terrain_step * 20 / 2;
    const double y = 400 / SCALE / 4 + 2 * leg_height;
    struct model *model = &walker_model;

    struct vec points[5];
    for (int i = 0; i < 5; ++i) {
        points[i] = vec_make((float)(hull[i][0] / SCALE), (float)(hull[i][1] / SCALE));
    }
    polygon_set(&model->body[HULL].shape, points, 5);
    weigh(&model->body[HULL], 5.0f);
    model->body[HULL].friction = mix_friction(2.5f, 0.1f);
    model->body[HULL].start = vec_make((float)x, (float)y);
    model->body[HULL].start_angle = 0.0f;
    for (int side = -1; side <= 1; side += 2) {
        struct body_model *upper = &model->body[side < 0 ? UPPER_1 : UPPER_2];
        struct body_model *lower = &model->body[side < 0 ? LOWER_1 : LOWER_2];
        make_box(&upper->shape, leg_width / 2, leg_height / 2);
        make_box(&lower->shape, 0.8 * leg_width / 2, leg_height / 2);
        upper->start = vec_make((float)x, (float)(y - leg_height / 2 - leg_down));
        lower->start = vec_make((float)x, (float)(y - leg_height * 3 / 2 - leg_down));
        upper->start_angle = lower->start_angle = (float)(side * 0.05);
        upper->friction = lower->friction = mix_friction(2.5f, 0.2f);
        weigh(upper, 1.0f);
        weigh(lower, 1.0f);
    }
    model_joint(HIP_1, HULL, UPPER_1, leg_down, leg_height / 2, -0.8f, 1.1f, 4.0f);
    model_joint(KNEE_1, UPPER_1, LOWER_1, -leg_height / 2, leg_height / 2, -1.6f, -0.1f, 6.0f);
    model_joint(HIP_2, HULL, UPPER_2, leg_down, leg_height / 2, -0.8f, 1.1f, 4.0f);
    model_joint(KNEE_2, UPPER_2, LOWER_2, -leg_height / 2, leg_height / 2, -1.6f, -0.1f, 6.0f);
    model->time_step = (float)(1.0 / FRAMES_PER_SECOND);
    model->step_ratio = (1.0f / model->time_step) * model->time_step;
    for (int i = 0; i < NUM_RAYS; ++i) {
        /* Volatile, so that libm is asked as Python asks it, and not the compiler. */
        volatile double angle = 1.5 * i / 10.0;
        model->ray_across[i] = sin(angle) * (160 / SCALE);
        model->ray_down[i] = cos(angle) * (160 / SCALE);
    }
    model->goal = (TERRAIN_LENGTH - 10) * terrain_step;
    model->effort = (float)(0.00035 * 80);
}

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
