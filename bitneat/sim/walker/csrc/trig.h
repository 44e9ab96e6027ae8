/* SPDX-License-Identifier: MIT
 *
 * Sine and cosine of float32 angles, equal to the bit to those of the C library, which are the ones that Box2D sees.
 *
 * The library's sinf and cosf are right in most cases only, so no other method of computing them gives the same simulator. The
 * formula below is the one that glibc (since 2.28) evaluates where the processor has fused multiply-adds: in double, operation by
 * operation, with the same coefficients. It is plain C without branches, so that the compiler makes vectors of any width of it;
 * what it computes does not depend on whether the compiler does.
 *
 * Another C library, or a glibc that chose another build of its functions, may differ. So the formula is off until
 * walker_set_trig(true), which a caller may say where trig_self_test() holds; until then every lane is computed by the library.
 */
#ifndef BITNEAT_WALKER_TRIG_H
#define BITNEAT_WALKER_TRIG_H

#include "geometry.h"

/* Without the instruction __builtin_fma is a slow function, and glibc would have chosen its build without it. */
#if defined(__x86_64__) && defined(__FMA__)
#define TRIG_FORMULA 1
#else
#define TRIG_FORMULA 0
#endif

/* The bits of 100.0f. glibc reduces angles below 120 as the formula does, others otherwise; a walker turns by a few radians. */
#define TRIG_FORMULA_LIMIT 0x42c80000

/* Angles up to this float's bits are the formula's: those of TRIG_FORMULA_LIMIT, or -1 while it is off. The bound has to be
 * checked in any case, for an angle may be large or a NaN, so that turning the formula off costs nothing where it is on. */
extern __attribute__((visibility("hidden"))) int32_t trig_limit;

/* Whether lanes_sincos may use the formula; not while another thread is in lanes_sincos. */
void walker_set_trig(bool formula);

/* How many results of the formula, of any number of lanes, differ from the library's; and those of sincosf that differ from sinf
 * and cosf. For every stride-th float from the bit pattern `first` to `last` (0 to that of infinity), and for its negative. */
int64_t trig_mismatches(uint32_t first, uint32_t last, uint32_t stride);

/* Whether the formula equals the library in some 300 000 places, those included where other builds of it are known to differ.
 * It takes about ten milliseconds. */
bool trig_self_test(void);

/* A hash of the library's sinf, cosf and atan2f in some 20 000 places: where it is the same, simulations should be, too. */
uint64_t trig_probe(void);

static inline struct rot rot_from_angle(float angle)
{
    struct rot q = {.s = sinf(angle), .c = cosf(angle)};
    return q;
}

static inline uint32_t trig_bits(float value)
{
    union {
        float value;
        uint32_t bits;
    } both = {.value = value};
    return both.bits;
}

static inline float trig_float(uint32_t bits)
{
    union {
        uint32_t bits;
        float value;
    } both = {.bits = bits};
    return both.value;
}

/* The bits of |angle|: as integers they are in the order of the values, with infinity and then the NaNs at the end. */
static inline int32_t trig_magnitude(float angle)
{
    return (int32_t)(trig_bits(angle) & 0x7fffffff);
}

/* The lanes that the formula does not serve; rare, unless it is off. */
static __attribute__((noinline, cold, unused)) void trig_library(const float *angle, float *s, float *c, int32_t lanes,
                                                                 int32_t limit)
{
    for (int32_t i = 0; i < lanes; i++) {
        if (trig_magnitude(angle[i]) > limit) {
            s[i] = sinf(angle[i]);
            c[i] = cosf(angle[i]);
        }
    }
}

/* `lanes` sines and cosines. It must be a constant for the loop to become vectors, hence the forced inlining; and choices are made
 * with masks, for the compiler gives up on a loop when it takes a choice for a branch. */
static inline __attribute__((always_inline)) void trig_sincos(const float *restrict angle, float *restrict s,
                                                              float *restrict c, int32_t lanes, int32_t limit)
{
#if TRIG_FORMULA
    int32_t beyond = 0; /* its sign */
    for (int32_t i = 0; i < lanes; i++) {
        int32_t magnitude = trig_magnitude(angle[i]);
        beyond |= limit - magnitude;
        /* Other angles become 0, because they might not fit the integer. */
        uint32_t served = (uint32_t)((magnitude - TRIG_FORMULA_LIMIT - 1) >> 31);
        double a = trig_float(trig_bits(angle[i]) & served);
        /* The nearest multiple of pi/2. The product, in units of 2^-24 quadrants, loses its fraction before it is rounded to
         * whole quadrants: this decides where a quadrant begins. */
        int32_t quadrant = ((int32_t)(a * 0x1.45f306dc9c883p+23) + 0x800000) >> 24;
        double x = __builtin_fma(-(double)quadrant, 0x1.921fb54442d18p+0, a);
        double x2 = x * x;
        double x3 = x * x2;
        double x4 = x2 * x2;
        double odd_high = __builtin_fma(x2, -0x1.994eb3774cf24p-13, 0x1.1107605230bc4p-7);
        double odd_low = __builtin_fma(x3, -0x1.555545995a603p-3, x);
        uint32_t odd = trig_bits((float)__builtin_fma(x3 * x2, odd_high, odd_low));
        double even_high = __builtin_fma(x2, 0x1.99343027bf8c3p-16, -0x1.6c087e89a359dp-10);
        double even_low = __builtin_fma(x4, 0x1.55553e1068f19p-5, __builtin_fma(x2, -0x1.ffffffd0c621cp-2, 1.0));
        uint32_t even = trig_bits((float)__builtin_fma(x4 * x2, even_high, even_low));
        uint32_t turn = (uint32_t)quadrant;
        uint32_t swap = (odd ^ even) & -(turn & 1);
        /* The library returns the smallest angles as they are; so does the formula, but for the sign of -0. */
        uint32_t negative_zero = trig_bits(angle[i]) & (uint32_t)((magnitude - 1) >> 31);
        s[i] = trig_float((odd ^ swap ^ (turn & 2) << 30) | negative_zero);
        c[i] = trig_float(even ^ swap ^ ((turn + 1) & 2) << 30);
    }
    if (__builtin_expect(beyond < 0, 0)) {
        trig_library(angle, s, c, lanes, limit);
    }
#else
    (void)limit;
    trig_library(angle, s, c, lanes, -1);
#endif
}

#ifdef LANES
/* LANES sines and cosines; the arrays do not overlap and are aligned to 4 * LANES bytes. */
static inline void lanes_sincos(const float *angle, float *s, float *c)
{
    trig_sincos(__builtin_assume_aligned(angle, 4 * LANES), __builtin_assume_aligned(s, 4 * LANES),
                __builtin_assume_aligned(c, 4 * LANES), LANES, trig_limit);
}
#endif

#endif
