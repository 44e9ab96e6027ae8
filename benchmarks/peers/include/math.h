/* SPDX-License-Identifier: MIT */
#pragma once
#include <stddef.h>
#define INFINITY __builtin_inff()
#define NAN __builtin_nanf("")
#define isnan(x) __builtin_isnan(x)
float expf(float x);
float logf(float x);
float tanhf(float x);
float floorf(float x);
float fminf(float x, float y);
float fmaxf(float x, float y);
