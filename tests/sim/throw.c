/* SPDX-License-Identifier: MIT
 *
 * What the tests add to the simulator: a hand that throws.
 */
#include "simulator.h"

void throw_body(struct environment *environments, int32_t body, float x, float y, float turn);

void throw_body(struct environment *environments, int32_t body, float x, float y, float turn)
{
    struct body *thrown = &environments->walker.body[body];
    thrown->v = vec_make(x, y);
    thrown->w = turn;
}
