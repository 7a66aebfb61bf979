/* The decision maker alone, over a whole ride: a verdict for each pair of strokes. */
#include "decide.h"

#include <string.h>

void decide(const calibration *c, uint32_t n, const float *predicted, const float *measured, ifd_verdict *out) {
    ifd_state s;
    memset(&s, 0xA5, sizeof s); /* SRAM holds anything before ifd_init */
    ifd_init(&s);
    for (uint32_t i = 0; i < n; i++) out[i] = ifd_step(&s, c, predicted[i], measured[i]);
}
