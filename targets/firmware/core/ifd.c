#include "ifd.h"

void ifd_init(ifd_state *s) { *s = (ifd_state){.steps = 0}; }

ifd_verdict ifd_step(ifd_state *s, const calibration *c, float predicted_mm, float measured_mm) {
    ifd_verdict v = {.kind = KIND_NONE};
    v.residual = c->detector == DETECTOR_CHECKS ? checks_step(&s->detector.checks, c, predicted_mm, measured_mm)
                                                : residual_step(&s->detector.residual, c, predicted_mm, measured_mm);
    if (s->steps < c->warmup) {
        s->steps++;
        return v;
    }
    v.ready = 1;
    if (c->detector == DETECTOR_CHECKS) {
        v.alarm = checks_decide(&s->detector.checks, c, v.residual);
        v.kind = s->detector.checks.kind;
    } else {
        v.alarm = residual_decide(&s->detector.residual, c, v.residual);
    }
    return v;
}
