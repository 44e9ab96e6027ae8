/* SPDX-License-Identifier: 0BSD
 *
 * Known-answer self-test, then a step at every tick of the timer for which an observation has arrived.
 */
#include <stdint.h>

#include "board.h"
#include "frame.h"
#include "tiny.h"

int tiny_selftest(void);

enum { LISTENING, OBSERVED, GARBLED };

/* Written by the interrupt while LISTENING, read by the loop otherwise. */
static int16_t observation[TINY_NUM_INPUTS];
static volatile uint8_t state;

void application_receive(char c)
{
    static struct frame frame;
    if (state == LISTENING) {
        switch (frame_receive(&frame, c, observation, TINY_NUM_INPUTS)) {
        case FRAME_COMPLETE:
            state = OBSERVED;
            break;
        case FRAME_BAD:
            state = GARBLED;
            break;
        case FRAME_MORE:
            break;
        }
    }
}

static void put_line(const char *text)
{
    while (*text != '\0') {
        board_put(*text++);
    }
    board_put('\n');
}

int main(void)
{
    int16_t action[TINY_NUM_OUTPUTS];
    board_start();
    if (tiny_selftest() != 0) {
        put_line("self-test failed");
        for (;;) {
            board_wait_for_tick();
        }
    }
    put_line("tiny ready");
    for (;;) {
        board_wait_for_tick();
        if (state == OBSERVED) {
            tiny_step(observation, action);
            state = LISTENING;
            frame_send(action, TINY_NUM_OUTPUTS, board_put);
        } else if (state == GARBLED) {
            state = LISTENING;
            put_line("?");
        }
    }
}
