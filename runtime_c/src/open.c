/* SPDX-License-Identifier: 0BSD
 *
 * Reads the header of a blob; docs/packed-format.md has its fields in this order.
 */
#include "bitneat/runtime.h"
#include "format.h"
#include "reader.h"

/* Bits that number `count` things. */
static uint8_t width_of(uint32_t count)
{
    uint8_t width = 0;
    while (count > (UINT32_C(1) << width)) {
        width++;
    }
    return width;
}

static enum bn_status read_activations(struct bn_controller *c, struct bn_reader *reader)
{
    if (bn_read(reader, 1) == 0) {
        c->activations[0] = (uint8_t)bn_read(reader, 4);
        c->num_activations = 1;
        return c->activations[0] < BN_NUM_ACTIVATIONS ? BN_OK : BN_ERROR_VERSION;
    }
    const uint32_t mask = bn_read(reader, BN_NUM_ACTIVATIONS);
    c->num_activations = 0;
    for (uint8_t code = 0; code < BN_NUM_ACTIVATIONS; code++) {
        if ((mask >> code & 1U) != 0) {
            c->activations[c->num_activations++] = code;
        }
    }
    return BN_OK;
}

static enum bn_status read_gains(struct bn_controller *c, struct bn_reader *reader)
{
    const int min_gain = (int)bn_read(reader, 4) + BN_MIN_GAIN;
    c->min_gain = (int8_t)min_gain;
    c->gain_bits = (uint8_t)bn_read(reader, 3);
    return min_gain <= BN_MAX_GAIN && c->gain_bits <= 4 ? BN_OK : BN_ERROR_RANGE;
}

/* Skips the lists of the header and keeps where they start. */
static uint16_t skip_lists(struct bn_controller *c, struct bn_reader *reader, int has_delays, int has_classes)
{
    uint16_t num_delayed = 0;
    c->delayed_at = 0;
    if (has_delays != 0) {
        num_delayed = bn_read_count(reader, (uint16_t)(c->num_inputs + c->num_nodes));
        c->delayed_at = reader->position;
        for (uint16_t i = 0; i < num_delayed; i++) {
            (void)bn_read(reader, c->signal_width);
        }
    }
    c->outputs_at = reader->position;
    if (c->has_map != 0U) {
        for (uint16_t i = 0; i < c->num_outputs; i++) {
            (void)bn_read(reader, bn_read(reader, 1) != 0 ? 16U : c->signal_width);
        }
    }
    c->num_classes = 0;
    c->classes_at = reader->position;
    if (has_classes != 0) {
        c->num_classes = bn_read_count(reader, c->num_inputs);
        c->classes_at = reader->position;
        for (uint16_t i = 0; i < c->num_classes; i++) {
            (void)bn_read(reader, BN_SCALE_BITS + BN_LIMIT_BITS);
        }
        const unsigned width = width_of(c->num_classes);
        for (uint16_t i = 0; i < c->num_inputs; i++) {
            (void)bn_read(reader, width);
        }
        if (c->num_classes == 0) {
            reader->failed = 1;
        }
    }
    return num_delayed;
}

static void lay_out(struct bn_controller *c, uint16_t num_delayed)
{
    c->num_state = num_delayed;
    c->first_delayed = (uint16_t)(c->num_inputs + (c->bias_mode == BN_BIAS_TERNARY) + c->has_empty);
    c->first_node = (uint16_t)(c->first_delayed + num_delayed);
    c->num_slots = (uint16_t)(c->first_node + c->num_nodes);
    c->workspace_length = (uint16_t)(c->num_slots + (c->has_map ? c->num_outputs : 0));
    const unsigned slot_bits = width_of(c->num_slots);
    c->record_bytes = (uint8_t)((slot_bits + (c->has_shifts ? 3U : 0U) + 2U + 7U) >> 3);
    c->activation_bits = width_of(c->num_activations);
    const unsigned slot_width = 8U * c->record_bytes - 2U - (c->has_shifts ? 3U : 0U);
    c->slot_mask = (uint16_t)(slot_width >= 16 ? 0xFFFFU : (UINT32_C(1) << slot_width) - 1U);
}

enum bn_status bn_open(struct bn_controller *c, const uint8_t *blob, size_t size)
{
    struct bn_reader reader = {blob, size, 0, 0};
    if (size > (size_t)(UINT32_MAX >> 3)) { /* places in a blob are counted in bits, in 32 of them */
        return BN_ERROR_SIZE;
    }
    c->blob = blob;
    c->size = size;
    if (bn_read(&reader, 3) != BN_FORMAT_VERSION) {
        return reader.failed ? BN_ERROR_SIZE : BN_ERROR_VERSION;
    }
    c->encoding = (uint8_t)bn_read(&reader, 3);
    c->frac_bits = (uint8_t)(bn_read(&reader, 4) + BN_MIN_FRAC_BITS);
    c->bias_mode = (uint8_t)bn_read(&reader, 2);
    c->has_shifts = (uint8_t)bn_read(&reader, 1);
    const int has_delays = bn_read(&reader, 1) != 0;
    c->has_empty = (uint8_t)bn_read(&reader, 1);
    c->has_map = (uint8_t)bn_read(&reader, 1);
    const int has_classes = bn_read(&reader, 1) != 0;
    if (c->encoding >= BN_NUM_ENCODINGS || c->bias_mode > BN_BIAS_GENERAL || (c->has_shifts && c->encoding > BN_RICE)) {
        return BN_ERROR_VERSION;
    }
    c->num_inputs = bn_read_count(&reader, BN_MAX_SIGNALS);
    c->num_nodes = bn_read_count(&reader, (uint16_t)(BN_MAX_SIGNALS - c->num_inputs));
    c->num_outputs = bn_read_count(&reader, BN_MAX_OUTPUTS);
    c->signal_width = width_of((uint32_t)c->num_inputs + c->num_nodes);
    enum bn_status status = read_activations(c, &reader);
    if (status == BN_OK) {
        status = read_gains(c, &reader);
    }
    c->bias_width = c->bias_mode == BN_BIAS_GENERAL ? (uint8_t)bn_read(&reader, 6) : 0;
    if (reader.failed != 0U) {
        return BN_ERROR_SIZE;
    }
    if (status != BN_OK) {
        return status;
    }
    if (c->num_inputs == 0 || c->num_outputs == 0 || c->frac_bits > BN_MAX_FRAC_BITS || c->bias_width > 32 ||
        (c->bias_mode == BN_BIAS_GENERAL && c->bias_width == 0) || (!c->has_map && c->num_outputs > c->num_nodes) ||
        (c->num_activations == 0 && c->num_nodes != 0)) {
        return BN_ERROR_RANGE;
    }
    const uint16_t num_delayed = skip_lists(c, &reader, has_delays, has_classes);
    if (!bn_read_padding(&reader)) {
        return BN_ERROR_ORDER;
    }
    if (reader.failed != 0U) {
        return BN_ERROR_SIZE;
    }
    lay_out(c, num_delayed);
    c->body = blob + (reader.position >> 3);
    return has_delays && num_delayed == 0 ? BN_ERROR_RANGE : BN_OK;
}
