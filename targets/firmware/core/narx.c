#include "narx.h"

#include "dot.h"
#include "frames.h"
#include "tansig.h"

static void put(narx_state *s, uint32_t stride, uint32_t k, float value) {
    uint32_t at = s->newest + k;
    if (at >= stride) at -= stride;
    s->x[at] = s->x[at + stride] = value;
}

void narx_init(narx_state *s, const calibration *c) {
    uint32_t stride = calibration_stride(c);
    float y = (c->initial_mm - c->out_offset) * c->out_scale;
    for (uint32_t k = 0; k < stride; k++) {
        uint32_t fed_back = k >= c->inputs * c->delays && k < (c->inputs + 1u) * c->delays;
        s->newest = 0;
        put(s, stride, k, fed_back ? y : 0.0f);
    }
    for (uint32_t i = 0; i <= MAX_SHIFT; i++) s->ahead[i] = c->initial_mm;
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

/* The first input has always been: no step at start. */
static void prime(narx_state *s, const calibration *c, const float *channel) {
    uint32_t stride = calibration_stride(c);
    for (uint32_t i = 0; i < c->inputs; i++) {
        float v = scaled(&c->input[i], channel);
        for (uint32_t k = 0; k < c->delays; k++) put(s, stride, i * c->delays + k, v);
    }
    s->primed = 1;
}

float narx_step(narx_state *s, const calibration *c, const float *channel) {
    if (!s->primed) prime(s, c, channel);
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
    if (k < stride) put(s, stride, k, 0.0f); /* the oldest one has left */

    /* With shift k the network answers for k samples ahead: keep the answer until its instant. */
    s->ahead[s->head] = predicted;
    s->head = s->head == c->shift ? 0u : s->head + 1u;
    return s->ahead[s->head];
}
