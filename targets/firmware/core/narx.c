#include "narx.h"

#include "dot.h"
#include "frames.h"
#include "tansig.h"

/* The regressor k places into the window. */
static void put(narx_state *s, uint32_t stride, uint32_t k, float value) {
    uint32_t at = s->newest + k;
    if (at >= stride) at -= stride;
    s->x[at] = s->x[at + stride] = value;
}

/* A row of regressors before the first step. */
static void fill(narx_state *s, const calibration *c, uint32_t row, float value) {
    float *x = &s->x[row * c->delays], *copy = x + calibration_stride(c);
    for (uint32_t k = 0; k < c->delays; k++) x[k] = copy[k] = value;
}

void narx_init(narx_state *s, const calibration *c) {
    for (uint32_t k = 0; k < 2u * MAX_REGRESSORS; k++) s->x[k] = 0.0f;
    fill(s, c, c->inputs, (c->initial_mm - c->out_offset) * c->out_scale);
    for (uint32_t i = 0; i <= MAX_SHIFT; i++) s->ahead[i] = c->initial_mm;
    s->newest = 0;
    s->head = 0;
    s->primed = 0;
}

/* y = w2 . tansig(W1 x + b1) + b2 */
static float network(const float *x, const calibration *c) {
    uint32_t stride = calibration_stride(c), n = c->neurons;
    float hidden[MAX_NEURONS];
    float *h = hidden;
    const float *row = c->weights;
    for (; n >= 3u; n -= 3u) {
        dot_three(row, x, stride, h);
        row += 3u * (stride + 1u);
        h += 3;
    }
    for (; n != 0u; n--) {
        *h++ = dot_one(row, x, stride);
        row += stride + 1u;
    }
    float y = c->output_bias;
    tansig_terms terms = tansig_read();
    h = hidden;
    for (n = c->neurons; n != 0u; n--) y += *row++ * tansig_of(*h++, terms);
    return y;
}

static float scaled(const input_scaling *in, const float *channel) {
    return (channel[in->channel] - in->offset) * in->gain;
}

float narx_step(narx_state *s, const calibration *c, const float *channel) {
    if (!s->primed) { /* the first input has always been: no step at start */
        for (uint32_t i = 0; i < c->inputs; i++) fill(s, c, i, scaled(&c->input[i], channel));
        s->primed = 1;
    }
    float y = network(&s->x[s->newest], c);
    float predicted = y * c->out_gain + c->out_offset;

    uint32_t stride = calibration_stride(c), d = c->delays, k = 0;
    s->newest = (s->newest == 0u ? stride : s->newest) - 1u;
    for (uint32_t i = 0; i < c->inputs; i++) {
        put(s, stride, k, scaled(&c->input[i], channel));
        k += d;
    }
    if (c->feedback == FEEDBACK_MEASURED) y = (channel[CHANNEL_REAR_STROKE_MM] - c->out_offset) * c->out_scale;
    put(s, stride, k, y);
    k += d;
    if (k < stride) put(s, stride, k, 0.0f); /* no regressor grows into the padding */

    /* With shift k the network answers for k samples ahead: keep the answer until its instant. */
    s->ahead[s->head] = predicted;
    s->head = s->head == c->shift ? 0u : s->head + 1u;
    return s->ahead[s->head];
}
