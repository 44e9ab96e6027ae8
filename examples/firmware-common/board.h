/* SPDX-License-Identifier: 0BSD
 *
 * What a board does for the application, and the other way round.
 */
#ifndef BOARD_H
#define BOARD_H

enum { TICKS_PER_SECOND = 500 };

/* Sets the serial line to 115200 baud and starts the timer; interrupts are on afterwards. */
void board_start(void);

/* Sleeps until the timer's next tick. Returns at once if one has passed since the last call. */
void board_wait_for_tick(void);

/* Sends a character, and waits until there is room for it. */
void board_put(char c);

/* The application's: a board calls it with each character that comes in, from its interrupt. */
void application_receive(char c);

#endif
