/* SPDX-License-Identifier: MIT
 *
 * The solver, for LANES walkers at a time: velocities of joints and contacts (180 sweeps), new positions, and their correction.
 *
 * The file is compiled once for every width. Each lane computes what Box2D computes for its walker, operation by operation:
 * sequential impulses with warm starting, the two-point block solver, and nonlinear Gauss-Seidel for positions. Freedom is taken
 * only where it cannot change a bit: matrices that do not change are inverted once, products with the ground's inverse mass
 * (zero) are left out, and constraints that share no moving body change places.
 */
#include "lanes.h"
#include "trig.h"
#include "walker.h"

#include <stddef.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

#define MAX_TRANSLATION 2.0f
#define MAX_ROTATION (0.5f * PI_F)
#define MAX_LINEAR_CORRECTION 0.2f
#define MAX_ANGULAR_CORRECTION (8.0f / 180.0f * PI_F)
#define MAX_CONDITION_NUMBER 1000.0f

enum { MAX_SLOTS = NUM_BODIES * MAX_CONTACTS };

/* Bodies of LANES walkers. */
struct motion {
    vf x, y, a;
};

struct velocity {
    vf x, y, w;
};

struct rotation {
    vf s, c;
};

/* A joint, ready for the velocity sweeps. */
struct joint_lanes {
    vf rax, ray, rbx, rby;
    vf k11, k12, k22; /* of the point constraint */
    vf inverse2;      /* 1 / determinant of the above */
    vf k13, k23;      /* and the angle's row */
    vf minor1, minor2, minor3, inverse3;
    vf speed, max_impulse;
    vf ix, iy, iz, motor; /* accumulated impulses */
    vf limit;
    vm limited, at_lower;
    bool any_limited;
};

/* The n-th touching contact of a body in every lane; a lane without one has zeros, which push nothing. */
struct slot {
    int32_t body;
    bool any_two;
    unsigned active, two, face_b; /* lanes: as bits */
    vf nx, ny;                    /* the normal, away from the ground */
    vf rx[2], ry[2];
    vf normal_mass[2], tangent_mass[2];
    vf normal_impulse[2], tangent_impulse[2];
    vf k11, k12, k22, inverse11, inverse12, inverse22;
    vm block; /* both points are solved together */
    /* The manifold, for the positions. */
    vf local_nx, local_ny, plane_x, plane_y, point_x[2], point_y[2];
    struct contact *contact[LANES];
};

struct batch {
    struct velocity v[NUM_BODIES];
    struct motion c[NUM_BODIES];
    struct rotation q[NUM_BODIES];
    struct joint_lanes joint[NUM_JOINTS];
    int32_t first_slot[NUM_BODIES + 1]; /* of each body; the last is the number of slots */
    struct slot *slot;
};

static void rotation_of(struct rotation *q, vf angle)
{
    lanes_sincos((const float *)&angle, (float *)&q->s, (float *)&q->c);
}

/* The n-th contacts of the bodies are gathered lane by lane. */
static void gather(struct batch *b, struct walker *const *walkers, int count)
{
    for (int lane = 0; lane < LANES; ++lane) {
        /* Lanes that have no walker repeat the first one; nothing of them is stored. */
        const struct walker *w = walkers[lane < count ? lane : 0];
        for (int i = 0; i < NUM_BODIES; ++i) {
            const struct body *body = &w->body[i];
            ((float *)&b->c[i].x)[lane] = body->c.x;
            ((float *)&b->c[i].y)[lane] = body->c.y;
            ((float *)&b->c[i].a)[lane] = body->a;
            ((float *)&b->v[i].x)[lane] = body->v.x;
            ((float *)&b->v[i].y)[lane] = body->v.y;
            ((float *)&b->v[i].w)[lane] = body->w;
            ((float *)&b->q[i].s)[lane] = body->pose.q.s;
            ((float *)&b->q[i].c)[lane] = body->pose.q.c;
        }
        for (int i = 0; i < NUM_JOINTS; ++i) {
            const struct joint *joint = &w->joint[i];
            ((float *)&b->joint[i].ix)[lane] = joint->impulse_x;
            ((float *)&b->joint[i].iy)[lane] = joint->impulse_y;
            ((float *)&b->joint[i].iz)[lane] = joint->impulse_z;
            ((float *)&b->joint[i].motor)[lane] = joint->motor_impulse;
            ((float *)&b->joint[i].limit)[lane] = joint->limit;
            ((float *)&b->joint[i].speed)[lane] = joint->speed;
            ((float *)&b->joint[i].max_impulse)[lane] = walker_model.time_step * joint->max_torque;
        }
    }
}

static void clear_slot(struct slot *slot, int body)
{
    const vf zero = lanes_set(0.0f);
    slot->body = body;
    slot->active = slot->two = slot->face_b = 0;
    slot->local_nx = slot->local_ny = slot->plane_x = slot->plane_y = zero;
    for (int point = 0; point < 2; ++point) {
        slot->point_x[point] = slot->point_y[point] = zero;
        slot->normal_impulse[point] = slot->tangent_impulse[point] = zero;
    }
}

static void fill_slot(struct slot *slot, int lane, struct contact *contact)
{
    const struct manifold *m = &contact->manifold;
    slot->contact[lane] = contact;
    slot->active |= 1U << lane;
    slot->two |= (m->count == 2 ? 1U : 0U) << lane;
    slot->face_b |= (m->kind == FACE_B ? 1U : 0U) << lane;
    ((float *)&slot->local_nx)[lane] = m->local_normal.x;
    ((float *)&slot->local_ny)[lane] = m->local_normal.y;
    ((float *)&slot->plane_x)[lane] = m->local_point.x;
    ((float *)&slot->plane_y)[lane] = m->local_point.y;
    for (int point = 0; point < m->count; ++point) {
        ((float *)&slot->point_x[point])[lane] = m->point[point].local.x;
        ((float *)&slot->point_y[point])[lane] = m->point[point].local.y;
        ((float *)&slot->normal_impulse[point])[lane] = walker_model.step_ratio * m->point[point].normal_impulse;
        ((float *)&slot->tangent_impulse[point])[lane] = walker_model.step_ratio * m->point[point].tangent_impulse;
    }
}

static void gather_contacts(struct batch *b, struct walker *const *walkers, int count)
{
    int32_t num_slots = 0;
    for (int i = 0; i < NUM_BODIES; ++i) {
        const int32_t first = num_slots;
        b->first_slot[i] = first;
        for (int lane = 0; lane < count; ++lane) {
            struct body *body = &walkers[lane]->body[i];
            int32_t at = first;
            for (int32_t k = body->num_contacts; k-- > 0;) {
                if (!body->contact[k].touching || !body->contact[k].enabled) {
                    continue;
                }
                if (at == num_slots) {
                    clear_slot(&b->slot[num_slots++], i);
                }
                fill_slot(&b->slot[at++], lane, &body->contact[k]);
            }
        }
    }
    b->first_slot[NUM_BODIES] = num_slots;
}

/* The world's view of each contact, and the inverse masses seen by its normal and tangent. */
static void prepare_slot(struct batch *b, struct slot *slot)
{
    const struct body_model *model = &walker_model.body[slot->body];
    const struct rotation *q = &b->q[slot->body];
    const struct motion *c = &b->c[slot->body];
    const vf zero = lanes_set(0.0f);
    const vf one = lanes_set(1.0f);
    const vf radius = lanes_set(POLYGON_RADIUS);
    const vf half = lanes_set(0.5f);
    const vf mass = lanes_set(model->inverse_mass);
    const vf inertia = lanes_set(model->inverse_inertia);
    const vf center_x = lanes_set(model->center.x);
    const vf center_y = lanes_set(model->center.y);
    const vf px = c->x - (q->c * center_x - q->s * center_y);
    const vf py = c->y - (q->s * center_x + q->c * center_y);
    const vm face_b = lanes_from_bits(slot->face_b);
    const vm active = lanes_from_bits(slot->active);
    const vm two = lanes_from_bits(slot->two);

    const vf turned_nx = q->c * slot->local_nx - q->s * slot->local_ny;
    const vf turned_ny = q->s * slot->local_nx + q->c * slot->local_ny;
    const vf face_nx = lanes_select(face_b, turned_nx, slot->local_nx);
    const vf face_ny = lanes_select(face_b, turned_ny, slot->local_ny);
    const vf plane_x = lanes_select(face_b, (q->c * slot->plane_x - q->s * slot->plane_y) + px, slot->plane_x);
    const vf plane_y = lanes_select(face_b, (q->s * slot->plane_x + q->c * slot->plane_y) + py, slot->plane_y);
    slot->nx = lanes_select(face_b, -face_nx, face_nx);
    slot->ny = lanes_select(face_b, -face_ny, face_ny);

    vf rn[2];
    for (int i = 0; i < 2; ++i) {
        const vf clip_x =
            lanes_select(face_b, slot->point_x[i], (q->c * slot->point_x[i] - q->s * slot->point_y[i]) + px);
        const vf clip_y =
            lanes_select(face_b, slot->point_y[i], (q->s * slot->point_x[i] + q->c * slot->point_y[i]) + py);
        const vf depth = radius - ((clip_x - plane_x) * face_nx + (clip_y - plane_y) * face_ny);
        /* Half-way between the two skins. The sum is the same whichever shape owns the face. */
        const vf x = half * ((clip_x + depth * face_nx) + (clip_x - radius * face_nx));
        const vf y = half * ((clip_y + depth * face_ny) + (clip_y - radius * face_ny));
        const vm present = i == 0 ? active : two;
        slot->rx[i] = lanes_select(present, x - c->x, zero);
        slot->ry[i] = lanes_select(present, y - c->y, zero);
        rn[i] = slot->rx[i] * slot->ny - slot->ry[i] * slot->nx;
        const vf rt = slot->rx[i] * -slot->nx - slot->ry[i] * slot->ny;
        slot->normal_mass[i] = lanes_select(present, one / (mass + inertia * rn[i] * rn[i]), zero);
        slot->tangent_mass[i] = lanes_select(present, one / (mass + inertia * rt * rt), zero);
    }

    slot->k11 = mass + inertia * rn[0] * rn[0];
    slot->k22 = mass + inertia * rn[1] * rn[1];
    slot->k12 = mass + inertia * rn[0] * rn[1];
    const vf determinant = slot->k11 * slot->k22 - slot->k12 * slot->k12;
    const vm invertible = lanes_lt(slot->k11 * slot->k11, lanes_set(MAX_CONDITION_NUMBER) * determinant);
    slot->block = lanes_and(two, invertible);
    const unsigned block = lanes_bits(slot->block);
    slot->any_two = block != 0;
    const vf inverse = one / determinant;
    slot->inverse11 = inverse * slot->k22;
    slot->inverse12 = -inverse * slot->k12;
    slot->inverse22 = inverse * slot->k11;
    if (block != slot->two) {
        /* The points are too close to one another: one stands for both. */
        const vm dropped = lanes_and_not(two, slot->block);
        slot->rx[1] = lanes_select(dropped, zero, slot->rx[1]);
        slot->ry[1] = lanes_select(dropped, zero, slot->ry[1]);
        slot->normal_mass[1] = lanes_select(dropped, zero, slot->normal_mass[1]);
        slot->tangent_mass[1] = lanes_select(dropped, zero, slot->tangent_mass[1]);
        slot->normal_impulse[1] = lanes_select(dropped, zero, slot->normal_impulse[1]);
        slot->tangent_impulse[1] = lanes_select(dropped, zero, slot->tangent_impulse[1]);
    }
}

static void warm_start_slot(struct batch *b, const struct slot *slot)
{
    const vf mass = lanes_set(walker_model.body[slot->body].inverse_mass);
    const vf inertia = lanes_set(walker_model.body[slot->body].inverse_inertia);
    struct velocity *v = &b->v[slot->body];
    for (int i = 0; i < 2; ++i) {
        const vf x = slot->normal_impulse[i] * slot->nx + slot->tangent_impulse[i] * slot->ny;
        const vf y = slot->normal_impulse[i] * slot->ny + slot->tangent_impulse[i] * -slot->nx;
        v->w += inertia * (slot->rx[i] * y - slot->ry[i] * x);
        v->x += mass * x;
        v->y += mass * y;
    }
}

static void prepare_joint(struct batch *b, int index)
{
    const struct joint_model *model = &walker_model.joint[index];
    const struct body_model *body_a = &walker_model.body[model->a];
    const struct body_model *body_b = &walker_model.body[model->b];
    const struct rotation *qa = &b->q[model->a];
    const struct rotation *qb = &b->q[model->b];
    struct velocity *va = &b->v[model->a];
    struct velocity *vb = &b->v[model->b];
    struct joint_lanes *j = &b->joint[index];
    const vf zero = lanes_set(0.0f);
    const vf one = lanes_set(1.0f);
    const vf ma = lanes_set(body_a->inverse_mass);
    const vf mb = lanes_set(body_b->inverse_mass);
    const vf ia = lanes_set(body_a->inverse_inertia);
    const vf ib = lanes_set(body_b->inverse_inertia);

    j->rax = qa->c * lanes_set(model->anchor_a.x) - qa->s * lanes_set(model->anchor_a.y);
    j->ray = qa->s * lanes_set(model->anchor_a.x) + qa->c * lanes_set(model->anchor_a.y);
    j->rbx = qb->c * lanes_set(model->anchor_b.x) - qb->s * lanes_set(model->anchor_b.y);
    j->rby = qb->s * lanes_set(model->anchor_b.x) + qb->c * lanes_set(model->anchor_b.y);
    j->k11 = ma + mb + j->ray * j->ray * ia + j->rby * j->rby * ib;
    j->k12 = -j->ray * j->rax * ia - j->rby * j->rbx * ib;
    j->k13 = -j->ray * ia - j->rby * ib;
    j->k22 = ma + mb + j->rax * j->rax * ia + j->rbx * j->rbx * ib;
    j->k23 = j->rax * ia + j->rbx * ib;
    const vf k33 = ia + ib;
    j->inverse2 = one / (j->k11 * j->k22 - j->k12 * j->k12);
    j->minor1 = j->k22 * k33 - j->k23 * j->k23;
    j->minor2 = j->k23 * j->k13 - j->k12 * k33;
    j->minor3 = j->k12 * j->k23 - j->k22 * j->k13;
    j->inverse3 = one / (j->k11 * j->minor1 + j->k12 * j->minor2 + j->k13 * j->minor3);

    const vf angle = b->c[model->b].a - b->c[model->a].a - lanes_set(model->reference);
    j->at_lower = lanes_le(angle, lanes_set(model->lower));
    const vm at_upper = lanes_and_not(lanes_le(lanes_set(model->upper), angle), j->at_lower);
    j->limited = lanes_or(j->at_lower, at_upper);
    j->any_limited = lanes_any(j->limited);
    const vf limit = lanes_select(j->at_lower, lanes_set(-1.0f), lanes_select(at_upper, one, zero));
    /* The limit's impulse is kept only while the joint stays at the same limit. */
    const vf change = limit - j->limit;
    const vm kept = lanes_and(j->limited, lanes_le(change * change, zero));
    j->iz = lanes_select(kept, j->iz, zero);
    j->limit = limit;

    const vf ratio = lanes_set(walker_model.step_ratio);
    j->ix *= ratio;
    j->iy *= ratio;
    j->iz *= ratio;
    j->motor *= ratio;
    va->x -= ma * j->ix;
    va->y -= ma * j->iy;
    va->w -= ia * ((j->rax * j->iy - j->ray * j->ix) + j->motor + j->iz);
    vb->x += mb * j->ix;
    vb->y += mb * j->iy;
    vb->w += ib * ((j->rbx * j->iy - j->rby * j->ix) + j->motor + j->iz);
}

/* One sweep of a joint: its motor, then its point together with its limit. */
static inline __attribute__((always_inline)) void solve_joint(struct joint_lanes *j, struct velocity *va,
                                                              struct velocity *vb, float mass_a, float inertia_a,
                                                              float mass_b, float inertia_b, bool any_limited)
{
    const vf zero = lanes_set(0.0f);
    const vf ma = lanes_set(mass_a);
    const vf mb = lanes_set(mass_b);
    const vf ia = lanes_set(inertia_a);
    const vf ib = lanes_set(inertia_b);
    const vf k33 = lanes_set(inertia_a + inertia_b);
    const vf motor_mass = lanes_set(1.0f / (inertia_a + inertia_b));
    vf vax = va->x, vay = va->y, wa = va->w;
    vf vbx = vb->x, vby = vb->y, wb = vb->w;

    const vf slip = wb - wa - j->speed;
    const vf motor = lanes_max(-j->max_impulse, lanes_min(j->motor + -motor_mass * slip, j->max_impulse));
    const vf turn = motor - j->motor;
    j->motor = motor;
    wa -= ia * turn;
    wb += ib * turn;

    const vf cx = vbx - wb * j->rby - vax + wa * j->ray;
    const vf cy = vby + wb * j->rbx - vay - wa * j->rax;
    vf ix, iy, iz;
    if (any_limited) {
        const vf cz = wb - wa;
        const vf px = -(j->inverse3 * (cx * j->minor1 + cy * j->minor2 + cz * j->minor3));
        const vf py = -(j->inverse3 * (j->k11 * (cy * k33 - cz * j->k23) + j->k12 * (cz * j->k13 - cx * k33) +
                                       j->k13 * (cx * j->k23 - cy * j->k13)));
        const vf pz = -(j->inverse3 * (j->k11 * (j->k22 * cz - j->k23 * cy) + j->k12 * (j->k23 * cx - j->k12 * cz) +
                                       j->k13 * (j->k12 * cy - j->k22 * cx)));
        const vf total = j->iz + pz;
        /* A limit only pushes away from itself; a lane at no limit has iz = 0 and takes the same way as one that lets go. */
        const vm pulls = lanes_lt(lanes_select(j->at_lower, total, -total), zero);
        const vm held = lanes_and_not(j->limited, pulls);
        const vf bx = j->iz * j->k13 - cx;
        const vf by = j->iz * j->k23 - cy;
        ix = lanes_select(held, px, j->inverse2 * (j->k22 * bx - j->k12 * by));
        iy = lanes_select(held, py, j->inverse2 * (j->k11 * by - j->k12 * bx));
        iz = lanes_select(held, pz, -j->iz);
        j->iz = lanes_select(held, total, zero);
    } else {
        ix = -(j->inverse2 * (j->k22 * cx - j->k12 * cy));
        iy = -(j->inverse2 * (j->k11 * cy - j->k12 * cx));
        iz = zero;
    }
    j->ix += ix;
    j->iy += iy;
    vf turn_a = j->rax * iy - j->ray * ix;
    vf turn_b = j->rbx * iy - j->rby * ix;
    if (any_limited) {
        turn_a += iz;
        turn_b += iz;
    }
    va->x = vax - ma * ix;
    va->y = vay - ma * iy;
    va->w = wa - ia * turn_a;
    vb->x = vbx + mb * ix;
    vb->y = vby + mb * iy;
    vb->w = wb + ib * turn_b;
}

/* One sweep of a contact: friction at each point, then the normal impulses. */
static inline __attribute__((always_inline)) void solve_slot(struct slot *s, struct velocity *v, float inverse_mass,
                                                             float inverse_inertia, float friction_factor, bool any_two)
{
    const vf zero = lanes_set(0.0f);
    const vf mass = lanes_set(inverse_mass);
    const vf inertia = lanes_set(inverse_inertia);
    const vf friction = lanes_set(friction_factor);
    const vf nx = s->nx, ny = s->ny;
    vf vx = v->x, vy = v->y, w = v->w;

    for (int i = 0; i < (any_two ? 2 : 1); ++i) {
        const vf dx = vx - w * s->ry[i];
        const vf dy = vy + w * s->rx[i];
        const vf slide = dx * ny - dy * nx;
        const vf most = friction * s->normal_impulse[i];
        const vf wanted = s->tangent_impulse[i] - s->tangent_mass[i] * slide;
        const vf impulse = lanes_max(-most, lanes_min(wanted, most));
        const vf change = impulse - s->tangent_impulse[i];
        s->tangent_impulse[i] = impulse;
        const vf px = change * ny;
        const vf py = change * -nx;
        vx += mass * px;
        vy += mass * py;
        w += inertia * (s->rx[i] * py - s->ry[i] * px);
    }

    const vf b1 = (vx - w * s->ry[0]) * nx + (vy + w * s->rx[0]) * ny;
    const vf single = lanes_max(s->normal_impulse[0] - s->normal_mass[0] * b1, zero);
    if (!any_two) {
        const vf change = single - s->normal_impulse[0];
        s->normal_impulse[0] = single;
        const vf px = change * nx;
        const vf py = change * ny;
        v->x = vx + mass * px;
        v->y = vy + mass * py;
        v->w = w + inertia * (s->rx[0] * py - s->ry[0] * px);
        return;
    }

    /* The two normal impulses x solve a small complementarity problem, whose four cases are tried in turn. */
    const vf a1 = s->normal_impulse[0];
    const vf a2 = s->normal_impulse[1];
    const vf b2 = (vx - w * s->ry[1]) * nx + (vy + w * s->rx[1]) * ny;
    const vf r1 = b1 - (s->k11 * a1 + s->k12 * a2);
    const vf r2 = b2 - (s->k12 * a1 + s->k22 * a2);
    const vf both1 = -(s->inverse11 * r1 + s->inverse12 * r2);
    const vf both2 = -(s->inverse12 * r1 + s->inverse22 * r2);
    const vf first1 = -s->normal_mass[0] * r1;
    const vf second2 = -s->normal_mass[1] * r2;
    const vm both = lanes_and(lanes_le(zero, both1), lanes_le(zero, both2));
    const vm first = lanes_and(lanes_le(zero, first1), lanes_le(zero, s->k12 * first1 + r2));
    const vm second = lanes_and(lanes_le(zero, second2), lanes_le(zero, s->k12 * second2 + r1));
    const vm none = lanes_and(lanes_le(zero, r1), lanes_le(zero, r2));
    vf x1 = lanes_select(none, zero, a1);
    vf x2 = lanes_select(none, zero, a2);
    x1 = lanes_select(second, zero, x1);
    x2 = lanes_select(second, second2, x2);
    x1 = lanes_select(first, first1, x1);
    x2 = lanes_select(first, zero, x2);
    x1 = lanes_select(both, both1, x1);
    x2 = lanes_select(both, both2, x2);
    x1 = lanes_select(s->block, x1, single);
    x2 = lanes_select(s->block, x2, zero);
    const vf d1 = x1 - a1;
    const vf d2 = x2 - a2;
    s->normal_impulse[0] = x1;
    s->normal_impulse[1] = x2;
    const vf p1x = d1 * nx;
    const vf p1y = d1 * ny;
    const vf p2x = d2 * nx;
    const vf p2y = d2 * ny;
    v->x = vx + mass * (p1x + p2x);
    v->y = vy + mass * (p1y + p2y);
    v->w = w + inertia * ((s->rx[0] * p1y - s->ry[0] * p1x) + (s->rx[1] * p2y - s->ry[1] * p2x));
}

static void sweep_joint(struct batch *b, int index)
{
    const struct joint_model *model = &walker_model.joint[index];
    const struct body_model *body_a = &walker_model.body[model->a];
    const struct body_model *body_b = &walker_model.body[model->b];
    struct joint_lanes *j = &b->joint[index];
    if (j->any_limited) {
        solve_joint(j, &b->v[model->a], &b->v[model->b], body_a->inverse_mass, body_a->inverse_inertia,
                    body_b->inverse_mass, body_b->inverse_inertia, true);
    } else {
        solve_joint(j, &b->v[model->a], &b->v[model->b], body_a->inverse_mass, body_a->inverse_inertia,
                    body_b->inverse_mass, body_b->inverse_inertia, false);
    }
}

static void sweep_slot(struct batch *b, struct slot *slot)
{
    const struct body_model *body = &walker_model.body[slot->body];
    if (slot->any_two) {
        solve_slot(slot, &b->v[slot->body], body->inverse_mass, body->inverse_inertia, body->friction, true);
    } else {
        solve_slot(slot, &b->v[slot->body], body->inverse_mass, body->inverse_inertia, body->friction, false);
    }
}

static void sweep_contacts(struct batch *b, int body)
{
    for (int32_t i = b->first_slot[body]; i < b->first_slot[body + 1]; ++i) {
        sweep_slot(b, &b->slot[i]);
    }
}

/* A sweep goes over the second leg from the foot up, the first from the hip down, and then all contacts. Each constraint waits for
 * the one before, so the processor would mostly wait, too. But the second leg can begin the next sweep while the first ends
 * this one: they share nothing but the hull. Every body still meets its constraints in Box2D's order. */
static void solve_velocities(struct batch *b)
{
    sweep_joint(b, KNEE_2);
    sweep_joint(b, HIP_2);
    for (int iteration = 1;; ++iteration) {
        const bool last = iteration == VELOCITY_ITERATIONS;
        sweep_contacts(b, LOWER_2);
        sweep_contacts(b, UPPER_2);
        sweep_joint(b, HIP_1);
        if (!last) {
            sweep_joint(b, KNEE_2);
        }
        sweep_contacts(b, HULL);
        sweep_joint(b, KNEE_1);
        if (!last) {
            sweep_joint(b, HIP_2);
        }
        sweep_contacts(b, UPPER_1);
        sweep_contacts(b, LOWER_1);
        if (last) {
            return;
        }
    }
}

static void integrate(struct motion *c, struct velocity *v, float time_step)
{
    const vf step = lanes_set(time_step);
    const vf tx = step * v->x;
    const vf ty = step * v->y;
    const vf length2 = tx * tx + ty * ty;
    const vm far = lanes_lt(lanes_set(MAX_TRANSLATION * MAX_TRANSLATION), length2);
    if (lanes_any(far)) {
        const vf ratio = lanes_set(MAX_TRANSLATION) / lanes_sqrt(length2);
        v->x = lanes_select(far, v->x * ratio, v->x);
        v->y = lanes_select(far, v->y * ratio, v->y);
    }
    const vf turn = step * v->w;
    const vm fast = lanes_lt(lanes_set(MAX_ROTATION * MAX_ROTATION), turn * turn);
    if (lanes_any(fast)) {
        const vf ratio = lanes_set(MAX_ROTATION) / lanes_max(turn, -turn);
        v->w = lanes_select(fast, v->w * ratio, v->w);
    }
    c->x += step * v->x;
    c->y += step * v->y;
    c->a += step * v->w;
}

/* How hard positions are corrected, and how deep a contact may stay. */
struct correction {
    float factor, deepest;
};

static const struct correction ordinary = {0.2f, -3.0f * LINEAR_SLOP};

/* Lanes in which a contact is too deep still. */
static vm correct_slot(struct batch *b, const struct slot *slot, struct correction how)
{
    const struct body_model *model = &walker_model.body[slot->body];
    struct motion *c = &b->c[slot->body];
    const vf zero = lanes_set(0.0f);
    const vf radius = lanes_set(POLYGON_RADIUS);
    const vf mass = lanes_set(model->inverse_mass);
    const vf inertia = lanes_set(model->inverse_inertia);
    const vf center_x = lanes_set(model->center.x);
    const vf center_y = lanes_set(model->center.y);
    const vm face_b = lanes_from_bits(slot->face_b);
    vf deepest = zero;
    for (int i = 0; i < (slot->two != 0 ? 2 : 1); ++i) {
        const vm present = lanes_from_bits(i == 0 ? slot->active : slot->two);
        struct rotation q;
        rotation_of(&q, c->a);
        const vf px = c->x - (q.c * center_x - q.s * center_y);
        const vf py = c->y - (q.s * center_x + q.c * center_y);
        vf nx = slot->local_nx;
        vf ny = slot->local_ny;
        vf plane_x = slot->plane_x;
        vf plane_y = slot->plane_y;
        vf x = (q.c * slot->point_x[i] - q.s * slot->point_y[i]) + px;
        vf y = (q.s * slot->point_x[i] + q.c * slot->point_y[i]) + py;
        if (slot->face_b != 0) {
            nx = lanes_select(face_b, q.c * slot->local_nx - q.s * slot->local_ny, nx);
            ny = lanes_select(face_b, q.s * slot->local_nx + q.c * slot->local_ny, ny);
            plane_x = lanes_select(face_b, (q.c * slot->plane_x - q.s * slot->plane_y) + px, plane_x);
            plane_y = lanes_select(face_b, (q.s * slot->plane_x + q.c * slot->plane_y) + py, plane_y);
            x = lanes_select(face_b, slot->point_x[i], x);
            y = lanes_select(face_b, slot->point_y[i], y);
        }
        const vf separation = ((x - plane_x) * nx + (y - plane_y) * ny) - radius - radius;
        if (slot->face_b != 0) {
            nx = lanes_select(face_b, -nx, nx);
            ny = lanes_select(face_b, -ny, ny);
        }
        const vf rx = x - c->x;
        const vf ry = y - c->y;
        deepest = lanes_select(present, lanes_min(deepest, separation), deepest);
        const vf error = lanes_max(lanes_set(-MAX_LINEAR_CORRECTION),
                                   lanes_min(lanes_set(how.factor) * (separation + lanes_set(LINEAR_SLOP)), zero));
        const vf rn = rx * ny - ry * nx;
        const vf impulse = lanes_select(present, -error / (mass + inertia * rn * rn), zero);
        const vf ix = impulse * nx;
        const vf iy = impulse * ny;
        c->x += mass * ix;
        c->y += mass * iy;
        c->a += inertia * (rx * iy - ry * ix);
    }
    return lanes_lt(deepest, lanes_set(how.deepest));
}

/* Lanes in which a joint is not yet in place. */
static vm correct_joint(struct batch *b, int index)
{
    const struct joint_model *model = &walker_model.joint[index];
    const struct body_model *body_a = &walker_model.body[model->a];
    const struct body_model *body_b = &walker_model.body[model->b];
    const struct joint_lanes *j = &b->joint[index];
    struct motion *ca = &b->c[model->a];
    struct motion *cb = &b->c[model->b];
    const vf zero = lanes_set(0.0f);
    const vf ma = lanes_set(body_a->inverse_mass);
    const vf mb = lanes_set(body_b->inverse_mass);
    const vf ia = lanes_set(body_a->inverse_inertia);
    const vf ib = lanes_set(body_b->inverse_inertia);
    vf turn_error = zero;
    if (j->any_limited) {
        const vf motor_mass = lanes_set(1.0f / (body_a->inverse_inertia + body_b->inverse_inertia));
        const vf slop = lanes_set(ANGULAR_SLOP);
        const vf most = lanes_set(MAX_ANGULAR_CORRECTION);
        const vf angle = cb->a - ca->a - lanes_set(model->reference);
        const vf below = angle - lanes_set(model->lower);
        const vf above = angle - lanes_set(model->upper);
        const vf correction = lanes_select(j->at_lower, lanes_max(-most, lanes_min(below + slop, zero)),
                                           lanes_max(zero, lanes_min(above - slop, most)));
        turn_error = lanes_select(j->limited, lanes_select(j->at_lower, -below, above), zero);
        const vf impulse = lanes_select(j->limited, -motor_mass * correction, zero);
        ca->a -= ia * impulse;
        cb->a += ib * impulse;
    }
    struct rotation qa, qb;
    rotation_of(&qa, ca->a);
    rotation_of(&qb, cb->a);
    const vf rax = qa.c * lanes_set(model->anchor_a.x) - qa.s * lanes_set(model->anchor_a.y);
    const vf ray = qa.s * lanes_set(model->anchor_a.x) + qa.c * lanes_set(model->anchor_a.y);
    const vf rbx = qb.c * lanes_set(model->anchor_b.x) - qb.s * lanes_set(model->anchor_b.y);
    const vf rby = qb.s * lanes_set(model->anchor_b.x) + qb.c * lanes_set(model->anchor_b.y);
    const vf x = cb->x + rbx - ca->x - rax;
    const vf y = cb->y + rby - ca->y - ray;
    const vf distance = lanes_sqrt(x * x + y * y);
    const vf k11 = ma + mb + ia * ray * ray + ib * rby * rby;
    const vf k12 = -ia * rax * ray - ib * rbx * rby;
    const vf k22 = ma + mb + ia * rax * rax + ib * rbx * rbx;
    const vf inverse = lanes_set(1.0f) / (k11 * k22 - k12 * k12);
    const vf ix = -(inverse * (k22 * x - k12 * y));
    const vf iy = -(inverse * (k11 * y - k12 * x));
    ca->x -= ma * ix;
    ca->y -= ma * iy;
    ca->a -= ia * (rax * iy - ray * ix);
    cb->x += mb * ix;
    cb->y += mb * iy;
    cb->a += ib * (rbx * iy - rby * ix);
    return lanes_or(lanes_lt(lanes_set(LINEAR_SLOP), distance), lanes_lt(lanes_set(ANGULAR_SLOP), turn_error));
}

static vm correct_contacts(struct batch *b, int body, vm bad)
{
    for (int32_t i = b->first_slot[body]; i < b->first_slot[body + 1]; ++i) {
        bad = lanes_or(bad, correct_slot(b, &b->slot[i], ordinary));
    }
    return bad;
}

/* Corrects positions until all errors are small, and tells in which lanes they became so within the iterations allowed. A lane's
 * positions are those of the first iteration after which they are; what it does while others go on is thrown away.
 *
 * The two legs overlap as in solve_velocities, with the contacts first: `bad` is of the iteration that the first leg is in, `next_bad`
 * of the one that the second leg has begun, and `done` keeps what the bodies were at the end of the former. */
static unsigned solve_positions(struct batch *b, unsigned lanes)
{
    struct motion done[NUM_BODIES], result[NUM_BODIES];
    for (int i = 0; i < NUM_BODIES; ++i) {
        result[i] = b->c[i];
    }
    unsigned unsolved = lanes;
    const vm none = lanes_from_bits(0);
    vm bad = correct_contacts(b, LOWER_2, none);
    bad = correct_contacts(b, UPPER_2, bad);
    bad = correct_contacts(b, HULL, bad);
    bad = correct_contacts(b, UPPER_1, bad);
    bad = correct_contacts(b, LOWER_1, bad);
    bad = lanes_or(bad, correct_joint(b, KNEE_2));
    bad = lanes_or(bad, correct_joint(b, HIP_2));
    for (int iteration = 1;; ++iteration) {
        done[UPPER_2] = b->c[UPPER_2];
        done[LOWER_2] = b->c[LOWER_2];
        bad = lanes_or(bad, correct_joint(b, HIP_1));
        vm next_bad = correct_contacts(b, LOWER_2, none);
        next_bad = correct_contacts(b, UPPER_2, next_bad);
        next_bad = lanes_or(next_bad, correct_joint(b, KNEE_2));
        done[HULL] = b->c[HULL];
        next_bad = correct_contacts(b, HULL, next_bad);
        bad = lanes_or(bad, correct_joint(b, KNEE_1));
        next_bad = lanes_or(next_bad, correct_joint(b, HIP_2));
        const bool last = iteration == POSITION_ITERATIONS;
        const unsigned still = unsolved & lanes_bits(bad);
        if (still != unsolved || last) {
            done[UPPER_1] = b->c[UPPER_1];
            done[LOWER_1] = b->c[LOWER_1];
            const vm stopped = lanes_from_bits(last ? unsolved : unsolved & ~still);
            for (int i = 0; i < NUM_BODIES; ++i) {
                result[i].x = lanes_select(stopped, done[i].x, result[i].x);
                result[i].y = lanes_select(stopped, done[i].y, result[i].y);
                result[i].a = lanes_select(stopped, done[i].a, result[i].a);
            }
            unsolved = still;
            if (last || still == 0) {
                break;
            }
        }
        next_bad = correct_contacts(b, UPPER_1, next_bad);
        bad = correct_contacts(b, LOWER_1, next_bad);
    }
    for (int i = 0; i < NUM_BODIES; ++i) {
        b->c[i] = result[i];
    }
    return lanes & ~unsolved;
}

static void store_impulses(struct slot *slot)
{
    const unsigned block = lanes_bits(slot->block);
    for (int lane = 0; lane < LANES; ++lane) {
        if ((slot->active >> lane & 1U) == 0) {
            continue;
        }
        struct manifold *m = &slot->contact[lane]->manifold;
        for (int point = 0; point < ((block >> lane & 1U) != 0 ? 2 : 1); ++point) {
            m->point[point].normal_impulse = ((const float *)&slot->normal_impulse[point])[lane];
            m->point[point].tangent_impulse = ((const float *)&slot->tangent_impulse[point])[lane];
        }
    }
}

static void scatter(struct batch *b, struct walker *const *walkers, int count, unsigned solved)
{
    struct rotation q[NUM_BODIES];
    struct motion p[NUM_BODIES];
    for (int i = 0; i < NUM_BODIES; ++i) {
        const vf center_x = lanes_set(walker_model.body[i].center.x);
        const vf center_y = lanes_set(walker_model.body[i].center.y);
        rotation_of(&q[i], b->c[i].a);
        p[i].x = b->c[i].x - (q[i].c * center_x - q[i].s * center_y);
        p[i].y = b->c[i].y - (q[i].s * center_x + q[i].c * center_y);
    }
    for (int lane = 0; lane < count; ++lane) {
        struct walker *w = walkers[lane];
        w->positions_solved = (solved >> lane & 1U) != 0;
        for (int i = 0; i < NUM_BODIES; ++i) {
            struct body *body = &w->body[i];
            body->c.x = ((const float *)&b->c[i].x)[lane];
            body->c.y = ((const float *)&b->c[i].y)[lane];
            body->a = ((const float *)&b->c[i].a)[lane];
            body->v.x = ((const float *)&b->v[i].x)[lane];
            body->v.y = ((const float *)&b->v[i].y)[lane];
            body->w = ((const float *)&b->v[i].w)[lane];
            body->pose.q.s = ((const float *)&q[i].s)[lane];
            body->pose.q.c = ((const float *)&q[i].c)[lane];
            body->pose.p.x = ((const float *)&p[i].x)[lane];
            body->pose.p.y = ((const float *)&p[i].y)[lane];
        }
        for (int i = 0; i < NUM_JOINTS; ++i) {
            struct joint *joint = &w->joint[i];
            joint->impulse_x = ((const float *)&b->joint[i].ix)[lane];
            joint->impulse_y = ((const float *)&b->joint[i].iy)[lane];
            joint->impulse_z = ((const float *)&b->joint[i].iz)[lane];
            joint->motor_impulse = ((const float *)&b->joint[i].motor)[lane];
            joint->limit = ((const float *)&b->joint[i].limit)[lane];
        }
    }
}

/* For the slots: too much for the stack of a thread, on some systems. */
size_t JOIN(walker_scratch_, LANES)(void)
{
    return MAX_SLOTS * sizeof(struct slot);
}

void JOIN(walker_solve_, LANES)(struct walker *const *walkers, int count, void *scratch)
{
    struct batch b;
    b.slot = scratch;
    gather(&b, walkers, count);
    gather_contacts(&b, walkers, count);
    for (int32_t i = 0; i < b.first_slot[NUM_BODIES]; ++i) {
        prepare_slot(&b, &b.slot[i]);
        warm_start_slot(&b, &b.slot[i]);
    }
    prepare_joint(&b, KNEE_2);
    prepare_joint(&b, HIP_2);
    prepare_joint(&b, HIP_1);
    prepare_joint(&b, KNEE_1);
    solve_velocities(&b);
    for (int32_t i = 0; i < b.first_slot[NUM_BODIES]; ++i) {
        store_impulses(&b.slot[i]);
    }
    for (int i = 0; i < NUM_BODIES; ++i) {
        integrate(&b.c[i], &b.v[i], walker_model.time_step);
    }
    scatter(&b, walkers, count, solve_positions(&b, count == 16 ? 0xffffU : (1U << count) - 1U));
}

#if LANES == 1

/* After a time of impact there is no warm start, nothing is remembered, and no other body takes part. */
void walker_substep(struct body *body, int index, struct contact *const *contacts, int count, float time_step)
{
    static const struct correction firm = {0.75f, -1.5f * LINEAR_SLOP};
    struct slot slots[MAX_ISLAND_CONTACTS];
    struct batch b;
    b.slot = slots;
    b.c[index].x = body->sweep.c.x;
    b.c[index].y = body->sweep.c.y;
    b.c[index].a = body->sweep.a;
    b.v[index].x = body->v.x;
    b.v[index].y = body->v.y;
    b.v[index].w = body->w;
    for (int i = 0; i < count; ++i) {
        clear_slot(&b.slot[i], index);
        fill_slot(&b.slot[i], 0, contacts[i]);
        for (int point = 0; point < 2; ++point) {
            b.slot[i].normal_impulse[point] = b.slot[i].tangent_impulse[point] = 0.0f;
        }
    }
    bool deep = true;
    for (int iteration = 0; iteration < SUBSTEP_POSITION_ITERATIONS && deep; ++iteration) {
        deep = false;
        for (int i = 0; i < count; ++i) {
            deep |= correct_slot(&b, &b.slot[i], firm);
        }
    }
    body->sweep.c0 = vec_make(b.c[index].x, b.c[index].y);
    body->sweep.a0 = b.c[index].a;
    rotation_of(&b.q[index], b.c[index].a);
    for (int i = 0; i < count; ++i) {
        prepare_slot(&b, &b.slot[i]);
    }
    for (int iteration = 0; iteration < VELOCITY_ITERATIONS; ++iteration) {
        for (int i = 0; i < count; ++i) {
            sweep_slot(&b, &b.slot[i]);
        }
    }
    integrate(&b.c[index], &b.v[index], time_step);
    body->sweep.c = vec_make(b.c[index].x, b.c[index].y);
    body->sweep.a = b.c[index].a;
    body->v = vec_make(b.v[index].x, b.v[index].y);
    body->w = b.v[index].w;
}

#endif
