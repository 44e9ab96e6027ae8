/* SPDX-License-Identifier: 0BSD
 *
 * Checks everything that the interpreter relies on. Linked only where it is used: a firmware that carries its own controller
 * needs none of it.
 */
#include "bitneat/runtime.h"
#include "format.h"
#include "reader.h"

#define SUM_MAX UINT32_C(0x7FFFFFFF)

/* What is known while the body is scanned. The workspace holds the largest magnitude of every slot. */
struct scan {
    const struct bn_controller *c;
    int16_t *limits;
    struct bn_reader reader;
    struct bn_reader fields; /* of the encoding trits, which keeps them apart */
    unsigned count_k;
    unsigned gap_k;
    uint8_t trits;
    uint8_t place;
    uint8_t check_sums; /* the second pass, when all limits are known */
};

/* One node while it is scanned. */
struct node {
    uint32_t end;      /* the slot of the node itself: its links read slots below */
    uint32_t sum;      /* the largest magnitude of its sum so far */
    uint32_t previous; /* 1 + the last link's slot and shift as one number */
    uint32_t links;
};

static int16_t one(const struct bn_controller *c)
{
    return (int16_t)(1 << c->frac_bits);
}

static enum bn_status check_inputs(const struct bn_controller *c, int16_t *limits)
{
    struct bn_reader reader = {c->blob, c->size, c->classes_at, 0};
    const uint32_t indices_at = c->classes_at + (uint32_t)c->num_classes * (BN_SCALE_BITS + BN_LIMIT_BITS);
    unsigned width = 0;
    while (c->num_classes > (UINT32_C(1) << width)) {
        width++;
    }
    for (uint16_t i = 0; i < c->num_inputs; i++) {
        limits[i] = BN_SIGNAL_MAX;
        if (c->num_classes != 0) {
            reader.position = indices_at + (uint32_t)i * width;
            const uint32_t index = bn_read(&reader, width);
            if (index >= c->num_classes) {
                return BN_ERROR_RANGE;
            }
            reader.position = c->classes_at + index * (BN_SCALE_BITS + BN_LIMIT_BITS) + BN_SCALE_BITS;
            limits[i] = (int16_t)bn_read(&reader, BN_LIMIT_BITS);
            if (limits[i] == 0) {
                return BN_ERROR_RANGE;
            }
        }
    }
    return BN_OK;
}

/* The slot of an input or node, or num_slots if there is no such signal. */
static uint16_t slot_of(const struct bn_controller *c, uint32_t signal)
{
    if (signal < c->num_inputs) {
        return (uint16_t)signal;
    }
    const uint32_t slot = signal - c->num_inputs + c->first_node;
    return (uint16_t)(slot < c->num_slots ? slot : c->num_slots);
}

static enum bn_status check_lists(const struct bn_controller *c, int16_t *limits)
{
    struct bn_reader reader = {c->blob, c->size, c->delayed_at, 0};
    uint32_t previous = 0;
    for (uint16_t i = 0; i < c->num_state; i++) {
        const uint32_t signal = bn_read(&reader, c->signal_width);
        if (slot_of(c, signal) == c->num_slots) {
            return BN_ERROR_RANGE;
        }
        if (i != 0 && signal <= previous) {
            return BN_ERROR_ORDER;
        }
        previous = signal;
        limits[c->first_delayed + i] = limits[slot_of(c, signal)];
    }
    reader.position = c->outputs_at;
    for (uint16_t i = 0; c->has_map && i < c->num_outputs; i++) {
        const int constant = bn_read(&reader, 1) != 0;
        const uint32_t value = bn_read(&reader, constant ? 16U : c->signal_width);
        if (constant ? value == 0x8000U : slot_of(c, value) == c->num_slots) {
            return BN_ERROR_RANGE;
        }
    }
    return BN_OK;
}

static enum bn_status add_link(const struct scan *s, struct node *node, uint32_t slot, uint32_t shift)
{
    const struct bn_controller *c = s->c;
    const uint32_t key = (slot << 3 | shift) + 1U;
    if (slot >= node->end || (c->bias_mode == BN_BIAS_TERNARY && slot == c->num_inputs && shift != 0)) {
        return BN_ERROR_RANGE;
    }
    if (key <= node->previous) {
        return BN_ERROR_ORDER;
    }
    node->previous = key;
    node->links++;
    node->sum += (uint32_t)s->limits[slot] << shift;
    return s->check_sums && node->sum > SUM_MAX ? BN_ERROR_SUM : BN_OK;
}

static enum bn_status scan_bytes(struct scan *s, struct node *node)
{
    const struct bn_controller *c = s->c;
    const uint32_t zero_slot = (uint32_t)c->first_delayed - 1U;
    const unsigned shift_width = c->has_shifts ? 3U : 0U;
    uint32_t last;
    do {
        const uint32_t slot = bn_read(&s->reader, 8U * c->record_bytes - 2U - shift_width);
        const uint32_t shift = bn_read(&s->reader, shift_width);
        const uint32_t negative = bn_read(&s->reader, 1);
        last = bn_read(&s->reader, 1);
        if (s->reader.failed != 0U) {
            return BN_ERROR_SIZE;
        }
        if (c->has_empty && slot == zero_slot && (node->links != 0 || shift != 0 || negative != 0 || last == 0)) {
            return BN_ERROR_ORDER;
        }
        const enum bn_status status = add_link(s, node, slot, shift);
        if (status != BN_OK) {
            return status;
        }
    } while (last == 0);
    return BN_OK;
}

static enum bn_status scan_rice(struct scan *s, struct node *node)
{
    const struct bn_controller *c = s->c;
    const uint32_t step = c->has_shifts ? 0U : 1U;
    uint32_t left = bn_read_rice(&s->reader, s->count_k, (uint32_t)c->num_slots * 8U);
    uint32_t slot = 0U - step;
    while (left-- != 0) {
        slot += step + bn_read_rice(&s->reader, s->gap_k, c->num_slots);
        const uint32_t shift = bn_read(&s->reader, c->has_shifts ? 3U : 0U);
        (void)bn_read(&s->reader, 1);
        if (s->reader.failed != 0U) {
            return BN_ERROR_SIZE;
        }
        if (c->has_empty && slot == (uint32_t)c->first_delayed - 1U) {
            return BN_ERROR_ORDER;
        }
        const enum bn_status status = add_link(s, node, slot, shift);
        if (status != BN_OK) {
            return status;
        }
    }
    return s->reader.failed ? BN_ERROR_SIZE : BN_OK;
}

/* The weight code of the next slot: 0 none, 1 plus, 2 minus, 3 for one that does not exist. */
static uint32_t next_code(struct scan *s)
{
    if (s->c->encoding == BN_PLANES) {
        return bn_read(&s->reader, 1);
    }
    if (s->c->encoding == BN_TWO_BITS) {
        return bn_read(&s->reader, 2);
    }
    uint32_t code = 0;
    if (s->place == 0) {
        s->trits = (uint8_t)bn_read(&s->reader, 8);
        s->place = 81;
    }
    while (s->trits >= s->place) {
        s->trits = (uint8_t)(s->trits - s->place);
        code++;
    }
    s->place = s->place == 81 ? 27 : s->place == 27 ? 9 : s->place == 9 ? 3 : s->place == 3 ? 1 : 0;
    return code > 2 ? 3 : code;
}

static enum bn_status scan_dense(struct scan *s, struct node *node)
{
    const struct bn_controller *c = s->c;
    for (uint32_t slot = 0; slot < node->end; slot++) {
        const uint32_t code = next_code(s);
        if (s->reader.failed != 0U) {
            return BN_ERROR_SIZE;
        }
        if (code == 3 || (code != 0 && c->has_empty && slot == (uint32_t)c->first_delayed - 1U)) {
            return BN_ERROR_RANGE;
        }
        if (code != 0) {
            const enum bn_status status = add_link(s, node, slot, 0);
            if (status != BN_OK) {
                return status;
            }
        }
    }
    if (c->encoding == BN_PLANES) {
        for (uint32_t i = 0; i < node->links; i++) {
            (void)bn_read(&s->reader, 1);
        }
    }
    return s->reader.failed ? BN_ERROR_SIZE : BN_OK;
}

/* Reads a node's fields; gives its gain, and sets its limit and the magnitude of its bias. */
static enum bn_status scan_fields(struct scan *s, struct node *node, int *gain)
{
    const struct bn_controller *c = s->c;
    struct bn_reader *reader = c->encoding == BN_TRITS ? &s->fields : &s->reader;
    const uint32_t index = bn_read(reader, c->activation_bits);
    *gain = c->min_gain + (int)bn_read(reader, c->gain_bits);
    const uint32_t bias = bn_read(reader, c->bias_width);
    if (index >= c->num_activations || *gain > BN_MAX_GAIN) {
        return BN_ERROR_RANGE;
    }
    if (c->bias_width != 0) {
        const uint32_t sign = UINT32_C(1) << (c->bias_width - 1);
        node->sum = (bias & sign) != 0 ? (sign - (bias & (sign - 1U))) : bias;
    }
    if (c->encoding == BN_BYTES && !bn_read_padding(reader)) {
        return BN_ERROR_ORDER;
    }
    const uint8_t activation = c->activations[index];
    const int bounded = activation != BN_IDENTITY && activation != BN_RELU && activation != BN_ABS;
    s->limits[node->end] = bounded ? one(c) : (int16_t)BN_SIGNAL_MAX;
    return reader->failed ? BN_ERROR_SIZE : BN_OK;
}

static enum bn_status scan_node(struct scan *s, uint32_t slot)
{
    struct node node = {slot, 0, 0, 0};
    int gain = 0;
    enum bn_status status = scan_fields(s, &node, &gain);
    if (status == BN_OK) {
        status = s->c->encoding == BN_BYTES  ? scan_bytes(s, &node)
                 : s->c->encoding == BN_RICE ? scan_rice(s, &node)
                                             : scan_dense(s, &node);
    }
    if (status == BN_OK && s->check_sums && node.sum > SUM_MAX >> (gain > 0 ? gain : 0)) {
        return BN_ERROR_SUM;
    }
    return status;
}

static enum bn_status scan_body(struct scan *s)
{
    const struct bn_controller *c = s->c;
    const uint32_t start = (uint32_t)(c->body - c->blob) << 3;
    s->reader = (struct bn_reader){c->blob, c->size, start, 0};
    s->fields = s->reader;
    s->place = 0;
    s->trits = 0;
    if (c->encoding == BN_RICE) {
        s->count_k = (unsigned)bn_read(&s->reader, 3);
        s->gap_k = (unsigned)bn_read(&s->reader, 3);
    }
    if (c->encoding == BN_TRITS) {
        s->reader.position += c->num_nodes * (uint32_t)(c->activation_bits + c->gain_bits + c->bias_width);
        if (s->reader.position > (uint32_t)c->size << 3) {
            return BN_ERROR_SIZE;
        }
        if (!bn_read_padding(&s->reader)) {
            return BN_ERROR_ORDER;
        }
    }
    for (uint32_t slot = c->first_node; slot < c->num_slots; slot++) {
        const enum bn_status status = scan_node(s, slot);
        if (status != BN_OK) {
            return status;
        }
    }
    if (s->trits != 0 || !bn_read_padding(&s->reader)) {
        return BN_ERROR_ORDER;
    }
    return s->reader.failed || s->reader.position != (uint32_t)c->size << 3 ? BN_ERROR_SIZE : BN_OK;
}

enum bn_status bn_validate(const struct bn_controller *c, int16_t *workspace)
{
    struct scan s = {c, workspace, {c->blob, c->size, 0, 0}, {c->blob, c->size, 0, 0}, 0, 0, 0, 0, 0};
    enum bn_status status = check_inputs(c, workspace);
    for (uint32_t slot = c->num_inputs; slot < c->first_node; slot++) {
        workspace[slot] = BN_SIGNAL_MAX;
    }
    if (c->bias_mode == BN_BIAS_TERNARY) {
        workspace[c->num_inputs] = one(c);
    }
    if (c->has_empty != 0U) {
        workspace[c->first_delayed - 1] = 0;
    }
    if (status == BN_OK) {
        status = scan_body(&s);
    }
    /* A delayed link may read a node that comes later, so its limit is only known after the first pass. */
    if (status == BN_OK) {
        status = check_lists(c, workspace);
    }
    if (status == BN_OK) {
        s.check_sums = 1;
        status = scan_body(&s);
    }
    return status;
}
