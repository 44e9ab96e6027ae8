/* SPDX-License-Identifier: 0BSD
 *
 * Vectors of a Cortex-M0 and what must be done before main.
 */
#include <stdint.h>

extern uint32_t stack_top[], data_start[], data_end[], data_image[], bss_start[], bss_end[];

int main(void);
void uart_handler(void);
void timer_handler(void);
void reset_handler(void);

static void stop(void)
{
    for (;;) {
    }
}

union vector {
    uint32_t *stack;
    void (*handler)(void);
};

__attribute__((section(".vectors"), used)) static const union vector vectors[16 + 9] = {
    [0] = {.stack = stack_top},
    [1] = {.handler = reset_handler},
    [2] = {.handler = stop}, /* NMI */
    [3] = {.handler = stop}, /* hard fault */
    [11] = {.handler = stop},
    [14] = {.handler = stop},
    [15] = {.handler = stop},
    [16 + 2] = {.handler = uart_handler},
    [16 + 8] = {.handler = timer_handler},
};

void reset_handler(void)
{
    const uint32_t *from = data_image;
    for (volatile uint32_t *to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (volatile uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
    main();
    stop();
}
