/* SPDX-License-Identifier: 0BSD
 *
 * Runs a firmware in simavr with its USART0 on this program's standard input and output, until the input ends.
 */
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

enum { CYCLES_BETWEEN_POLLS = 1000 };

static int room; /* whether the USART takes another character */

static void sent(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    const char c = (char)value;
    (void)irq;
    (void)unused;
    if (write(STDOUT_FILENO, &c, 1) != 1) {
        exit(1);
    }
}

static void has_room(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    room = 1;
}

static void has_no_room(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    room = 0;
}

/* Passes on a character if one is waiting. Returns 0 when the input has ended. */
static int feed(avr_irq_t *input)
{
    struct pollfd in = {STDIN_FILENO, POLLIN, 0};
    unsigned char c;
    if (!room || poll(&in, 1, 0) <= 0) {
        return 1;
    }
    if (read(STDIN_FILENO, &c, 1) != 1) {
        return 0;
    }
    avr_raise_irq(input, c);
    return 1;
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware;
    avr_t *avr;
    avr_irq_t *input;
    uint32_t flags = 0;
    avr_cycle_count_t next = 0;
    memset(&firmware, 0, sizeof firmware);
    if (argc != 2 || elf_read_firmware(argv[1], &firmware) != 0) {
        fprintf(stderr, "usage: serial FIRMWARE.elf\n");
        return 2;
    }
    avr = avr_make_mcu_by_name("atmega328p");
    if (avr == NULL || avr_init(avr) != 0) {
        fprintf(stderr, "serial: this simavr knows no atmega328p\n");
        return 2;
    }
    avr->frequency = 16000000;
    avr_load_firmware(avr, &firmware);

    /* simavr's own echo of what the firmware sends, and its sleeping while the chip idles, would be in the way. */
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);

    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), sent, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), has_room, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), has_no_room, NULL);
    input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);

    for (;;) {
        const int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "serial: the firmware stopped\n");
            return 1;
        }
        if (avr->cycle >= next) {
            next = avr->cycle + CYCLES_BETWEEN_POLLS;
            if (!feed(input)) {
                return 0;
            }
        }
    }
}
