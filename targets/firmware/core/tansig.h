/* tanh in single precision: odd rational function, |relative error| < 6e-9 before rounding.
 *
 * Numerator and denominator of degree four in x^2, weighted minimax on [0, 7.9] by Lawson's iteration;
 * past 7.9 float tanh is 1 to half a unit in the last place. Only +, *, / in a fixed order: the same bits
 * wherever floats are IEEE 754 and nothing is contracted. */
#ifndef TANSIG_H
#define TANSIG_H

static inline float tansig(float x) {
    x = x > 7.9f ? 7.9f : x;
    x = x < -7.9f ? -7.9f : x;
    float s = x * x;
    float p = 0x1.090ecap-26f;
    p = p * s + 0x1.717e6p-16f;
    p = p * s + 0x1.d51ba2p-9f;
    p = p * s + 0x1.13781p-3f;
    p = p * s + 1.0f;
    float q = 0x1.cda70cp-21f;
    q = q * s + 0x1.66ffbp-12f;
    q = q * s + 0x1.ad227cp-6f;
    q = q * s + 0x1.df115ap-2f;
    q = q * s + 1.0f;
    return x * p / q;
}

#endif
