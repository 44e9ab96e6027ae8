/* SPDX-License-Identifier: MIT
 *
 * LANES walkers side by side: one float of each in a vector. The width is a macro of the compilation; whatever it is, every lane
 * goes through the same operations, so that it changes no bit.
 *
 * A comparison gives a mask. `lanes_min(a, b)` is a < b ? a : b and `lanes_max(a, b)` is a > b ? a : b, for NaNs and zeros
 * too: x86's instructions are defined so.
 */
#ifndef BITNEAT_WALKER_LANES_H
#define BITNEAT_WALKER_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __x86_64__
#include <immintrin.h>
#endif

#ifndef LANES
#error "LANES must be 1, 4, 8 or 16"
#endif

#define LANES_ALIGNED __attribute__((aligned(4 * LANES)))

#if LANES == 1

typedef float vf;
typedef bool vm;

static inline vf lanes_set(float x)
{
    return x;
}

static inline vm lanes_lt(vf a, vf b)
{
    return a < b;
}

static inline vm lanes_le(vf a, vf b)
{
    return a <= b;
}

static inline vf lanes_select(vm mask, vf a, vf b)
{
    return mask ? a : b;
}

static inline vm lanes_and(vm a, vm b)
{
    return a && b;
}

static inline vm lanes_or(vm a, vm b)
{
    return a || b;
}

static inline vm lanes_and_not(vm a, vm b)
{
    return a && !b;
}

static inline unsigned lanes_bits(vm a)
{
    return a ? 1U : 0U;
}

static inline vm lanes_from_bits(unsigned bits)
{
    return bits != 0;
}

static inline vf lanes_min(vf a, vf b)
{
    return a < b ? a : b;
}

static inline vf lanes_max(vf a, vf b)
{
    return a > b ? a : b;
}

static inline vf lanes_sqrt(vf a)
{
    return sqrtf(a);
}

#elif LANES == 16 && defined(__AVX512F__)

typedef float vf __attribute__((vector_size(64)));
typedef __mmask16 vm;

static inline vf lanes_set(float x)
{
    return (vf)_mm512_set1_ps(x);
}

static inline vm lanes_lt(vf a, vf b)
{
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ);
}

static inline vm lanes_le(vf a, vf b)
{
    return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ);
}

static inline vf lanes_select(vm mask, vf a, vf b)
{
    return (vf)_mm512_mask_blend_ps(mask, (__m512)b, (__m512)a);
}

static inline vm lanes_and(vm a, vm b)
{
    return _mm512_kand(a, b);
}

static inline vm lanes_or(vm a, vm b)
{
    return _mm512_kor(a, b);
}

static inline vm lanes_and_not(vm a, vm b)
{
    return _mm512_kandn(b, a);
}

static inline unsigned lanes_bits(vm a)
{
    return (unsigned)a;
}

static inline vm lanes_from_bits(unsigned bits)
{
    return (vm)bits;
}

static inline vf lanes_min(vf a, vf b)
{
    return (vf)_mm512_min_ps((__m512)a, (__m512)b);
}

static inline vf lanes_max(vf a, vf b)
{
    return (vf)_mm512_max_ps((__m512)a, (__m512)b);
}

static inline vf lanes_sqrt(vf a)
{
    return (vf)_mm512_sqrt_ps((__m512)a);
}

#elif LANES == 8 && defined(__AVX2__)

typedef float vf __attribute__((vector_size(32)));
typedef __m256 vm;

static inline vf lanes_set(float x)
{
    return (vf)_mm256_set1_ps(x);
}

static inline vm lanes_lt(vf a, vf b)
{
    return _mm256_cmp_ps((__m256)a, (__m256)b, _CMP_LT_OQ);
}

static inline vm lanes_le(vf a, vf b)
{
    return _mm256_cmp_ps((__m256)a, (__m256)b, _CMP_LE_OQ);
}

static inline vf lanes_select(vm mask, vf a, vf b)
{
    return (vf)_mm256_blendv_ps((__m256)b, (__m256)a, mask);
}

static inline vm lanes_and(vm a, vm b)
{
    return _mm256_and_ps(a, b);
}

static inline vm lanes_or(vm a, vm b)
{
    return _mm256_or_ps(a, b);
}

static inline vm lanes_and_not(vm a, vm b)
{
    return _mm256_andnot_ps(b, a);
}

static inline unsigned lanes_bits(vm a)
{
    return (unsigned)_mm256_movemask_ps(a);
}

static inline vm lanes_from_bits(unsigned bits)
{
    const __m256i bit = _mm256_set_epi32(128, 64, 32, 16, 8, 4, 2, 1);
    return (__m256)_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32((int)bits), bit), bit);
}

static inline vf lanes_min(vf a, vf b)
{
    return (vf)_mm256_min_ps((__m256)a, (__m256)b);
}

static inline vf lanes_max(vf a, vf b)
{
    return (vf)_mm256_max_ps((__m256)a, (__m256)b);
}

static inline vf lanes_sqrt(vf a)
{
    return (vf)_mm256_sqrt_ps((__m256)a);
}

#else /* GCC's and clang's portable vectors, which they split into what the machine has */

typedef float vf __attribute__((vector_size(4 * LANES)));
typedef int32_t vm __attribute__((vector_size(4 * LANES)));

static inline vf lanes_set(float x)
{
    return x - (vf){0}; /* x - 0 is x, for both zeros */
}

static inline vm lanes_lt(vf a, vf b)
{
    return a < b;
}

static inline vm lanes_le(vf a, vf b)
{
    return a <= b;
}

static inline vf lanes_select(vm mask, vf a, vf b)
{
    return (vf)((mask & (vm)a) | (~mask & (vm)b));
}

static inline vm lanes_and(vm a, vm b)
{
    return a & b;
}

static inline vm lanes_or(vm a, vm b)
{
    return a | b;
}

static inline vm lanes_and_not(vm a, vm b)
{
    return a & ~b;
}

static inline unsigned lanes_bits(vm a)
{
    unsigned bits = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        bits |= (a[lane] != 0 ? 1U : 0U) << lane;
    }
    return bits;
}

static inline vm lanes_from_bits(unsigned bits)
{
    vm mask = {0};
    for (int lane = 0; lane < LANES; ++lane) {
        mask[lane] = (bits >> lane & 1U) != 0 ? -1 : 0;
    }
    return mask;
}

static inline vf lanes_min(vf a, vf b)
{
    return lanes_select(a < b, a, b);
}

static inline vf lanes_max(vf a, vf b)
{
    return lanes_select(a > b, a, b);
}

static inline vf lanes_sqrt(vf a)
{
    vf root = a;
    for (int lane = 0; lane < LANES; ++lane) {
        root[lane] = sqrtf(a[lane]);
    }
    return root;
}

#endif

static inline bool lanes_any(vm a)
{
    return lanes_bits(a) != 0;
}

#endif
