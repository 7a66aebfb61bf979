/* The thesis's scheme: residual generator (V.1) and decision maker (Figure V.8). */
#ifndef RESIDUAL_H
#define RESIDUAL_H

#include "calibration.h"

typedef struct {
    float deviation[MAX_WINDOW]; /* |y_p - y_m| / |y_m|, a ring of the last `window` samples */
    uint32_t head;
    uint32_t above; /* consecutive steps with the residual above the threshold */
} residual_state;

/* Takes a sample; returns E_mean,L, relative. */
float residual_step(residual_state *s, const calibration *c, float predicted_mm, float measured_mm);

/* Whether the residual has been above T for n windows on end. */
uint32_t residual_decide(residual_state *s, const calibration *c, float residual);

#endif
