/* Residual generator (V.1) and decision maker (Figure V.8). */
#ifndef IFD_H
#define IFD_H

#include "calibration.h"

typedef struct {
    float deviation[MAX_WINDOW]; /* |y_p - y_m| / |y_m|, a ring of the last `window` samples */
    uint32_t head;
    uint32_t above; /* consecutive steps with the residual above the threshold */
    uint32_t steps;
} ifd_state;

typedef struct {
    float residual; /* E_mean,L, relative */
    uint32_t ready; /* warm-up is over */
    uint32_t alarm;
} ifd_verdict;

void ifd_init(ifd_state *s);
ifd_verdict ifd_step(ifd_state *s, const calibration *c, float predicted_mm, float measured_mm);

#endif
