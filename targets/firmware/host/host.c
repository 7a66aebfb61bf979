/* What a host needs beside the core: the size of the state it must set aside. */
#include <stddef.h>

#include "../core/ecu.h"

uint32_t host_ecu_size(void) { return (uint32_t)sizeof(ecu); }
