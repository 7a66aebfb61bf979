#include "narx.h"

#include "frames.h"
#include "tansig.h"

void narx_init(narx_state *s, const calibration *c) {
    float y = (c->initial_mm - c->out_offset) * c->out_scale;
    for (uint32_t i = 0; i < MAX_REGRESSORS; i++) s->x[i] = 0.0f;
    for (uint32_t k = 0; k < c->delays; k++) s->x[c->inputs * c->delays + k] = y;
    for (uint32_t i = 0; i <= MAX_SHIFT; i++) s->ahead[i] = c->initial_mm;
    s->head = 0;
    s->primed = 0;
}

/* Rows of weights are read once, in order; four partial sums hide the latency of the adder. */
static float network(const float *x, const calibration *c) {
    uint32_t stride = calibration_stride(c);
    const float *w = c->weights;
    const float *out = w + c->neurons * (stride + 1u);
    float y = c->output_bias;
    for (uint32_t n = 0; n < c->neurons; n++) {
        float a0 = *w++, a1 = 0.0f, a2 = 0.0f, a3 = 0.0f;
        const float *xi = x;
        for (uint32_t k = stride; k != 0u; k -= 4u) {
            a0 += w[0] * xi[0];
            a1 += w[1] * xi[1];
            a2 += w[2] * xi[2];
            a3 += w[3] * xi[3];
            w += 4;
            xi += 4;
        }
        /* y = w2 . tansig(W1 x + b1) + b2 */
        y += out[n] * tansig((a0 + a1) + (a2 + a3));
    }
    return y;
}

static void push(float *row, uint32_t length, float value) {
    for (uint32_t k = length - 1u; k != 0u; k--) row[k] = row[k - 1u];
    row[0] = value;
}

float narx_step(narx_state *s, const calibration *c, const float *channel) {
    uint32_t d = c->delays;
    if (!s->primed) {
        for (uint32_t i = 0; i < c->inputs; i++) {
            const input_scaling *in = &c->input[i];
            for (uint32_t k = 0; k < d; k++) s->x[i * d + k] = (channel[in->channel] - in->offset) * in->gain;
        }
        s->primed = 1;
    }
    float y = network(s->x, c);
    float predicted = y * c->out_gain + c->out_offset;

    for (uint32_t i = 0; i < c->inputs; i++) {
        const input_scaling *in = &c->input[i];
        push(&s->x[i * d], d, (channel[in->channel] - in->offset) * in->gain);
    }
    if (c->feedback == FEEDBACK_MEASURED) y = (channel[CHANNEL_REAR_STROKE_MM] - c->out_offset) * c->out_scale;
    push(&s->x[c->inputs * d], d, y);

    /* With shift k the network answers for k samples ahead: keep the answer until its instant. */
    s->ahead[s->head] = predicted;
    s->head = s->head == c->shift ? 0u : s->head + 1u;
    return s->ahead[s->head];
}
