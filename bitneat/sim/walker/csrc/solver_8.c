/* SPDX-License-Identifier: MIT */
#define LANES 8
#include "solver.c"
