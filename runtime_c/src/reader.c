/* SPDX-License-Identifier: 0BSD */
#include "reader.h"

uint32_t bn_read(struct bn_reader *reader, unsigned width)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < width; i++) {
        const uint32_t byte = reader->position >> 3;
        if (byte >= reader->size) {
            reader->failed = 1;
            return 0;
        }
        value |= ((uint32_t)reader->blob[byte] >> (reader->position & 7U) & 1U) << i;
        reader->position++;
    }
    return value;
}

uint16_t bn_read_count(struct bn_reader *reader, uint16_t limit)
{
    uint32_t value = 0;
    for (unsigned shift = 0; shift <= 15; shift += 5) {
        const uint32_t group = bn_read(reader, 5);
        const uint32_t more = bn_read(reader, 1);
        value |= group << shift;
        if (value > limit) {
            break;
        }
        if (more == 0) {
            if (group == 0 && shift != 0) {
                break; /* a needless group: the same count has a shorter form */
            }
            return (uint16_t)value;
        }
    }
    reader->failed = 1;
    return 0;
}

uint32_t bn_read_rice(struct bn_reader *reader, unsigned k, uint32_t limit)
{
    uint32_t quotient = 0;
    while (bn_read(reader, 1) != 0) {
        quotient++;
        if (quotient << k > limit) {
            reader->failed = 1;
            return 0;
        }
    }
    const uint32_t value = (quotient << k) | bn_read(reader, k);
    if (value > limit) {
        reader->failed = 1;
        return 0;
    }
    return value;
}

int bn_read_padding(struct bn_reader *reader)
{
    return bn_read(reader, (8U - (reader->position & 7U)) & 7U) == 0;
}
