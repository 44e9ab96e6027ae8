/* SPDX-License-Identifier: MIT
 *
 * What generated C needs of avr-libc's header of this name, for a machine that has clang but no avr-libc.
 */
#ifndef BITNEAT_AVR_PGMSPACE_H
#define BITNEAT_AVR_PGMSPACE_H

#include <stdint.h>

#define PROGMEM __attribute__((section(".progmem.data")))

static inline uint8_t pgm_read_byte(const void *address)
{
    uint8_t value;
    __asm__("lpm %0, Z" : "=r"(value) : "z"((uint16_t)(uintptr_t)address));
    return value;
}

#endif
