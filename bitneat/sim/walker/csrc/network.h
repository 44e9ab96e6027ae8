/* SPDX-License-Identifier: MIT
 *
 * Float networks, as of bitneat.network: the same bits as the Python there, given the same C library.
 */
#ifndef BITNEAT_WALKER_NETWORK_H
#define BITNEAT_WALKER_NETWORK_H

#include <stdint.h>

/* In the order of bitneat.network.ACTIVATIONS. */
enum network_activation {
    NETWORK_IDENTITY,
    NETWORK_CLAMPED,
    NETWORK_RELU,
    NETWORK_ABS,
    NETWORK_HAT,
    NETWORK_STEP,
    NETWORK_TANH,
    NETWORK_SIGMOID,
    NETWORK_SIN,
    NETWORK_GAUSS
};

/* Nodes in topological order. Node n has the links first_link[n] .. first_link[n + 1] - 1. */
struct network {
    const double *bias, *response, *weight; /* by node, by node, by link */
    const int32_t *activation;              /* an enum network_activation by node */
    const int32_t *first_link;              /* num_nodes + 1 of them */
    const int32_t *source;                  /* by link: an input, or num_inputs plus an earlier node */
    const int32_t *output;                  /* signals */
    int32_t num_inputs, num_nodes, num_outputs;
};

/* `signals` holds the inputs, and room for a number for each node behind them. */
void network_step(const struct network *network, double *signals, double *outputs);

#endif
