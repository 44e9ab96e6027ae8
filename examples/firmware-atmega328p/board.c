/* SPDX-License-Identifier: 0BSD
 *
 * An ATmega328P at 16 MHz, as on an Arduino Uno: USART0, and timer 1 for the ticks.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdint.h>

#include "board.h"

enum { PRESCALER = 64 };

static volatile uint8_t ticks;

ISR(TIMER1_COMPA_vect)
{
    ticks++;
}

ISR(USART_RX_vect)
{
    application_receive((char)UDR0);
}

void board_start(void)
{
    UBRR0 = 16; /* 115200 baud with double speed */
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << RXCIE0 | 1 << RXEN0 | 1 << TXEN0;

    OCR1A = F_CPU / PRESCALER / TICKS_PER_SECOND - 1;
    TCCR1B = 1 << WGM12 | 1 << CS11 | 1 << CS10; /* a match clears the counter */
    TIMSK1 = 1 << OCIE1A;

    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
}

void board_wait_for_tick(void)
{
    static uint8_t seen;
    for (;;) {
        cli();
        if (seen != ticks) {
            break;
        }
        sleep_enable();
        sei(); /* takes effect after the next instruction, so no tick is slept through */
        sleep_cpu();
        sleep_disable();
    }
    seen = ticks;
    sei();
}

void board_put(char c)
{
    while ((UCSR0A & 1 << UDRE0) == 0) {
    }
    UDR0 = (uint8_t)c;
}
