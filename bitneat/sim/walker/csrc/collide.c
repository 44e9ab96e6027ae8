/* SPDX-License-Identifier: MIT
 *
 * Where a polygon of the walker touches the terrain: the faces that separate the two least, and the other shape's face clipped
 * to the better of them.
 *
 * Most pairs do not touch. So the faces are tried from the cheapest on, four vertices at a time, and nothing that only a contact
 * needs is computed before all of them have failed to keep the two apart.
 */
#include "collide.h"

#define SKIN (2.0f * POLYGON_RADIUS) /* that of the two shapes together */
#define RELATIVE_TOLERANCE 0.98f /* B's face is preferred to A's only if clearly better: no flicker from step to step */
#define ABSOLUTE_TOLERANCE 0.001f

/* Every polygon has four vertices, the hull one more: four go into a vector and the last is dealt with by itself. */
enum { LANES = 4 };
_Static_assert(MAX_VERTICES == LANES + 1, "at most one vertex is left over");
typedef float lanes __attribute__((vector_size(LANES * sizeof(float))));

struct lane_vec {
    lanes x, y;
};

static inline struct lane_vec load(const struct vec *v)
{
    struct lane_vec r = {{v[0].x, v[1].x, v[2].x, v[3].x}, {v[0].y, v[1].y, v[2].y, v[3].y}};
    return r;
}

static inline lanes lanes_dot(struct lane_vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y;
}

static inline struct lane_vec lanes_sub(struct lane_vec a, struct vec b)
{
    struct lane_vec r = {a.x - b.x, a.y - b.y};
    return r;
}

static inline struct lane_vec lanes_rotate(struct rot q, struct lane_vec v)
{
    struct lane_vec r = {q.c * v.x - q.s * v.y, q.s * v.x + q.c * v.y};
    return r;
}

static inline float lowest(lanes v)
{
    return min_f(min_f(v[0], v[1]), min_f(v[2], v[3]));
}

static inline float highest(lanes v)
{
    return max_f(max_f(v[0], v[1]), max_f(v[2], v[3]));
}

static inline int32_t next_of(const struct polygon *p, int32_t i)
{
    return i + 1 < p->count ? i + 1 : 0;
}

static inline int32_t previous_of(const struct polygon *p, int32_t i)
{
    return i > 0 ? i - 1 : p->count - 1;
}

/* The first of the vectors v[0] to v[count - 1] that reaches least far along n. */
static inline int32_t least_along(const struct vec *v, int32_t count, struct vec n)
{
    lanes reach = lanes_dot(load(v), n);
    int32_t i = 0;
    float least = reach[0];
    for (int32_t k = 1; k < LANES; k++) {
        i = reach[k] < least ? k : i;
        least = min_f(reach[k], least);
    }
    return count > LANES && vec_dot(v[LANES], n) < least ? LANES : i;
}

/* A point of the clipped face. Its id holds, a byte each, the index of A's feature and of B's and then the kinds of the two. */
struct clip_point {
    struct vec v;
    uint32_t id;
};

enum feature { VERTEX, FACE };

static inline uint32_t feature_id(int32_t index_a, int32_t index_b, enum feature kind_a, enum feature kind_b)
{
    return (uint32_t)index_a | (uint32_t)index_b << 8 | (uint32_t)kind_a << 16 | (uint32_t)kind_b << 24;
}

static inline uint32_t swap_features(uint32_t id)
{
    return (id & 0x00ff00ffu) << 8 | (id >> 8 & 0x00ff00ffu);
}

/* Cut the segment p down to where normal * x <= offset. False if less than two points remain; p is then undefined. The points
 * change places when the first is cut off, and their order is the manifold's. Whether the ends lie on different sides is asked
 * of the product, which underflows to zero where the signs alone would tell. */
static inline bool clip(struct clip_point p[2], struct vec normal, float offset, int32_t index)
{
    float d0 = vec_dot(normal, p[0].v) - offset;
    float d1 = vec_dot(normal, p[1].v) - offset;
    if (d0 <= 0.0f && d1 <= 0.0f) {
        return true;
    }
    if (!(d0 * d1 < 0.0f)) {
        return false;
    }
    float t = d0 / (d0 - d1);
    struct clip_point cut = {
        vec_add(p[0].v, vec_scale(t, vec_sub(p[1].v, p[0].v))),
        feature_id(index, (int32_t)(p[0].id >> 8 & 0xffu), VERTEX, FACE),
    };
    if (d0 > 0.0f) {
        p[0] = p[1];
    }
    p[1] = cut;
    return true;
}

/* Clipping names the owner of the reference face first, which is the wrong way round for a face of B. */
static inline void add_point(struct manifold *m, const struct clip_point *p, const struct pose *pose)
{
    struct manifold_point *out = &m->point[m->count++];
    if (m->kind == FACE_A) {
        out->local = pose_apply_inverse(pose, p->v);
        out->id = p->id;
    } else {
        out->local = p->v;
        out->id = swap_features(p->id);
    }
}

/* The edge has a front and a back: the side where the polygon's centroid lies counts. A neighbourless edge restricts the
 * polygon's normals in no way, as n + m, for unit vectors n and m, never points against m by more than rounding. */
void collide_edge(struct manifold *m, const struct edge *a, const struct polygon *b, const struct pose *pose)
{
    m->count = 0;
    bool five = b->count > LANES;

    struct lane_vec vertex = lanes_rotate(pose->q, load(b->vertex));
    vertex.x += pose->p.x;
    vertex.y += pose->p.y;
    struct lane_vec from_a = lanes_sub(vertex, a->a);
    lanes height = lanes_dot(from_a, a->normal);
    float low = lowest(height);
    float high = highest(height);
    struct vec fifth = {0.0f, 0.0f};
    if (five) {
        fifth = pose_apply(pose, b->vertex[LANES]);
        float h = vec_dot(a->normal, vec_sub(fifth, a->a));
        low = min_f(low, h);
        high = max_f(high, h);
    }
    /* A polygon beyond the skin is so with its centroid: no need to know yet on which side that lies. */
    if (low > SKIN || high < -SKIN) {
        return;
    }

    /* How far the edge's nearer end lies behind each face. Negating a factor negates the products and their sum, to the bit. */
    struct lane_vec normal = lanes_rotate(pose->q, load(b->normal));
    struct lane_vec from_b = lanes_sub(vertex, a->b);
    lanes depth_a = normal.x * from_a.x + normal.y * from_a.y;
    lanes depth_b = normal.x * from_b.x + normal.y * from_b.y;
    lanes depth;
    for (int32_t k = 0; k < LANES; k++) {
        depth[k] = max_f(depth_a[k], depth_b[k]);
    }
    float shallowest = lowest(depth);
    struct vec fifth_normal = {0.0f, 0.0f};
    if (five) {
        fifth_normal = rot_apply(pose->q, b->normal[LANES]);
        float d = max_f(vec_dot(fifth_normal, vec_sub(fifth, a->a)), vec_dot(fifth_normal, vec_sub(fifth, a->b)));
        shallowest = min_f(d, shallowest);
    }
    if (shallowest < -SKIN) {
        return;
    }
    float polygon_separation = -shallowest;
    int32_t face = 0;
    while (face < LANES && depth[face] != shallowest) {
        face++;
    }

    struct vec world[MAX_VERTICES], world_normal[MAX_VERTICES];
    for (int32_t k = 0; k < LANES; k++) {
        world[k] = vec_make(vertex.x[k], vertex.y[k]);
        world_normal[k] = vec_make(normal.x[k], normal.y[k]);
    }
    world[LANES] = fifth;
    world_normal[LANES] = fifth_normal;

    bool front = vec_dot(a->normal, vec_sub(pose_apply(pose, b->centroid), a->a)) >= 0.0f;
    float edge_separation = front ? low : -high;
    struct clip_point p[2];
    int32_t i1, i2; /* the ends of the reference face */
    struct vec v1, v2, n;
    if (polygon_separation > RELATIVE_TOLERANCE * edge_separation + ABSOLUTE_TOLERANCE) {
        m->kind = FACE_B;
        i1 = face;
        i2 = next_of(b, face);
        v1 = world[i1];
        v2 = world[i2];
        n = world_normal[face];
        p[0].v = a->a;
        p[1].v = a->b;
        p[0].id = p[1].id = feature_id(0, face, VERTEX, FACE);
        m->local_normal = b->normal[face];
        m->local_point = b->vertex[face];
    } else {
        m->kind = FACE_A;
        i1 = front ? 0 : 1;
        i2 = 1 - i1;
        v1 = front ? a->a : a->b;
        v2 = front ? a->b : a->a;
        n = front ? a->normal : vec_negate(a->normal);
        int32_t k1 = least_along(world_normal, b->count, n);
        int32_t k2 = next_of(b, k1);
        p[0].v = world[k1];
        p[0].id = feature_id(0, k1, FACE, VERTEX);
        p[1].v = world[k2];
        p[1].id = feature_id(0, k2, FACE, VERTEX);
        m->local_normal = n;
        m->local_point = v1;
    }

    struct vec side = vec_make(n.y, -n.x);
    struct vec other_side = vec_negate(side);
    if (!clip(p, side, vec_dot(side, v1), i1) || !clip(p, other_side, vec_dot(other_side, v2), i2)) {
        return;
    }
    for (int k = 0; k < 2; k++) {
        if (vec_dot(n, vec_sub(p[k].v, v1)) <= SKIN) {
            add_point(m, &p[k], pose);
        }
    }
}

/* How far the nearest vertex of the other polygon lies before face i of one: of B if `of_b`, else of A. Nearest is judged in the
 * other's frame, the distance measured in the world. */
static inline float face_separation(bool of_b, const struct polygon *a, const struct polygon *b,
                                    const struct pose *pose, int32_t i)
{
    if (of_b) {
        struct vec n = rot_apply(pose->q, b->normal[i]);
        struct vec nearest = a->vertex[least_along(a->vertex, a->count, n)];
        return vec_dot(vec_sub(nearest, pose_apply(pose, b->vertex[i])), n);
    }
    struct vec n = a->normal[i];
    struct vec nearest = b->vertex[least_along(b->vertex, b->count, rot_apply_inverse(pose->q, n))];
    return vec_dot(vec_sub(pose_apply(pose, nearest), a->vertex[i]), n);
}

/* The separation of a polygon's face that separates most, and its index: climbing from the face that looks most along d, towards
 * the other centroid (in the polygon's own frame). The summit may be a local one, and ties depend on the way, so
 * nothing but this climb would do. Above the skin it is left early: more height changes nothing then. */
static inline float climb(bool of_b, const struct polygon *a, const struct polygon *b, const struct pose *pose,
                          struct vec d, int32_t *face)
{
    const struct polygon *own = of_b ? b : a;
    int32_t i = least_along(own->normal, own->count, vec_negate(d));
    float s = face_separation(of_b, a, b, pose, i);
    *face = i;
    if (s > SKIN) {
        return s;
    }
    int32_t left = previous_of(own, i);
    float s_left = face_separation(of_b, a, b, pose, left);
    int32_t right = next_of(own, i);
    float s_right = face_separation(of_b, a, b, pose, right);
    bool leftward = s_left > s && s_left > s_right;
    if (!leftward && !(s_right > s)) {
        return s;
    }
    i = leftward ? left : right;
    s = leftward ? s_left : s_right;
    for (;;) {
        *face = i;
        if (s > SKIN) {
            return s;
        }
        i = leftward ? previous_of(own, i) : next_of(own, i);
        float further = face_separation(of_b, a, b, pose, i);
        if (!(further > s)) {
            return s;
        }
        s = further;
    }
}

void collide_polygon(struct manifold *m, const struct polygon *a, const struct polygon *b, const struct pose *pose)
{
    m->count = 0;
    struct vec d = vec_sub(pose_apply(pose, b->centroid), a->centroid);
    int32_t face_a, face_b;
    float separation_a = climb(false, a, b, pose, d, &face_a);
    if (separation_a > SKIN) {
        return;
    }
    float separation_b = climb(true, a, b, pose, rot_apply_inverse(pose->q, vec_negate(d)), &face_b);
    if (separation_b > SKIN) {
        return;
    }

    const struct polygon *owner, *other;
    int32_t i1;
    if (separation_b > RELATIVE_TOLERANCE * separation_a + ABSOLUTE_TOLERANCE) {
        m->kind = FACE_B;
        owner = b;
        other = a;
        i1 = face_b;
    } else {
        m->kind = FACE_A;
        owner = a;
        other = b;
        i1 = face_a;
    }

    /* The other's face that looks most against this one. */
    struct vec against =
        m->kind == FACE_B ? rot_apply(pose->q, b->normal[i1]) : rot_apply_inverse(pose->q, a->normal[i1]);
    int32_t k1 = least_along(other->normal, other->count, against);
    int32_t k2 = next_of(other, k1);
    struct clip_point p[2] = {
        {other->vertex[k1], feature_id(i1, k1, FACE, VERTEX)},
        {other->vertex[k2], feature_id(i1, k2, FACE, VERTEX)},
    };

    /* Not the stored normal: the one of the manifold is turned from the tangent, which may round differently. */
    int32_t i2 = next_of(owner, i1);
    struct vec v1 = owner->vertex[i1];
    struct vec v2 = owner->vertex[i2];
    struct vec tangent = vec_sub(v2, v1);
    vec_normalize(&tangent);
    m->local_normal = vec_cross_scalar(tangent, 1.0f);
    m->local_point = vec_scale(0.5f, vec_add(v1, v2));
    if (m->kind == FACE_B) {
        tangent = rot_apply(pose->q, tangent);
        v1 = pose_apply(pose, v1);
        v2 = pose_apply(pose, v2);
    } else {
        p[0].v = pose_apply(pose, p[0].v);
        p[1].v = pose_apply(pose, p[1].v);
    }
    struct vec n = vec_cross_scalar(tangent, 1.0f);
    float front = vec_dot(n, v1);
    if (!clip(p, vec_negate(tangent), -vec_dot(tangent, v1) + SKIN, i1) ||
        !clip(p, tangent, vec_dot(tangent, v2) + SKIN, i2)) {
        return;
    }
    for (int k = 0; k < 2; k++) {
        if (vec_dot(n, p[k].v) - front <= SKIN) {
            add_point(m, &p[k], pose);
        }
    }
}
