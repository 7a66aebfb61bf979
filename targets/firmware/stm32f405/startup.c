/* From reset to main: vector table, FPU, data and bss. */
#include <stddef.h>

#include "registers.h"

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;

int main(void);
void can1_rx0_handler(void);
void reset_handler(void);

/* A fault ends the program where a debugger, or the bench, finds it by name. */
static void fault_handler(void) {
    for (;;) {
    }
}

typedef void (*vector)(void);

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    vector system[15];
    vector irq[CAN1_RX0_IRQ + 1u];
} vectors = {
    .stack = &stack_top,
    .system = {reset_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, 0, 0, 0, 0,
               fault_handler, fault_handler, 0, fault_handler, fault_handler},
    .irq = {[CAN1_RX0_IRQ] = can1_rx0_handler},
};

void reset_handler(void) {
    SCB_CPACR |= 0xFu << 20; /* full access to the FPU before the first float */
    __asm volatile("dsb\n isb" ::: "memory");
    uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end; to++) *to = *from++;
    for (uint32_t *to = &bss_start; to < &bss_end; to++) *to = 0;
    main();
    fault_handler();
}

/* The compiler may call these for structure copies; there is no C library. */
void *memset(void *to, int value, size_t count) {
    for (uint8_t *p = to; count != 0u; count--) *p++ = (uint8_t)value;
    return to;
}

void *memcpy(void *restrict to, const void *restrict from, size_t count) {
    const uint8_t *q = from;
    for (uint8_t *p = to; count != 0u; count--) *p++ = *q++;
    return to;
}
