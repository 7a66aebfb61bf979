#include "ifd.h"

void ifd_init(ifd_state *s) {
    for (uint32_t i = 0; i < MAX_WINDOW; i++) s->deviation[i] = 0.0f;
    s->head = 0;
    s->above = 0;
    s->steps = 0;
}

static float magnitude(float v) { return v < 0.0f ? -v : v; }

ifd_verdict ifd_step(ifd_state *s, const calibration *c, float predicted_mm, float measured_mm) {
    ifd_verdict v;
    float divisor = magnitude(measured_mm);
    if (divisor < c->floor_mm) divisor = c->floor_mm; /* (V.1) has no value for a shorted sensor at 0 mm */
    s->deviation[s->head] = magnitude(predicted_mm - measured_mm) / divisor;
    s->head = s->head + 1u == c->window ? 0u : s->head + 1u;

    /* E_mean,L(i) = 1/L_s sum_k |(y_p - y_m) / y_m|. Summed anew each step: a running sum would drift. */
    float sum = 0.0f;
    for (uint32_t k = 0; k < c->window; k++) sum += s->deviation[k];
    v.residual = sum / (float)c->window;

    if (s->steps < c->warmup) {
        s->steps++;
        s->above = 0;
        v.ready = 0;
    } else {
        v.ready = 1;
        /* Above T for n windows on end (Figure V.8); held at the limit, where it means "alarm". */
        uint32_t limit = c->multiple * c->window;
        s->above = v.residual > c->threshold ? (s->above < limit ? s->above + 1u : limit) : 0u;
        v.alarm = s->above == limit;
        return v;
    }
    v.alarm = 0;
    return v;
}
