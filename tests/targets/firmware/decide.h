#ifndef DECIDE_H
#define DECIDE_H

#include "ifd.h"

void decide(const calibration *c, uint32_t n, const float *predicted, const float *measured, ifd_verdict *out);

#endif
