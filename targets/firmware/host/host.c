/* What a host needs beside the core: the size of the state it must set aside, and the last step's numbers. */
#include <stddef.h>

#include "../core/ecu.h"

uint32_t host_ecu_size(void) { return (uint32_t)sizeof(ecu); }

void host_last(const ecu *e, float *predicted_mm, float *residual) {
    *predicted_mm = e->predicted_mm;
    *residual = e->verdict.residual;
}
