/* Instrument fault detection (section V.1): one of the detectors, the warm-up, and what they all say. */
#ifndef IFD_H
#define IFD_H

#include "calibration.h"
#include "checks.h"
#include "residual.h"

typedef struct {
    union {
        checks_state checks; /* the largest first: an initialiser clears no more than the first member */
        residual_state residual;
    } detector;
    uint32_t steps;
} ifd_state;

typedef struct {
    float residual; /* what the detector compares with its threshold, relative */
    uint32_t ready; /* warm-up is over */
    uint32_t alarm;
    enum fault_kind kind; /* what the alarm names; KIND_NONE if the detector cannot tell */
} ifd_verdict;

void ifd_init(ifd_state *s);
ifd_verdict ifd_step(ifd_state *s, const calibration *c, float predicted_mm, float measured_mm);

#endif
