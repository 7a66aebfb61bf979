/* The soft sensor of section III.1: a NARX network, one hidden layer of tansig neurons (Appendix.1). */
#ifndef NARX_H
#define NARX_H

#include "calibration.h"

typedef struct {
    /* Regressors, newest first in each row of `delays`: the inputs' rows, the fed-back stroke's, zeros up to the
     * stride; from x[newest] on. One step down the array makes every one of them a sample older. Each is stored
     * twice, a stride apart, so that they are always in one piece. */
    float x[2u * MAX_REGRESSORS];
    uint32_t newest;
    float ahead[MAX_SHIFT + 1u]; /* predictions waiting for their instant, mm */
    uint32_t head;
    uint32_t primed; /* the delay lines have seen an input */
} narx_state;

void narx_init(narx_state *s, const calibration *c);

/* Predicts the stroke of this instant, mm, then takes in this instant's inputs.
 * channel: physical values by enum channel; fed_back is the measured stroke where the calibration says so. */
float narx_step(narx_state *s, const calibration *c, const float *channel);

#endif
