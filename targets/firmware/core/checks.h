/* The second detector: a check for each kind of fault, which names what it finds.
 *
 * Rail and repeated-code checks find what no healthy sensor says; the motion check compares the variance of the
 * measured stroke with that of the predicted one; the loss check is a signed mean of log(measured / predicted).
 * Windows slide over integers, so that their sums are exact and never drift. */
#ifndef CHECKS_H
#define CHECKS_H

#include "calibration.h"

enum fault_kind { KIND_NONE = 0, KIND_OPEN, KIND_SHORT, KIND_HOLD, KIND_UNCALIBRATION };

typedef struct {
    int32_t log_ratio[MAX_LOSS_WINDOW]; /* a ring, 2^-20 */
    uint32_t loss_head;
    int32_t loss_sum;

    uint16_t measured[MAX_HOLD_WINDOW]; /* rings, in units of 5 um */
    uint16_t predicted[MAX_HOLD_WINDOW];
    uint32_t hold_head;
    uint32_t filled;
    uint32_t sum_measured, sum_predicted;
    uint64_t squares_measured, squares_predicted;

    uint32_t at_top, at_bottom; /* consecutive steps at a rail */
    uint32_t repeats;           /* consecutive steps with the value of the step before */
    float last_mm;
    float least_mm, most_mm; /* predicted since the value began to repeat */

    uint32_t alarm;
    enum fault_kind kind;
    uint32_t quiet; /* steps without a finding since the alarm */
} checks_state;

/* Takes a sample; returns the magnitude of the mean log ratio. */
float checks_step(checks_state *s, const calibration *c, float predicted_mm, float measured_mm);

/* Raises, keeps or clears the alarm, given what checks_step returned. */
uint32_t checks_decide(checks_state *s, const calibration *c, float loss);

#endif
