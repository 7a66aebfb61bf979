#include "residual.h"

static float magnitude(float v) { return v < 0.0f ? -v : v; }

float residual_step(residual_state *s, const calibration *c, float predicted_mm, float measured_mm) {
    float divisor = magnitude(measured_mm);
    if (divisor < c->floor_mm) divisor = c->floor_mm; /* (V.1) has no value for a shorted sensor at 0 mm */
    s->deviation[s->head] = magnitude(predicted_mm - measured_mm) / divisor;
    s->head = s->head + 1u == c->window ? 0u : s->head + 1u;

    /* E_mean,L(i) = 1/L_s sum_k |(y_p - y_m) / y_m|. Summed anew each step: a running sum would drift. */
    float sum = 0.0f;
    const float *d = s->deviation;
    for (uint32_t k = c->window / 4u; k != 0u; k--) {
        float a = d[0], b = d[1];
        sum += a;
        a = d[2];
        sum += b;
        b = d[3];
        sum += a;
        d += 4;
        sum += b;
    }
    for (uint32_t k = c->window & 3u; k != 0u; k--) sum += *d++;
    return sum / (float)c->window;
}

uint32_t residual_decide(residual_state *s, const calibration *c, float residual) {
    /* Above T for n windows on end (Figure V.8); held at the limit, where it means "alarm". */
    uint32_t limit = c->multiple * c->window;
    s->above = residual > c->threshold ? (s->above < limit ? s->above + 1u : limit) : 0u;
    return s->above == limit;
}
