/* tanh in single precision: odd rational function, |relative error| < 6e-9 before rounding.
 *
 * Numerator and denominator of degree four in x^2, weighted minimax on [0, 7.9] by Lawson's iteration;
 * past 7.9 float tanh is 1 to half a unit in the last place. Only +, *, / in a fixed order: the same bits
 * wherever floats are IEEE 754 and nothing is contracted. */
#ifndef TANSIG_H
#define TANSIG_H

#include <stdint.h>

/* Factors of x^8 to x^2 in numerator and denominator; that of 1 is 1. */
typedef struct {
    float p4, p3, p2, p1, q4, q3, q2, q1;
} tansig_terms;

/* Behind a volatile pointer, or the compiler would know the numbers, and fetch each anew at every use: as the
 * accumulator of a VMLA, three cycles more a term than in a register. Read before a loop, they stay in registers. */
static inline tansig_terms tansig_read(void) {
    static const tansig_terms terms = {
        .p4 = 0x1.090ecap-26f,
        .p3 = 0x1.717e6p-16f,
        .p2 = 0x1.d51ba2p-9f,
        .p1 = 0x1.13781p-3f,
        .q4 = 0x1.cda70cp-21f,
        .q3 = 0x1.66ffbp-12f,
        .q2 = 0x1.ad227cp-6f,
        .q1 = 0x1.df115ap-2f,
    };
    const tansig_terms *const volatile at = &terms;
    const tansig_terms *from = at;
    return (tansig_terms){from->p4, from->p3, from->p2, from->p1, from->q4, from->q3, from->q2, from->q1};
}

static inline float tansig_of(float x, tansig_terms t) {
    /* A comparison of integers costs half of one of floats. */
    union {
        float value;
        uint32_t bits;
    } u = {x};
    const int32_t most = 0x40FCCCCD; /* 7.9 */
    int32_t room = most - (int32_t)(u.bits & 0x7FFFFFFFu);
    if (room < 0) {
        u.bits += (uint32_t)room; /* 7.9 with the sign of x */
        x = u.value;
    }
    float s = x * x;
    /* Numerator and denominator by turns: neither waits for its own last result. */
    float p = t.p4 * s;
    float q = t.q4 * s;
    p += t.p3;
    q += t.q3;
    p *= s;
    q *= s;
    p += t.p2;
    q += t.q2;
    p *= s;
    q *= s;
    p += t.p1;
    q += t.q1;
    p *= s;
    q *= s;
    p += 1.0f;
    q += 1.0f;
    p *= x;
    return p / q;
}

#endif
