/* SPDX-License-Identifier: 0BSD
 *
 * The numbers of the packed format that more than one part of the runtime needs.
 */
#ifndef BITNEAT_FORMAT_H
#define BITNEAT_FORMAT_H

enum { BN_BYTES = 0, BN_RICE = 1, BN_PLANES = 2, BN_TWO_BITS = 3, BN_TRITS = 4, BN_NUM_ENCODINGS = 5 };

enum { BN_BIAS_NONE = 0, BN_BIAS_TERNARY = 1, BN_BIAS_GENERAL = 2 };

enum {
    BN_FORMAT_VERSION = 1,
    BN_MAX_SIGNALS = 16383,
    BN_MAX_OUTPUTS = 1024,
    BN_SIGNAL_MAX = 32767,
    BN_MIN_GAIN = -7,
    BN_MAX_GAIN = 7,
    BN_MIN_FRAC_BITS = 4,
    BN_MAX_FRAC_BITS = 12,
    BN_SCALE_BITS = 5,
    BN_LIMIT_BITS = 15
};

/* The codes of the activations whose result is not bounded by One. */
enum { BN_IDENTITY = 0, BN_RELU = 2, BN_ABS = 3 };

#endif
