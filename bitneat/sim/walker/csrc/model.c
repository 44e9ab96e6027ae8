/* SPDX-License-Identifier: MIT
 *
 * What is the same for every walker: Gymnasium's constants, and what Box2D makes of them.
 */
#include "walker.h"

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
