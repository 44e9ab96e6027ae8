/* SPDX-License-Identifier: MIT */
#include "network.h"

#include <math.h>

/* Written as Python's min and max compare, so that a NaN goes the same way. */
static double at_most(double z, double most)
{
    return z < most ? z : most;
}

static double at_least(double z, double least)
{
    return z > least ? z : least;
}

static double clip(double z, double bound)
{
    return at_least(at_most(z, bound), -bound);
}

static double activate(int32_t activation, double z)
{
    switch (activation) {
    case NETWORK_CLAMPED:
        return clip(z, 1.0);
    case NETWORK_RELU:
        return z > 0.0 ? z : 0.0;
    case NETWORK_ABS:
        return fabs(z);
    case NETWORK_HAT:
        return at_least(1.0 - fabs(z), 0.0);
    case NETWORK_STEP:
        return z > 0.0 ? 1.0 : 0.0;
    case NETWORK_TANH:
        return tanh(clip(2.5 * z, 60.0));
    case NETWORK_SIGMOID:
        return 1.0 / (1.0 + exp(-clip(5.0 * z, 60.0)));
    case NETWORK_SIN:
        return sin(clip(5.0 * z, 60.0));
    case NETWORK_GAUSS: {
        const double c = clip(z, 3.4);
        return exp(-5.0 * (c * c));
    }
    default:
        return z;
    }
}

void network_step(const struct network *network, double *signals, double *outputs)
{
    for (int32_t n = 0; n < network->num_nodes; ++n) {
        double total = 0.0;
        for (int32_t i = network->first_link[n]; i < network->first_link[n + 1]; ++i) {
            total += signals[network->source[i]] * network->weight[i];
        }
        signals[network->num_inputs + n] =
            activate(network->activation[n], network->bias[n] + network->response[n] * total);
    }
    for (int32_t i = 0; i < network->num_outputs; ++i) {
        outputs[i] = signals[network->output[i]];
    }
}
