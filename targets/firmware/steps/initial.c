/* STEP 2: the scheme as a translation of the script leaves it (section V.5.2, figures V.15 and V.17, left).
 *
 * An array for each quantity of the script, a loop for each operation on it, counters as small as they may be; the
 * delayed inputs are scaled anew in every step; single precision, but for the exponential, which is the library's.
 * The practices of STEP 4 that can be had one by one are macros, to be measured one by one (docs/firmware.md):
 * SINGLE, WIDE, JAMMED, DOWN. */
#include "../core/frames.h"
#include "../core/narx.h"
#include "../core/residual.h"
#include "../core/tansig.h"
#include "exponential.h"

#ifdef WIDE
typedef uint32_t counter;
#else
typedef uint8_t counter;
#endif

#ifdef DOWN
#define EACH(k, n) for (counter k = (counter)(n); k-- != 0u;)
#else
#define EACH(k, n) for (counter k = 0; k < (n); k++)
#endif

static float xd1[MAX_DELAYS][MAX_INPUTS]; /* delayed inputs, physical, the newest first */
static float xd2[MAX_DELAYS];             /* delayed outputs, mm */
static float x_offset[MAX_INPUTS], x_gain[MAX_INPUTS];
static float y_offset, y_gain;
static const float minimum = -1.0f;

static float tap1[MAX_INPUTS * MAX_DELAYS], tap2[MAX_DELAYS]; /* scaled, in the order of the weights */
static float iw1[MAX_NEURONS][MAX_INPUTS * MAX_DELAYS], iw2[MAX_NEURONS][MAX_DELAYS];
static float bias[MAX_NEURONS], lw[MAX_NEURONS];
#ifndef JAMMED
static float c1[MAX_DELAYS][MAX_INPUTS], b1[MAX_DELAYS][MAX_INPUTS], p1[MAX_DELAYS][MAX_INPUTS];
static float c2[MAX_DELAYS], b2[MAX_DELAYS];
static float fv0[MAX_NEURONS], fv1[MAX_NEURONS];
#endif

static float transfer(float n) {
#ifdef SINGLE
    return tansig_of(n, tansig_read());
#else
    return (2.0f / (1.0f + (float)exponential(-2.0f * n))) - 1.0f;
#endif
}

/* Both as mapminmax has them: (x - xmin) * gain + ymin. */
static void scale(const calibration *c) {
#ifdef JAMMED
    EACH(d, c->delays) {
        EACH(i, c->inputs) {
            tap1[i * c->delays + d] = (xd1[d][i] - x_offset[i]) * x_gain[i] + minimum;
        }
        tap2[d] = (xd2[d] - y_offset) * y_gain + minimum;
    }
#else
    EACH(d, c->delays) {
        EACH(i, c->inputs) { c1[d][i] = xd1[d][i] - x_offset[i]; }
    }
    EACH(d, c->delays) {
        EACH(i, c->inputs) { b1[d][i] = c1[d][i] * x_gain[i]; }
    }
    EACH(d, c->delays) {
        EACH(i, c->inputs) { p1[d][i] = b1[d][i] + minimum; }
    }
    EACH(d, c->delays) {
        EACH(i, c->inputs) { tap1[i * c->delays + d] = p1[d][i]; }
    }
    EACH(d, c->delays) { c2[d] = xd2[d] - y_offset; }
    EACH(d, c->delays) { b2[d] = c2[d] * y_gain; }
    EACH(d, c->delays) { tap2[d] = b2[d] + minimum; }
#endif
}

/* y = LW tansig(IW1 x + IW2 y + b1) + b2 (Appendix.1) */
static float network(const calibration *c) {
    counter taps = (counter)(c->inputs * c->delays);
    float sum = 0.0f;
#ifdef JAMMED
    EACH(n, c->neurons) {
        float a = bias[n];
        EACH(k, taps) { a += iw1[n][k] * tap1[k]; }
        EACH(k, c->delays) { a += iw2[n][k] * tap2[k]; }
        sum += lw[n] * transfer(a);
    }
#else
    EACH(n, c->neurons) {
        fv0[n] = 0.0f;
        EACH(k, taps) { fv0[n] += iw1[n][k] * tap1[k]; }
    }
    EACH(n, c->neurons) {
        fv1[n] = 0.0f;
        EACH(k, c->delays) { fv1[n] += iw2[n][k] * tap2[k]; }
    }
    EACH(n, c->neurons) { sum += lw[n] * transfer((fv0[n] + fv1[n]) + bias[n]); }
#endif
    return sum + c->output_bias;
}

static void delay(const calibration *c, const float *channel) {
    for (counter d = (counter)(c->delays - 1u); d != 0u; d--) {
        EACH(i, c->inputs) { xd1[d][i] = xd1[d - 1u][i]; }
        xd2[d] = xd2[d - 1u];
    }
    EACH(i, c->inputs) { xd1[0][i] = channel[c->input[i].channel]; }
}

void narx_init(narx_state *s, const calibration *c) {
    EACH(i, c->inputs) {
        x_gain[i] = c->input[i].gain;
        x_offset[i] = c->input[i].offset + minimum / x_gain[i];
    }
    const float *w = c->weights;
    for (uint32_t n = 0; n < c->neurons; n++) {
        uint32_t taps = c->inputs * c->delays;
        bias[n] = w[0];
        for (uint32_t k = 0; k < taps; k++) iw1[n][k] = w[1u + k];
        for (uint32_t k = 0; k < c->delays; k++) iw2[n][k] = w[1u + taps + k];
        w += calibration_stride(c) + 1u;
    }
    for (uint32_t n = 0; n < c->neurons; n++) lw[n] = w[n];
    y_gain = c->out_scale;
    y_offset = c->out_offset + minimum / y_gain;
    EACH(d, c->delays) { xd2[d] = c->initial_mm; }
    for (uint32_t i = 0; i <= MAX_SHIFT; i++) s->ahead[i] = c->initial_mm;
    s->head = 0;
    s->primed = 0;
}

float narx_step(narx_state *s, const calibration *c, const float *channel) {
    if (!s->primed) {
        EACH(d, c->delays) {
            EACH(i, c->inputs) { xd1[d][i] = channel[c->input[i].channel]; }
        }
        s->primed = 1;
    }
    scale(c);
    float predicted = (network(c) - minimum) / y_gain + y_offset;

    delay(c, channel);
    xd2[0] = c->feedback == FEEDBACK_MEASURED ? channel[CHANNEL_REAR_STROKE_MM] : predicted;

    s->ahead[s->head] = predicted;
    s->head = s->head == c->shift ? 0u : s->head + 1u;
    return s->ahead[s->head];
}

float residual_step(residual_state *s, const calibration *c, float predicted_mm, float measured_mm) {
    for (counter k = (counter)(c->window - 1u); k != 0u; k--) s->deviation[k] = s->deviation[k - 1u];
    float divisor = measured_mm < 0.0f ? -measured_mm : measured_mm;
    if (divisor < c->floor_mm) divisor = c->floor_mm;
    float difference = predicted_mm - measured_mm;
    s->deviation[0] = (difference < 0.0f ? -difference : difference) / divisor;
    float sum = 0.0f;
    EACH(k, c->window) { sum += s->deviation[k]; }
    return sum / (float)c->window;
}

uint32_t residual_decide(residual_state *s, const calibration *c, float residual) {
    uint32_t limit = c->multiple * c->window;
    s->above = residual > c->threshold ? (s->above < limit ? s->above + 1u : limit) : 0u;
    return s->above == limit;
}
