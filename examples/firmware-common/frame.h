/* SPDX-License-Identifier: 0BSD
 *
 * Signals over a serial line: four hexadecimal digits each, in two's complement, a line feed at the end.
 */
#ifndef FRAME_H
#define FRAME_H

#include <stdint.h>

enum frame_status { FRAME_MORE, FRAME_COMPLETE, FRAME_BAD };

/* A frame on its way in. All zero is an empty one. */
struct frame {
    uint16_t digits;
    uint16_t word;
    uint8_t bad;
};

/* 1. `signals` has room for `count` signals, the same in every call until a frame is complete.
 * Takes one character. After FRAME_COMPLETE `signals` holds a frame; after FRAME_BAD the line was none, and the next begins. */
enum frame_status frame_receive(struct frame *frame, char c, int16_t *signals, uint16_t count);

/* Sends `count` signals as one frame. */
void frame_send(const int16_t *signals, uint16_t count, void (*put)(char c));

#endif
