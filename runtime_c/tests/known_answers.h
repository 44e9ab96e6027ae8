/* SPDX-License-Identifier: 0BSD
 *
 * Blobs, inputs and the outputs that the reference gives. Written by `python -m bitneat.codegen.runtime`.
 */
/* clang-format off */
#include <stddef.h>
#include <stdint.h>

enum { KNOWN_STEPS = 24 };

static const int16_t every_activation_inputs[] = {
    2047, 32767,
    -2047, -32767,
    0, 0,
    -2047, -32767,
    -17, 31,
    2047, 7282,
    1061, -329,
    3, -4,
    2047, 23955,
    -1016, 800,
    -3, -19,
    2047, -28759,
    -2, 2,
    1, -1,
    -114, -15,
    2047, 8054,
    -35, 195,
    -2, 13,
    -30, 21,
    -2047, -4201,
    380, -1058,
    1354, 2819,
    -124, 109,
    31, 32,
};

static const int16_t every_activation_outputs[] = {
    -15360, 256, 383, 832, 0, 256, 256, 256, 236, 0,
    15360, -256, 0, 1024, 0, 0, -256, 0, 245, 0,
    0, 256, 0, 0, 0, 0, 0, 254, -153, 163,
    15360, -256, 0, 1024, 0, 0, -256, 0, 245, 0,
    -24, 256, 0, 9, 26, 0, -22, 254, -137, 191,
    -2618, 256, 383, 832, 0, 256, 256, 256, 236, 0,
    695, 256, 137, 462, 0, 256, 256, 256, 113, 0,
    3, 256, 0, 1, 0, 0, 2, 254, -157, 156,
    -10954, 256, 383, 832, 0, 256, 256, 256, 236, 0,
    -908, 148, 0, 508, 0, 0, -256, 0, 17, 0,
    8, 245, 0, 2, 5, 0, -5, 254, -150, 168,
    15403, -256, 511, 768, 0, 256, 256, 256, 236, 0,
    -2, 256, 0, 1, 3, 0, -2, 254, -153, 164,
    1, 256, 0, 0, 0, 0, 0, 254, -153, 161,
    -50, 192, 0, 57, 171, 0, -128, 255, -18, 212,
    -3004, 256, 383, 832, 0, 256, 256, 256, 236, 0,
    -115, 256, 0, 18, 53, 0, -45, 255, -113, 227,
    -8, 256, 0, 1, 3, 0, -2, 254, -153, 164,
    -26, 252, 0, 15, 45, 0, -37, 254, -123, 215,
    1077, -256, 0, 1024, 0, 0, -256, 0, 245, 0,
    719, -83, 51, 164, 0, 256, 138, 256, -154, 0,
    -733, 256, 210, 572, 0, 256, 256, 256, -209, 0,
    -117, 249, 0, 62, 186, 0, -138, 255, -8, 194,
    -1, 256, 0, 15, 0, 0, 37, 253, -180, 112,
};

static const uint8_t every_activation_bytes[] = {
    0x01, 0x05, 0x05, 0x45, 0xf9, 0x7f, 0x49, 0x80, 0xff, 0x07, 0xf8, 0xff, 0x17, 0x10, 0x00, 0xc1,
    0x21, 0x00, 0x02, 0xc3, 0x02, 0x00, 0x42, 0xc4, 0x13, 0x00, 0xc5, 0x24, 0x00, 0x02, 0xc6, 0x05,
    0x00, 0x42, 0xc7, 0x16, 0x00, 0xc8, 0x27, 0x00, 0x02, 0xc9, 0x08, 0x00, 0x42, 0xca, 0x19, 0x00,
    0xcb,
};

static const uint8_t every_activation_rice[] = {
    0x09, 0x05, 0x05, 0x45, 0xf9, 0x7f, 0x49, 0x80, 0xff, 0x07, 0xf8, 0xff, 0x17, 0x09, 0x14, 0x30,
    0x2c, 0x44, 0xa1, 0xb0, 0xa7, 0x60, 0x92, 0x85, 0xba, 0x28, 0x3c, 0xad, 0xe0, 0x3e, 0x0b, 0x9d,
    0x48, 0xe1, 0x3b, 0x0b, 0x3e, 0x01,
};

static const uint8_t every_activation_planes[] = {
    0x11, 0x05, 0x05, 0x45, 0xf9, 0x7f, 0x49, 0x80, 0xff, 0x07, 0xf8, 0xff, 0x17, 0xd0, 0x0c, 0x9b,
    0x42, 0xf5, 0x14, 0x4a, 0x16, 0x59, 0x14, 0xda, 0x0a, 0xe8, 0x59, 0x20, 0x91, 0x02, 0x3a, 0x0b,
    0x40, 0x01,
};

static const uint8_t every_activation_two_bits[] = {
    0x19, 0x05, 0x05, 0x45, 0xf9, 0x7f, 0x49, 0x80, 0xff, 0x07, 0xf8, 0xff, 0x17, 0x50, 0x12, 0x46,
    0x0a, 0x21, 0x4e, 0x01, 0x48, 0x46, 0x80, 0x45, 0x08, 0xa0, 0x15, 0x00, 0xe0, 0x19, 0x01, 0x80,
    0x48, 0x08, 0x00, 0x98, 0x05, 0x00, 0x00, 0x02,
};

static const uint8_t every_activation_trits[] = {
    0x21, 0x05, 0x05, 0x45, 0xf9, 0x7f, 0x49, 0x80, 0xff, 0x07, 0xf8, 0xff, 0x17, 0x50, 0x28, 0x4c,
    0x64, 0x61, 0x9d, 0x48, 0x06, 0x8a, 0x92, 0x3f, 0x15, 0x53, 0x63, 0x15, 0x00, 0x40, 0x00, 0x41,
    0x00, 0x15, 0x00, 0x02,
};

static const int16_t memory_inputs[] = {
    500, 32767, 500,
    -500, -32767, -500,
    0, 0, 0,
    -500, -32767, 500,
    3, 3, 3,
    500, -329, -500,
    -227, 143, 187,
    -500, 800, 66,
    -348, -2422, 500,
    -2, -2, 2,
    1, -1, 1,
    -500, -464, 500,
    -18, 97, -20,
    -256, 1717, 325,
    -500, 21781, -500,
    1, -5, 2,
    500, -7885, 500,
    31, 32, 18,
    -500, 943, -30,
    500, 2692, -500,
    31, -42, 48,
    -500, -707, 500,
    61, -57, 56,
    0, 2, 2,
};

static const int16_t memory_outputs[] = {
    2000, -300, 32767, 1024, 2000,
    1692, -300, -32767, -1024, 1692,
    308, -300, 0, 1024, 308,
    2308, -300, -32767, -319, 2308,
    320, -300, 3, 1024, 320,
    1692, -300, -329, 1024, 1692,
    1056, -300, 143, 965, 1056,
    572, -300, 800, -580, 572,
    2308, -300, -2422, -1024, 2308,
    316, -300, -2, -250, 316,
    312, -300, -1, -1024, 312,
    2308, -300, -464, -1024, 2308,
    228, -300, 97, -1024, 228,
    1608, -300, 1717, -1024, 1608,
    1692, -300, 21781, -1024, 1692,
    316, -300, -5, -1024, 316,
    2308, -300, -7885, -910, 2308,
    380, -300, 32, 1024, 380,
    188, -300, 943, -351, 188,
    1692, -300, 2692, -512, 1692,
    500, -300, -42, -1024, 500,
    2308, -300, -707, -1024, 2308,
    532, -300, -57, -1024, 532,
    316, -300, 2, -1024, 316,
};

static const uint8_t memory_bytes[] = {
    0x81, 0xf9, 0x07, 0xa2, 0xb8, 0x80, 0x89, 0x19, 0xc2, 0x72, 0x6a, 0x7f, 0x41, 0x16, 0xdc, 0xff,
    0x7f, 0xd2, 0x07, 0x0a, 0xe0, 0xb2, 0x00, 0x40, 0x00, 0x18, 0x05, 0x88, 0x05, 0x00, 0x04, 0x40,
    0x05, 0x00, 0x07, 0x80, 0xd5, 0x04, 0x03, 0x80, 0x0e, 0x00, 0x02, 0x00, 0x06, 0x80,
};

static const uint8_t memory_rice[] = {
    0x89, 0xf9, 0x07, 0xa2, 0xb8, 0x80, 0x89, 0x19, 0xc2, 0x72, 0x6a, 0x7f, 0x41, 0x16, 0xdc, 0xff,
    0x7f, 0xd2, 0x07, 0x0a, 0x09, 0xb8, 0x6c, 0x41, 0x66, 0xa3, 0x00, 0xa0, 0x83, 0x42, 0xa0, 0x9a,
    0x00, 0x07, 0x80, 0x04, 0x06, 0x00,
};

static const int16_t sum_inputs[] = {
    32767, 32767,
    -32767, -32767,
    0, 0,
    -32767, -32767,
    -17, 31,
    6536, 7282,
    1061, -329,
    3, -4,
    18325, 23955,
    -1016, 800,
    -3, -19,
    8838, -28759,
    -2, 2,
    1, -1,
    -114, -15,
    6156, 8054,
    -35, 195,
    -2, 13,
    -30, 21,
    -9831, -4201,
    380, -1058,
    1354, 2819,
    -124, 109,
    31, 32,
};

static const int16_t sum_outputs[] = {
    32767,
    -32767,
    0,
    -32767,
    14,
    13818,
    732,
    -1,
    32767,
    -216,
    -22,
    -19921,
    0,
    0,
    -129,
    14210,
    160,
    11,
    -9,
    -14032,
    -678,
    4173,
    -15,
    63,
};

static const uint8_t sum_bytes[] = {
    0x01, 0x00, 0x84, 0x20, 0x00, 0x07, 0x00, 0x81,
};

static const uint8_t sum_rice[] = {
    0x09, 0x00, 0x84, 0x20, 0x00, 0x07, 0xc0, 0x00,
};

static const uint8_t sum_planes[] = {
    0x11, 0x00, 0x84, 0x20, 0x00, 0x07, 0x03,
};

static const uint8_t sum_two_bits[] = {
    0x19, 0x00, 0x84, 0x20, 0x00, 0x07, 0x05,
};

static const uint8_t sum_trits[] = {
    0x21, 0x00, 0x84, 0x20, 0x00, 0x07, 0x6c,
};

static const struct known_answer {
    const char *name;
    const uint8_t *blob;
    size_t size;
    const int16_t *inputs;
    const int16_t *outputs;
    uint16_t num_inputs;
    uint16_t num_outputs;
} known_answers[] = {
    {"every_activation, bytes", every_activation_bytes, sizeof every_activation_bytes, every_activation_inputs,
     every_activation_outputs, 2, 10},
    {"every_activation, rice", every_activation_rice, sizeof every_activation_rice, every_activation_inputs,
     every_activation_outputs, 2, 10},
    {"every_activation, planes", every_activation_planes, sizeof every_activation_planes, every_activation_inputs,
     every_activation_outputs, 2, 10},
    {"every_activation, two_bits", every_activation_two_bits, sizeof every_activation_two_bits, every_activation_inputs,
     every_activation_outputs, 2, 10},
    {"every_activation, trits", every_activation_trits, sizeof every_activation_trits, every_activation_inputs,
     every_activation_outputs, 2, 10},
    {"memory, bytes", memory_bytes, sizeof memory_bytes, memory_inputs,
     memory_outputs, 3, 5},
    {"memory, rice", memory_rice, sizeof memory_rice, memory_inputs,
     memory_outputs, 3, 5},
    {"sum, bytes", sum_bytes, sizeof sum_bytes, sum_inputs,
     sum_outputs, 2, 1},
    {"sum, rice", sum_rice, sizeof sum_rice, sum_inputs,
     sum_outputs, 2, 1},
    {"sum, planes", sum_planes, sizeof sum_planes, sum_inputs,
     sum_outputs, 2, 1},
    {"sum, two_bits", sum_two_bits, sizeof sum_two_bits, sum_inputs,
     sum_outputs, 2, 1},
    {"sum, trits", sum_trits, sizeof sum_trits, sum_inputs,
     sum_outputs, 2, 1},
};
