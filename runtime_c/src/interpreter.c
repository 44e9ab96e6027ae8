/* SPDX-License-Identifier: 0BSD
 *
 * The interpreter with all features. Written by `python -m bitneat.codegen.runtime` from the same templates as the generated
 * controllers' interpreters; edit the templates, not this file.
 */
#include "bitneat/runtime.h"
#include "format.h"

static uint8_t bn_byte(const uint8_t *address)
{
    return *address;
}

/* All ones where the highest bit of x is set, else 0. */
static uint32_t bn_mask(uint32_t x)
{
    return 0U - (x >> 31);
}

/* x itself, of which the compiler knows nothing: so it can't turn a sum of shifts into a multiplication. */
static uint32_t bn_opaque(uint32_t x)
{
#if defined(__clang__) && defined(__AVR__)
    uint16_t high = (uint16_t)(x >> 16);
    uint16_t low = (uint16_t)x;
    __asm__("" : "+r"(high), "+r"(low)); /* it has no 32-bit operand there */
    x = (uint32_t)high << 16 | low;
#elif defined(__GNUC__)
    __asm__("" : "+r"(x));
#endif
    return x;
}

/* The smaller of two values that are less than 2^31 apart. */
static uint32_t bn_min(uint32_t x, uint32_t y)
{
    const uint32_t difference = x - y;
    return y + (difference & bn_mask(difference));
}

/* The larger of two values that are less than 2^31 apart. */
static uint32_t bn_max(uint32_t x, uint32_t y)
{
    const uint32_t difference = x - y;
    return x - (difference & bn_mask(difference));
}

/* x, or -x where y is negative. */
static uint32_t bn_copysign(uint32_t x, uint32_t y)
{
    const uint32_t negative = bn_mask(y);
    return (x ^ negative) - negative;
}

/* x clipped to -limit..limit, for any |x| < 2^31: the sign of each comparison is taken without overflow. */
static uint32_t bn_clip_wide(uint32_t x, uint32_t limit)
{
    const uint32_t high = bn_mask(~x & (limit - x));
    const uint32_t low = bn_mask(x & (x + limit));
    return (x & ~(high | low)) | (limit & high) | ((0U - limit) & low);
}

/* x / 2^k rounded down, for |x| < 2^31. */
static uint32_t bn_floor_shift(uint32_t x, unsigned k)
{
    const uint32_t middle = UINT32_C(1) << 31;
    return ((x + middle) >> k) - (middle >> k);
}

/* A value in -32768..32767 as an int16_t. Every conversion is in range whatever x is, which a compiler sees, and an analyser. */
static int16_t bn_signal(uint32_t x)
{
    return (int16_t)((int32_t)(uint16_t)(x + 32768U) - 32768);
}

/* clamped: clip(u, -One, One) */
static uint32_t bn_act_clamped(uint32_t u, unsigned f)
{
    const uint32_t t2 = bn_min(u, (UINT32_C(4096) >> (12U - f)));
    const uint32_t t4 = UINT32_C(0) - (UINT32_C(4096) >> (12U - f));
    return bn_max(t2, t4);
}

/* relu: max(u, 0) */
static uint32_t bn_act_relu(uint32_t u)
{
    return bn_max(u, UINT32_C(0));
}

/* abs: |u| */
static uint32_t bn_act_abs(uint32_t u)
{
    return bn_copysign(u, u);
}

/* hat: max(0, One - |u|) */
static uint32_t bn_act_hat(uint32_t u, unsigned f)
{
    const uint32_t t2 = bn_copysign(u, u);
    const uint32_t t3 = (UINT32_C(4096) >> (12U - f)) - t2;
    return bn_max(t3, UINT32_C(0));
}

/* step: One if u > 0 else 0 */
static uint32_t bn_act_step(uint32_t u, unsigned f)
{
    const uint32_t t2 = bn_max(u, UINT32_C(0));
    const uint32_t t4 = bn_min(t2, UINT32_C(1));
    return t4 << f;
}

/* tanh: tanh(2.5 z) */
static uint32_t bn_act_tanh(uint32_t u, unsigned f)
{
    const uint32_t t1 = bn_copysign(u, u);
    const uint32_t t2 = t1 << 1;
    const uint32_t t3 = t1 >> 1;
    const uint32_t t4 = t2 + t3;
    const uint32_t t5 = t1 << 1;
    const uint32_t t6 = t1 >> 5;
    const uint32_t t7 = t5 + t6;
    const uint32_t t9 = t7 + (UINT32_C(208) >> (12U - f));
    const uint32_t t10 = t1 >> 2;
    const uint32_t t11 = t1 + t10;
    const uint32_t t13 = t11 + (UINT32_C(1073) >> (12U - f));
    const uint32_t t14 = t1 >> 1;
    const uint32_t t15 = t1 >> 4;
    const uint32_t t16 = t14 + t15;
    const uint32_t t18 = t16 + (UINT32_C(2318) >> (12U - f));
    const uint32_t t19 = t1 >> 3;
    const uint32_t t20 = t1 >> 6;
    const uint32_t t21 = t19 + t20;
    const uint32_t t23 = t21 + (UINT32_C(3473) >> (12U - f));
    const uint32_t t25 = bn_min(t4, t9);
    const uint32_t t26 = bn_min(t25, t13);
    const uint32_t t27 = bn_min(t26, t18);
    const uint32_t t28 = bn_min(t27, t23);
    const uint32_t t29 = bn_min(t28, (UINT32_C(4096) >> (12U - f)));
    return bn_copysign(t29, u);
}

/* sigmoid: 1 / (1 + exp(-5 z)) = (1 + tanh(2.5 z)) / 2 */
static uint32_t bn_act_sigmoid(uint32_t u, unsigned f)
{
    const uint32_t t1 = bn_copysign(u, u);
    const uint32_t t2 = t1 << 1;
    const uint32_t t3 = t1 >> 1;
    const uint32_t t4 = t2 + t3;
    const uint32_t t5 = t1 << 1;
    const uint32_t t6 = t1 >> 5;
    const uint32_t t7 = t5 + t6;
    const uint32_t t9 = t7 + (UINT32_C(208) >> (12U - f));
    const uint32_t t10 = t1 >> 2;
    const uint32_t t11 = t1 + t10;
    const uint32_t t13 = t11 + (UINT32_C(1073) >> (12U - f));
    const uint32_t t14 = t1 >> 1;
    const uint32_t t15 = t1 >> 4;
    const uint32_t t16 = t14 + t15;
    const uint32_t t18 = t16 + (UINT32_C(2318) >> (12U - f));
    const uint32_t t19 = t1 >> 3;
    const uint32_t t20 = t1 >> 6;
    const uint32_t t21 = t19 + t20;
    const uint32_t t23 = t21 + (UINT32_C(3473) >> (12U - f));
    const uint32_t t25 = bn_min(t4, t9);
    const uint32_t t26 = bn_min(t25, t13);
    const uint32_t t27 = bn_min(t26, t18);
    const uint32_t t28 = bn_min(t27, t23);
    const uint32_t t29 = bn_min(t28, (UINT32_C(4096) >> (12U - f)));
    const uint32_t t30 = bn_copysign(t29, u);
    const uint32_t t32 = (UINT32_C(4096) >> (12U - f)) + t30;
    return t32 >> 1;
}

/* sin: sin(5 z), |5 z| <= 60 */
static uint32_t bn_act_sin(uint32_t u, unsigned f)
{
    const uint32_t t1 = bn_copysign(u, u);
    const uint32_t t3 = bn_min(t1, (UINT32_C(49152) >> (12U - f)));
    const uint32_t t4 = bn_opaque(t3 << 10);
    const uint32_t t5 = bn_opaque(t3 << 8);
    const uint32_t t6 = t4 - t5;
    const uint32_t t7 = bn_opaque(t3 << 6);
    const uint32_t t8 = t6 + t7;
    const uint32_t t9 = bn_opaque(t3 << 4);
    const uint32_t t10 = t8 - t9;
    const uint32_t t11 = t10 - t3;
    const uint32_t t12 = t11 & ((UINT32_C(1) << (f + 9U)) - 1U);
    const uint32_t t14 = (UINT32_C(8192) << (f - 4U)) - t12;
    const uint32_t t15 = bn_min(t12, t14);
    const uint32_t t16 = t15 >> 1;
    const uint32_t t17 = t15 + t16;
    const uint32_t t18 = t15 >> 4;
    const uint32_t t19 = t15 + t18;
    const uint32_t t21 = t19 + (UINT32_C(686) << (f - 4U));
    const uint32_t t22 = t15 >> 1;
    const uint32_t t23 = t15 >> 7;
    const uint32_t t24 = t22 + t23;
    const uint32_t t26 = t24 + (UINT32_C(2195) << (f - 4U));
    const uint32_t t28 = bn_min(t17, t21);
    const uint32_t t29 = bn_min(t28, t26);
    const uint32_t t30 = bn_min(t29, (UINT32_C(4096) << (f - 4U)));
    const uint32_t t31 = t11 & (UINT32_C(1) << (f + 9U));
    const uint32_t t33 = UINT32_C(0) - t31;
    const uint32_t t34 = t30 >> 8;
    const uint32_t t35 = bn_copysign(t34, t33);
    return bn_copysign(t35, u);
}

/* gauss: exp(-5 z^2) */
static uint32_t bn_act_gauss(uint32_t u, unsigned f)
{
    const uint32_t t1 = bn_copysign(u, u);
    const uint32_t t4 = t1 >> 4;
    const uint32_t t5 = t1 + t4;
    const uint32_t t6 = (UINT32_C(4299) >> (12U - f)) - t5;
    const uint32_t t8 = t1 >> 2;
    const uint32_t t9 = (UINT32_C(4751) >> (12U - f)) + t8;
    const uint32_t t10 = t1 << 1;
    const uint32_t t11 = t9 - t10;
    const uint32_t t12 = bn_min((UINT32_C(4096) >> (12U - f)), t6);
    const uint32_t t13 = bn_min(t12, t11);
    const uint32_t t15 = t1 >> 5;
    const uint32_t t16 = (UINT32_C(3072) >> (12U - f)) + t15;
    const uint32_t t17 = t16 - t1;
    const uint32_t t19 = t1 >> 2;
    const uint32_t t20 = t1 >> 4;
    const uint32_t t21 = t19 + t20;
    const uint32_t t22 = (UINT32_C(1233) >> (12U - f)) - t21;
    const uint32_t t24 = bn_max(t13, t17);
    const uint32_t t25 = bn_max(t24, t22);
    return bn_max(t25, UINT32_C(0));
}

/* A place in the blob: a byte, and how many of its low bits have been read. */
struct bn_cursor {
    const uint8_t *next;
    unsigned bit;
};

/* The next `width` (0..32) bits of the blob, the lowest first. */
static uint32_t bn_take(struct bn_cursor *at, unsigned width)
{
    uint32_t value = 0;
    unsigned got = 0;
    while (got < width) {
        const unsigned here = 8U - at->bit;
        value |= ((uint32_t)bn_byte(at->next) >> at->bit) << got;
        if (width - got < here) {
            at->bit += width - got;
            return value & ((UINT32_C(2) << (width - 1U)) - 1U);
        }
        got += here;
        at->next++;
        at->bit = 0;
    }
    return value;
}

/* The place `count` bits further on. */
static struct bn_cursor bn_after(struct bn_cursor at, uint32_t count)
{
    const uint32_t bit = at.bit + count;
    at.next += bit >> 3;
    at.bit = (unsigned)(bit & 7U);
    return at;
}

/* The next number in the Rice code of parameter k. */
static uint32_t bn_take_rice(struct bn_cursor *at, unsigned k)
{
    uint32_t quotient = 0;
    while (bn_take(at, 1) != 0) {
        quotient++;
    }
    return (quotient << k) | bn_take(at, k);
}

/* A node's gain, saturation and activation. */
static uint32_t bn_respond(const struct bn_controller *c, unsigned fields, uint32_t sum)
{
    const int gain = c->min_gain + (int)(fields >> c->activation_bits);
    if (gain >= 0) {
        sum <<= (unsigned)gain;
    } else {
        sum = bn_floor_shift(sum, (unsigned)-gain);
    }
    sum = bn_clip_wide(sum, 32767U);
    switch (c->activations[fields & ((1U << c->activation_bits) - 1U)]) {
    case 1:
        return bn_act_clamped(sum, c->frac_bits);
    case 2:
        return bn_act_relu(sum);
    case 3:
        return bn_act_abs(sum);
    case 4:
        return bn_act_hat(sum, c->frac_bits);
    case 5:
        return bn_act_step(sum, c->frac_bits);
    case 6:
        return bn_act_tanh(sum, c->frac_bits);
    case 7:
        return bn_act_sigmoid(sum, c->frac_bits);
    case 8:
        return bn_act_sin(sum, c->frac_bits);
    case 9:
        return bn_act_gauss(sum, c->frac_bits);
    default:
        return sum;
    }
}

/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_bytes(const struct bn_controller *c, int16_t *signals)
{
    struct bn_cursor at; /* set part by part: some compilers would copy an initializer from static data */
    at.next = c->body;
    at.bit = 0;
    const unsigned record_bits = 8U * c->record_bytes;
    const unsigned shift_mask = c->has_shifts ? 7U : 0U;
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const uint32_t bias_sign = c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U);
        const unsigned fields = (unsigned)bn_take(&at, (unsigned)(c->activation_bits + c->gain_bits));
        uint32_t sum = (bn_take(&at, c->bias_width) ^ bias_sign) - bias_sign;
        const uint8_t *next = at.next + (at.bit != 0);
        uint32_t record;
        do {
            record = bn_byte(next++);
            if (record_bits > 8) {
                record |= (uint32_t)bn_byte(next++) << 8;
            }
            if (record_bits > 16) {
                record |= (uint32_t)bn_byte(next++) << 16;
            }
            const unsigned shift = (unsigned)(record >> (record_bits - 5U)) & shift_mask;
            const uint32_t x = (uint32_t)(int32_t)signals[record & c->slot_mask] << shift;
            const uint32_t sign = 0U - ((record >> (record_bits - 2U)) & 1U);
            sum += (x ^ sign) - sign;
        } while ((record >> (record_bits - 1U)) == 0);
        at.next = next;
        at.bit = 0;
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_rice(const struct bn_controller *c, int16_t *signals)
{
    struct bn_cursor at; /* set part by part: some compilers would copy an initializer from static data */
    at.next = c->body;
    at.bit = 0;
    const unsigned count_k = (unsigned)bn_take(&at, 3);
    const unsigned gap_k = (unsigned)bn_take(&at, 3);
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const uint32_t bias_sign = c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U);
        const unsigned fields = (unsigned)bn_take(&at, (unsigned)(c->activation_bits + c->gain_bits));
        uint32_t sum = (bn_take(&at, c->bias_width) ^ bias_sign) - bias_sign;
        uint32_t left = bn_take_rice(&at, count_k);
        uint32_t slot = UINT32_C(0) - (c->has_shifts ? 0U : 1U); /* of 32 bits even where an int has 16 */
        while (left-- != 0) {
            slot += (c->has_shifts ? 0U : 1U) + bn_take_rice(&at, gap_k);
            const unsigned shift = (unsigned)bn_take(&at, (c->has_shifts ? 3U : 0U));
            const uint32_t x = (uint32_t)(int32_t)signals[slot] << shift;
            const uint32_t sign = 0U - bn_take(&at, 1);
            sum += (x ^ sign) - sign;
        }
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_planes(const struct bn_controller *c, int16_t *signals)
{
    struct bn_cursor at; /* set part by part: some compilers would copy an initializer from static data */
    at.next = c->body;
    at.bit = 0;
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const uint32_t bias_sign = c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U);
        const unsigned fields = (unsigned)bn_take(&at, (unsigned)(c->activation_bits + c->gain_bits));
        uint32_t sum = (bn_take(&at, c->bias_width) ^ bias_sign) - bias_sign;
        struct bn_cursor signs = bn_after(at, (uint32_t)(node - signals));
        for (const int16_t *source = signals; source != node; source++) {
            if (bn_take(&at, 1) != 0) {
                const uint32_t sign = 0U - bn_take(&signs, 1);
                sum += ((uint32_t)(int32_t)*source ^ sign) - sign;
            }
        }
        at.next = signs.next;
        at.bit = signs.bit;
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_two_bits(const struct bn_controller *c, int16_t *signals)
{
    struct bn_cursor at; /* set part by part: some compilers would copy an initializer from static data */
    at.next = c->body;
    at.bit = 0;
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const uint32_t bias_sign = c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U);
        const unsigned fields = (unsigned)bn_take(&at, (unsigned)(c->activation_bits + c->gain_bits));
        uint32_t sum = (bn_take(&at, c->bias_width) ^ bias_sign) - bias_sign;
        for (const int16_t *source = signals; source != node; source++) {
            const uint32_t weight = bn_take(&at, 2);
            const uint32_t x = (uint32_t)(int32_t)*source;
            sum += (x & (0U - (weight & 1U))) - (x & (0U - (weight >> 1)));
        }
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_trits(const struct bn_controller *c, int16_t *signals)
{
    struct bn_cursor at; /* set part by part: some compilers would copy an initializer from static data */
    at.next = c->body;
    at.bit = 0;
    const uint32_t node_bits = (uint32_t)(c->activation_bits + c->gain_bits + c->bias_width);
    const uint8_t *next = c->body + ((c->num_nodes * node_bits + 7U) >> 3);
    uint_fast8_t trits = 0;
    uint_fast8_t place = 0;
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const uint32_t bias_sign = c->bias_width == 0 ? 0 : UINT32_C(1) << (c->bias_width - 1U);
        const unsigned fields = (unsigned)bn_take(&at, (unsigned)(c->activation_bits + c->gain_bits));
        uint32_t sum = (bn_take(&at, c->bias_width) ^ bias_sign) - bias_sign;
        for (const int16_t *source = signals; source != node; source++) {
            const uint32_t x = (uint32_t)(int32_t)*source;
            uint32_t weight = 0;
            if (place == 0) {
                trits = bn_byte(next++);
                place = 81;
            }
            while (trits >= place) {
                trits = (uint_fast8_t)(trits - place);
                weight++;
            }
            place = place == 81 ? 27 : place == 27 ? 9 : place == 9 ? 3 : place == 3 ? 1 : 0;
            sum += (x & (0U - (weight & 1U))) - (x & (0U - (weight >> 1)));
        }
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* The same for records of one byte without shifts and general biases, which is what most evolved controllers have. */
/* Evaluates every node in order, from the slots before them. */
static void bn_nodes_small(const struct bn_controller *c, int16_t *signals)
{
    const int has_fields = c->activation_bits + c->gain_bits != 0;
    const uint8_t *next = c->body;
    int16_t *node = signals + c->first_node;
    int16_t *const end = signals + c->num_slots;
    while (node != end) {
        const unsigned fields = has_fields ? bn_byte(next++) : 0U;
        uint32_t sum = 0;
        uint32_t record;
        do {
            record = bn_byte(next++);
            const uint32_t x = (uint32_t)(int32_t)signals[record & 63U];
            const uint32_t sign = 0U - ((record >> 6) & 1U);
            sum += (x ^ sign) - sign;
        } while ((record >> 7) == 0);
        *node++ = bn_signal(bn_respond(c, fields, sum));
    }
}

/* The slot of an input or node. */
static uint16_t bn_slot_of(const struct bn_controller *c, uint32_t signal)
{
    return (uint16_t)(signal < c->num_inputs ? signal : signal - c->num_inputs + c->first_node);
}

/* A node's gain, saturation and activation for every lane; the dispatch stands outside the loops, which vectorize. */
static void bn_respond_lanes(const struct bn_controller *c, unsigned fields, size_t lanes, uint32_t *sums,
                             int16_t *node)
{
    const int gain = c->min_gain + (int)(fields >> c->activation_bits);
    const unsigned f = c->frac_bits;
    for (size_t lane = 0; lane < lanes && gain > 0; lane++) {
        sums[lane] <<= (unsigned)gain;
    }
    for (size_t lane = 0; lane < lanes && gain < 0; lane++) {
        sums[lane] = bn_floor_shift(sums[lane], (unsigned)-gain);
    }
    for (size_t lane = 0; lane < lanes; lane++) {
        sums[lane] = bn_clip_wide(sums[lane], 32767U);
    }
    switch (c->activations[fields & ((1U << c->activation_bits) - 1U)]) {
    case 1:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_clamped(sum, f));
        }
        break;
    case 2:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_relu(sum));
        }
        break;
    case 3:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_abs(sum));
        }
        break;
    case 4:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_hat(sum, f));
        }
        break;
    case 5:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_step(sum, f));
        }
        break;
    case 6:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_tanh(sum, f));
        }
        break;
    case 7:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_sigmoid(sum, f));
        }
        break;
    case 8:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_sin(sum, f));
        }
        break;
    case 9:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(bn_act_gauss(sum, f));
        }
        break;
    default:
        for (size_t lane = 0; lane < lanes; lane++) {
            const uint32_t sum = sums[lane];
            node[lane] = bn_signal(sum);
        }
        break;
    }
}

void bn_run_lanes(const struct bn_controller *c, size_t lanes, int16_t *workspace)
{
    struct bn_cursor at = {c->body, 0};
    const unsigned record_bits = 8U * c->record_bytes;
    const unsigned shift_mask = c->has_shifts ? 7U : 0U;
    const uint32_t slot_mask = c->slot_mask;
    const unsigned field_bits = (unsigned)(c->activation_bits + c->gain_bits);
    const unsigned bias_width = c->bias_width;
    const uint32_t bias_sign = bias_width == 0 ? 0 : UINT32_C(1) << (bias_width - 1U);
    for (size_t lane = 0; lane < lanes; lane++) {
        if (c->bias_mode == BN_BIAS_TERNARY) {
            workspace[c->num_inputs * lanes + lane] = (int16_t)(1 << c->frac_bits);
        }
        if (c->has_empty != 0U) {
            workspace[(c->first_delayed - 1) * lanes + lane] = 0;
        }
    }
    for (uint16_t slot = c->first_node; slot < c->num_slots; slot++) {
        const unsigned fields = (unsigned)bn_take(&at, field_bits);
        const uint32_t bias = (bn_take(&at, bias_width) ^ bias_sign) - bias_sign;
        const uint8_t *next = at.next + (at.bit != 0);
        uint32_t sums[BN_MAX_LANES];
        uint32_t record;
        for (size_t lane = 0; lane < lanes; lane++) {
            sums[lane] = bias;
        }
        do {
            record = *next++;
            if (record_bits > 8) {
                record |= (uint32_t)*next++ << 8;
            }
            if (record_bits > 16) {
                record |= (uint32_t)*next++ << 16;
            }
            const int16_t *source = workspace + (record & slot_mask) * lanes;
            const unsigned shift = (unsigned)(record >> (record_bits - 5U)) & shift_mask;
            const uint32_t sign = 0U - ((record >> (record_bits - 2U)) & 1U);
            for (size_t lane = 0; lane < lanes; lane++) {
                sums[lane] += (((uint32_t)(int32_t)source[lane] << shift) ^ sign) - sign;
            }
        } while ((record >> (record_bits - 1U)) == 0);
        at.next = next;
        at.bit = 0;
        bn_respond_lanes(c, fields, lanes, sums, workspace + (size_t)slot * lanes);
    }
    struct bn_cursor output = {c->blob + (c->outputs_at >> 3), (unsigned)(c->outputs_at & 7U)};
    for (uint16_t i = 0; c->has_map && i < c->num_outputs; i++) {
        int16_t *to = workspace + (size_t)(c->num_slots + i) * lanes;
        const int constant = bn_take(&output, 1) != 0;
        const uint32_t value = bn_take(&output, constant ? 16U : c->signal_width);
        for (size_t lane = 0; lane < lanes; lane++) {
            to[lane] = constant ? bn_signal((value ^ 0x8000U) - 0x8000U)
                                : workspace[(size_t)bn_slot_of(c, value) * lanes + lane];
        }
    }
}

static void bn_map_outputs(const struct bn_controller *c, int16_t *workspace)
{
    struct bn_cursor at = {c->blob + (c->outputs_at >> 3), (unsigned)(c->outputs_at & 7U)};
    for (uint16_t i = 0; i < c->num_outputs; i++) {
        int16_t *output = workspace + c->num_slots + i;
        if (bn_take(&at, 1) != 0) {
            const uint32_t value = bn_take(&at, 16);
            *output = bn_signal((value ^ 0x8000U) - 0x8000U);
        } else {
            *output = workspace[bn_slot_of(c, bn_take(&at, c->signal_width))];
        }
    }
}

void bn_reset(const struct bn_controller *c, int16_t *state)
{
    for (uint16_t i = 0; i < c->num_state; i++) {
        state[i] = 0;
    }
}

void bn_run(const struct bn_controller *c, int16_t *state, int16_t *workspace)
{
    if (c->bias_mode == BN_BIAS_TERNARY) {
        workspace[c->num_inputs] = (int16_t)(1 << c->frac_bits);
    }
    if (c->has_empty != 0U) {
        workspace[c->first_delayed - 1] = 0;
    }
    for (uint16_t i = 0; i < c->num_state; i++) {
        workspace[c->first_delayed + i] = state[i];
    }
    switch (c->encoding) {
    case BN_BYTES:
        if (c->record_bytes == 1 && !c->has_shifts && c->bias_width == 0) {
            bn_nodes_small(c, workspace);
        } else {
            bn_nodes_bytes(c, workspace);
        }
        break;
    case BN_RICE:
        bn_nodes_rice(c, workspace);
        break;
    case BN_PLANES:
        bn_nodes_planes(c, workspace);
        break;
    case BN_TWO_BITS:
        bn_nodes_two_bits(c, workspace);
        break;
    default:
        bn_nodes_trits(c, workspace);
        break;
    }
    if (c->num_state != 0) {
        struct bn_cursor at = {c->blob + (c->delayed_at >> 3), (unsigned)(c->delayed_at & 7U)};
        for (uint16_t i = 0; i < c->num_state; i++) {
            state[i] = workspace[bn_slot_of(c, bn_take(&at, c->signal_width))];
        }
    }
    if (c->has_map != 0U) {
        bn_map_outputs(c, workspace);
    }
}
