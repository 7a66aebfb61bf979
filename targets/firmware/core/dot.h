/* Rows of the weight matrix times the regressors, as the Cortex-M4 likes it.
 *
 * Loads from one memory right after each other take a cycle each, any other load two: so eight regressors (SRAM)
 * serve three rows, and eight weights of a row (flash) are loaded at once. Four partial sums, and all products
 * before the first sum, hide the latency of multiplier and adder. The order of the sums is part of the result's
 * bits: term k goes to partial sum k mod 4. */
#ifndef DOT_H
#define DOT_H

#include <stdint.h>

typedef struct {
    float a, b, c, d;
} four;

static inline four four_load(const float *p) { return (four){p[0], p[1], p[2], p[3]}; }
static inline four four_times(four u, four v) { return (four){u.a * v.a, u.b * v.b, u.c * v.c, u.d * v.d}; }
static inline four four_plus(four u, four v) { return (four){u.a + v.a, u.b + v.b, u.c + v.c, u.d + v.d}; }
static inline float four_sum(four u) { return (u.a + u.b) + (u.c + u.d); }

static inline four dot_eight(four sum, const float *w, four x, four y) {
    four p = four_load(w), q = four_load(w + 4);
    p = four_times(p, x);
    q = four_times(q, y);
    sum = four_plus(sum, p);
    return four_plus(sum, q);
}

/* row: bias and `stride` weights, a multiple of four. */
static inline float dot_one(const float *row, const float *x, uint32_t stride) {
    four s = {*row++, 0.0f, 0.0f, 0.0f};
    for (uint32_t k = stride / 8u; k != 0u; k--) {
        s = dot_eight(s, row, four_load(x), four_load(x + 4));
        x += 8;
        row += 8;
    }
    if (stride & 4u) s = four_plus(s, four_times(four_load(row), four_load(x)));
    return four_sum(s);
}

/* Three rows that follow each other. */
static inline void dot_three(const float *row, const float *x, uint32_t stride, float *result) {
    const float *w0 = row, *w1 = w0 + stride + 1u, *w2 = w1 + stride + 1u;
    four s0 = {*w0++, 0.0f, 0.0f, 0.0f}, s1 = {*w1++, 0.0f, 0.0f, 0.0f}, s2 = {*w2++, 0.0f, 0.0f, 0.0f};
    for (uint32_t k = stride / 8u; k != 0u; k--) {
        four u = four_load(x), v = four_load(x + 4);
        s0 = dot_eight(s0, w0, u, v);
        s1 = dot_eight(s1, w1, u, v);
        s2 = dot_eight(s2, w2, u, v);
        x += 8;
        w0 += 8;
        w1 += 8;
        w2 += 8;
    }
    if (stride & 4u) {
        four u = four_load(x);
        s0 = four_plus(s0, four_times(four_load(w0), u));
        s1 = four_plus(s1, four_times(four_load(w1), u));
        s2 = four_plus(s2, four_times(four_load(w2), u));
    }
    /* four_sum of each, by turns. */
    float a0 = s0.a + s0.b, a1 = s1.a + s1.b, a2 = s2.a + s2.b;
    float b0 = s0.c + s0.d, b1 = s1.c + s1.d, b2 = s2.c + s2.d;
    a0 += b0;
    a1 += b1;
    a2 += b2;
    result[0] = a0;
    result[1] = a1;
    result[2] = a2;
}

#endif
