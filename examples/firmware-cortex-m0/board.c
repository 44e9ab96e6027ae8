/* SPDX-License-Identifier: 0BSD
 *
 * The nRF51822 of a BBC micro:bit (version 1): UART0 on the pins of its USB interface, TIMER0 for the ticks.
 */
#include <stdint.h>

#include "board.h"

struct register_of {
    volatile uint32_t word;
};

static volatile uint32_t *at(uint32_t base, uint32_t offset)
{
    return &((struct register_of *)(uintptr_t)(base + offset))->word;
}

enum {
    UART = 0x40002000,
    UART_STARTRX = 0x000,
    UART_STARTTX = 0x008,
    UART_RXDRDY = 0x108,
    UART_TXDRDY = 0x11c,
    UART_INTENSET = 0x304,
    UART_ENABLE = 0x500,
    UART_PSELTXD = 0x50c,
    UART_PSELRXD = 0x514,
    UART_RXD = 0x518,
    UART_TXD = 0x51c,
    UART_BAUDRATE = 0x524,

    TIMER = 0x40008000,
    TIMER_START = 0x000,
    TIMER_COMPARE0 = 0x140,
    TIMER_SHORTS = 0x200,
    TIMER_INTENSET = 0x304,
    TIMER_BITMODE = 0x508,
    TIMER_PRESCALER = 0x510,
    TIMER_CC0 = 0x540,

    UART_IRQ = 2,
    TIMER_IRQ = 8,
    TX_PIN = 24,
    RX_PIN = 25,
};

static const uint32_t NVIC_ISER = UINT32_C(0xe000e100);

static volatile uint32_t ticks;

void uart_handler(void);
void timer_handler(void);

void uart_handler(void)
{
    while (*at(UART, UART_RXDRDY) != 0) {
        *at(UART, UART_RXDRDY) = 0;
        application_receive((char)*at(UART, UART_RXD));
    }
}

void timer_handler(void)
{
    *at(TIMER, TIMER_COMPARE0) = 0;
    ticks++;
}

void board_start(void)
{
    *at(UART, UART_PSELTXD) = TX_PIN;
    *at(UART, UART_PSELRXD) = RX_PIN;
    *at(UART, UART_BAUDRATE) = UINT32_C(0x01d7e000); /* 115200 */
    *at(UART, UART_ENABLE) = 4;
    *at(UART, UART_INTENSET) = UINT32_C(1) << 2; /* RXDRDY */
    *at(UART, UART_STARTTX) = 1;
    *at(UART, UART_STARTRX) = 1;

    *at(TIMER, TIMER_BITMODE) = 3;   /* 32 bits */
    *at(TIMER, TIMER_PRESCALER) = 4; /* 16 MHz / 2^4 */
    *at(TIMER, TIMER_CC0) = UINT32_C(1000000) / TICKS_PER_SECOND;
    *at(TIMER, TIMER_SHORTS) = 1;                   /* a match clears the counter */
    *at(TIMER, TIMER_INTENSET) = UINT32_C(1) << 16; /* COMPARE0 */
    *at(TIMER, TIMER_START) = 1;

    *at(NVIC_ISER, 0) = UINT32_C(1) << UART_IRQ | UINT32_C(1) << TIMER_IRQ;
}

void board_wait_for_tick(void)
{
    static uint32_t seen;
    while (seen == ticks) {
        __asm__ volatile("wfi");
    }
    seen = ticks;
}

void board_put(char c)
{
    *at(UART, UART_TXDRDY) = 0;
    *at(UART, UART_TXD) = (uint8_t)c;
    while (*at(UART, UART_TXDRDY) == 0) {
    }
}
