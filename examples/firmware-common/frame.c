/* SPDX-License-Identifier: 0BSD */
#include "frame.h"

enum { DIGITS = 4 };

/* The value of a hexadecimal digit, or 16. */
static uint8_t digit_value(char c)
{
    if (c >= '0' && c <= '9') {
        return (uint8_t)(c - '0');
    }
    if (c >= 'a' && c <= 'f') {
        return (uint8_t)(c - 'a' + 10);
    }
    return 16;
}

enum frame_status frame_receive(struct frame *frame, char c, int16_t *signals, uint16_t count)
{
    const uint16_t expected = (uint16_t)(count * DIGITS);
    const uint8_t value = digit_value(c);
    enum frame_status status = FRAME_MORE;
    if (c == '\n') {
        status = !frame->bad && frame->digits == expected ? FRAME_COMPLETE : FRAME_BAD;
        frame->digits = 0;
        frame->bad = 0;
    } else if (value > 15 || frame->digits >= expected) {
        frame->bad = 1;
    } else {
        frame->word = (uint16_t)((uint16_t)(frame->word << 4) | value);
        frame->digits++;
        if (frame->digits % DIGITS == 0) {
            /* In range whatever the sign, without a conversion that the compiler defines. */
            signals[frame->digits / DIGITS - 1] = (int16_t)((int32_t)(frame->word ^ 0x8000U) - 32768);
        }
    }
    return status;
}

void frame_send(const int16_t *signals, uint16_t count, void (*put)(char c))
{
    for (uint16_t i = 0; i < count; i++) {
        const uint16_t word = (uint16_t)signals[i];
        for (int shift = 12; shift >= 0; shift -= 4) {
            put("0123456789abcdef"[word >> shift & 15U]);
        }
    }
    put('\n');
}
