#include "exponential.h"

#include <stdint.h>

/* e^x = 2^k e^r with |r| <= ln 2 / 2, and e^r = 1 + 2 r / (r coth(r / 2) - r), whose even series
 * r coth(r / 2) = 2 sum B_2n r^2n / (2n)! errs by less than 1e-17 after seven terms. */
double exponential(double x) {
    static const double over_ln2 = 0x1.71547652b82fep0, ln2_high = 0x1.62e42feep-1, ln2_low = 0x1.a39ef35793c76p-33;
    if (x > 708.0) x = 708.0;
    if (x < -708.0) x = -708.0;
    int32_t k = (int32_t)(x * over_ln2 + (x < 0.0 ? -0.5 : 0.5));
    double r = (x - (double)k * ln2_high) - (double)k * ln2_low;
    double s = r * r;
    double even = -691.0 / 653837184000.0;
    even = even * s + 1.0 / 23950080.0;
    even = even * s - 1.0 / 604800.0;
    even = even * s + 1.0 / 15120.0;
    even = even * s - 1.0 / 360.0;
    even = even * s + 1.0 / 6.0;
    even = even * s + 2.0;
    union {
        uint64_t bits;
        double value;
    } power = {(uint64_t)(k + 1023) << 52};
    return (1.0 + (r + r) / (even - r)) * power.value;
}
