/* SPDX-License-Identifier: 0BSD
 *
 * Reads the bits of a blob that is not trusted: past its end it gives zeros and remembers that it did.
 */
#ifndef BITNEAT_READER_H
#define BITNEAT_READER_H

#include <stddef.h>
#include <stdint.h>

struct bn_reader {
    const uint8_t *blob;
    size_t size;
    uint32_t position; /* in bits */
    uint8_t failed;    /* a read went past the end */
};

/* The next `width` (0..32) bits, the lowest first. */
uint32_t bn_read(struct bn_reader *reader, unsigned width);

/* A count of at most `limit`, in groups of five bits; anything else fails the reader. */
uint16_t bn_read_count(struct bn_reader *reader, uint16_t limit);

/* A number in the Rice code of parameter k of at most `limit`; anything else fails the reader. */
uint32_t bn_read_rice(struct bn_reader *reader, unsigned k, uint32_t limit);

/* Goes on to the next whole byte; returns whether the bits between were zero. */
int bn_read_padding(struct bn_reader *reader);

#endif
