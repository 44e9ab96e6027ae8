/* SPDX-License-Identifier: MIT */
#define LANES 16
#include "solver.c"
