/* SPDX-License-Identifier: MIT
 *
 * Whether the formula of trig.h gives what the C library gives, and what the C library gives at all.
 */
#define _GNU_SOURCE /* sincosf */
#include "trig.h"

#include <stddef.h>

#if defined(__linux__)
#define HAS_SINCOSF 1
#else
#define HAS_SINCOSF 0
#endif

enum { BLOCK = 16 };

int32_t trig_limit = -1;

void walker_set_trig(bool formula)
{
    trig_limit = formula ? TRIG_FORMULA_LIMIT : -1;
}

/* The library is called through these, so that the compiler neither computes results itself nor makes one call of two. */
static float (*volatile library_sin)(float) = sinf;
static float (*volatile library_cos)(float) = cosf;
static float (*volatile library_atan2)(float, float) = atan2f;
#if HAS_SINCOSF
static void (*volatile library_sincos)(float, float *, float *) = sincosf;
#endif

/* Each number of lanes is a compilation of its own, and each is tried. */
static __attribute__((noinline)) void sincos_1(const float *angle, float *s, float *c)
{
    trig_sincos(angle, s, c, 1, TRIG_FORMULA_LIMIT);
}

static __attribute__((noinline)) void sincos_4(const float *angle, float *s, float *c)
{
    trig_sincos(angle, s, c, 4, TRIG_FORMULA_LIMIT);
}

static __attribute__((noinline)) void sincos_8(const float *angle, float *s, float *c)
{
    trig_sincos(angle, s, c, 8, TRIG_FORMULA_LIMIT);
}

static __attribute__((noinline)) void sincos_16(const float *angle, float *s, float *c)
{
    trig_sincos(angle, s, c, 16, TRIG_FORMULA_LIMIT);
}

static const struct width {
    int32_t lanes;
    void (*sincos)(const float *angle, float *s, float *c);
} widths[] = {{1, sincos_1}, {4, sincos_4}, {8, sincos_8}, {16, sincos_16}};

/* Which NaN the library returns is nobody's concern. */
static bool same(float a, float b)
{
    return trig_bits(a) == trig_bits(b) || (isnan(a) && isnan(b));
}

static int64_t block_differences(const float *s, const float *c, const float *other_s, const float *other_c,
                                 int32_t count)
{
    int64_t found = 0;
    for (int32_t i = 0; i < count; i++) {
        found += !same(s[i], other_s[i]) + !same(c[i], other_c[i]);
    }
    return found;
}

/* Of the first `count` angles of a block. */
static int64_t block_mismatches(const float *angle, int32_t count)
{
    _Alignas(64) float s[BLOCK], c[BLOCK], expected_s[BLOCK], expected_c[BLOCK];
    for (int32_t i = 0; i < BLOCK; i++) {
        expected_s[i] = library_sin(angle[i]);
        expected_c[i] = library_cos(angle[i]);
#if HAS_SINCOSF
        library_sincos(angle[i], &s[i], &c[i]);
#else
        s[i] = expected_s[i];
        c[i] = expected_c[i];
#endif
    }
    int64_t found = block_differences(s, c, expected_s, expected_c, count);
    for (size_t w = 0; w < sizeof widths / sizeof widths[0]; w++) {
        for (int32_t i = 0; i < BLOCK; i += widths[w].lanes) {
            widths[w].sincos(&angle[i], &s[i], &c[i]);
        }
        found += block_differences(s, c, expected_s, expected_c, count);
    }
    return found;
}

int64_t trig_mismatches(uint32_t first, uint32_t last, uint32_t stride)
{
    int64_t found = 0;
    uint64_t bits = first;
    while (bits <= last) {
        _Alignas(64) float angle[BLOCK] = {0};
        _Alignas(64) float negative[BLOCK] = {0};
        int32_t count = 0;
        for (; count < BLOCK && bits <= last; count++, bits += stride) {
            angle[count] = trig_float((uint32_t)bits);
            negative[count] = -angle[count];
        }
        found += block_mismatches(angle, count) + block_mismatches(negative, count);
    }
    return found;
}

/* All floats from 0 to 100 for which glibc's builds with and without fused multiply-adds differ in the sine or the cosine. Any
 * sample would do against a library that rounds correctly, which neither build does for one float in a hundred. */
static const uint32_t build_dependent[] = {
    0x418a3adb, 0x418a3adc, 0x418a3add, 0x418a3ade, 0x41bc76d9, 0x4202eb4b, 0x4255b0a9,
    0x42687a55, 0x4280ce28, 0x42870e40, 0x42a35c07, 0x42a35d44, 0x42a97360, 0x42c55faa,
};
enum { NUM_BUILD_DEPENDENT = sizeof build_dependent / sizeof build_dependent[0] };

bool trig_self_test(void)
{
    for (int32_t i = 0; i < NUM_BUILD_DEPENDENT; i++) {
        if (trig_mismatches(build_dependent[i], build_dependent[i], 1)) {
            return false;
        }
    }
    /* From 2^-13, below which the sine is the angle and the cosine 1. Zero and the other special floats are among the first. */
    return trig_mismatches(0, 0x39000000, 0x00080001) == 0 &&
           trig_mismatches(0x39000000, TRIG_FORMULA_LIMIT, 1009) == 0 &&
           trig_mismatches(TRIG_FORMULA_LIMIT, 0x7f800000, 0x00100000) == 0;
}

static uint64_t hash_result(uint64_t hash, float result)
{
    return (hash ^ trig_bits(result)) * 0x100000001b3;
}

/* Angles of any size from 2^-13 to 2^33, with either sign; most are less than 2^7. */
static float draw_angle(uint32_t *state)
{
    *state = *state * 1664525 + 1013904223;
    uint32_t drawn = *state >> 4; /* the lowest bits have short periods */
    uint32_t exponents = drawn % 8 ? 20 : 46;
    *state = *state * 1664525 + 1013904223;
    uint32_t bits = (uint32_t)((uint64_t)*state * (exponents << 23) >> 32);
    return trig_float((0x39000000 + bits) | (drawn & 8) << 28);
}

uint64_t trig_probe(void)
{
    uint64_t hash = 0xcbf29ce484222325;
    for (int32_t i = 0; i < 2 * NUM_BUILD_DEPENDENT; i++) {
        float angle = trig_float(build_dependent[i / 2] | (uint32_t)i << 31);
        hash = hash_result(hash_result(hash, library_sin(angle)), library_cos(angle));
    }
    uint32_t state = 1;
    for (int32_t i = 0; i < 20000; i++) {
        float angle = draw_angle(&state);
        hash = hash_result(hash_result(hash, library_sin(angle)), library_cos(angle));
        hash = hash_result(hash, library_atan2(angle, draw_angle(&state)));
    }
    return hash;
}
