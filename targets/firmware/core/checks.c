#include "checks.h"

#define ONE 1048576.0f     /* of log_ratio */
#define PER_MM 200.0f      /* of the motion check's integers */
#define MOST_MM 163.0f     /* so that a square fits 32 bits */
#define MOST_Z 0.15f       /* a ratio of 1.35: what is beyond says no more, and must not outvote the other checks */

/* log(a / b) = 2 atanh z, z = (a - b) / (a + b); for |z| <= 0.15 three terms of its series err by less than 1e-6. */
static float log_ratio(float measured, float predicted, float floor) {
    float a = measured > floor ? measured : floor;
    float b = predicted > floor ? predicted : floor;
    float z = (a - b) / (a + b);
    z = z > MOST_Z ? MOST_Z : z;
    z = z < -MOST_Z ? -MOST_Z : z;
    float s = z * z;
    return 2.0f * z * (1.0f + s * (1.0f / 3.0f + s * 0.2f));
}

static uint16_t quantised(float mm) {
    mm = mm > 0.0f ? mm : 0.0f;
    mm = mm < MOST_MM ? mm : MOST_MM;
    return (uint16_t)(mm * PER_MM + 0.5f);
}

static void loss(checks_state *s, const calibration *c, float predicted, float measured) {
    int32_t r = (int32_t)(log_ratio(measured, predicted, c->loss_floor_mm) * ONE);
    s->loss_sum += r - s->log_ratio[s->loss_head];
    s->log_ratio[s->loss_head] = r;
    s->loss_head = s->loss_head + 1u == c->loss_window ? 0u : s->loss_head + 1u;
}

static void motion(checks_state *s, const calibration *c, float predicted, float measured) {
    uint32_t m = quantised(measured), p = quantised(predicted);
    uint32_t m_old = s->measured[s->hold_head], p_old = s->predicted[s->hold_head];
    s->sum_measured += m - m_old;
    s->sum_predicted += p - p_old;
    s->squares_measured += (uint64_t)(m * m) - (uint64_t)(m_old * m_old);
    s->squares_predicted += (uint64_t)(p * p) - (uint64_t)(p_old * p_old);
    s->measured[s->hold_head] = (uint16_t)m;
    s->predicted[s->hold_head] = (uint16_t)p;
    s->hold_head = s->hold_head + 1u == c->hold_window ? 0u : s->hold_head + 1u;
    if (s->filled < c->hold_window) s->filled++;
}

static void rails(checks_state *s, const calibration *c, float predicted, float measured) {
    /* A suspension at its stop is at the rail, too: what the model expects there does not count. */
    uint32_t top = measured >= c->rail_high_mm, bottom = measured <= c->rail_low_mm;
    s->at_top = top && predicted < c->rail_high_mm - c->rail_gap_mm ? s->at_top + 1u : 0u;
    s->at_bottom = bottom && predicted > c->rail_low_mm + c->rail_gap_mm ? s->at_bottom + 1u : 0u;
    if (measured == s->last_mm && !top && !bottom) {
        s->repeats++;
        if (predicted < s->least_mm) s->least_mm = predicted;
        if (predicted > s->most_mm) s->most_mm = predicted;
    } else {
        s->repeats = 0u;
        s->least_mm = s->most_mm = predicted;
    }
    s->last_mm = measured;
}

float checks_step(checks_state *s, const calibration *c, float predicted_mm, float measured_mm) {
    rails(s, c, predicted_mm, measured_mm);
    motion(s, c, predicted_mm, measured_mm);
    loss(s, c, predicted_mm, measured_mm);
    float mean = (float)s->loss_sum / (ONE * (float)c->loss_window);
    return mean < 0.0f ? -mean : mean;
}

/* n^2 variance = n sum x^2 - (sum x)^2, exact. */
static uint64_t scatter(uint32_t n, uint64_t squares, uint32_t sum) { return n * squares - (uint64_t)sum * sum; }

static enum fault_kind finding(const checks_state *s, const calibration *c, float mean) {
    if (s->at_top >= c->rail_steps) return KIND_OPEN;
    if (s->at_bottom >= c->rail_steps) return KIND_SHORT;
    if (s->repeats >= c->repeat_steps && s->most_mm - s->least_mm >= c->repeat_motion_mm) return KIND_HOLD;

    uint32_t n = c->hold_window;
    uint64_t measured = scatter(n, s->squares_measured, s->sum_measured);
    uint64_t predicted = scatter(n, s->squares_predicted, s->sum_predicted);
    float still = (float)n * c->still_mm * PER_MM;
    uint32_t moves = s->filled == n && (float)predicted >= still * still;
    if (moves && (float)measured < c->hold_ratio * c->hold_ratio * (float)predicted) return KIND_HOLD;

    if (!(mean > c->loss_threshold)) return KIND_NONE;
    /* A held stroke off the mean is soon far off on average, too: it moves less than half of what it should. */
    return moves && measured < predicted / 4u ? KIND_HOLD : KIND_UNCALIBRATION;
}

uint32_t checks_decide(checks_state *s, const calibration *c, float mean) {
    enum fault_kind found = finding(s, c, mean);
    if (found != KIND_NONE) {
        if (!s->alarm) s->kind = found;
        s->alarm = 1u;
        s->quiet = 0u;
    } else if (s->alarm && ++s->quiet >= c->heal_steps) {
        s->alarm = 0u;
        s->kind = KIND_NONE;
    }
    return s->alarm;
}
