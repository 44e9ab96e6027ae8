/* SPDX-License-Identifier: MIT
 *
 * What candidates want of a C library, as small as can be. The functions that only stand in a switch that is never taken
 * (exp, log and tanh in emlearn) do nothing, so they cost a candidate less than in a real program.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
    unsigned char *t = to;
    const unsigned char *f = from;
    while (count-- != 0) {
        *t++ = *f++;
        __asm__ volatile("" : : : "memory"); /* or the loop becomes a call of itself */
    }
    return to;
}

void *memset(void *to, int value, size_t count)
{
    unsigned char *t = to;
    while (count-- != 0) {
        *t++ = (unsigned char)value;
        __asm__ volatile("" : : : "memory");
    }
    return to;
}

float expf(float x)
{
    return x;
}

float logf(float x)
{
    return x;
}

float tanhf(float x)
{
    return x;
}

/* Towards minus infinity, for magnitudes of less than 2^31. */
float floorf(float x)
{
    const float whole = (float)(int)x;
    return whole > x ? whole - 1.0f : whole;
}

float fminf(float x, float y)
{
    return x < y ? x : y;
}

float fmaxf(float x, float y)
{
    return x > y ? x : y;
}
