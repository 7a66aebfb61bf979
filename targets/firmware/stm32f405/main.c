/* The shell: collects frames, runs a step when an input cycle is complete, reports it, sleeps. */
#include "../core/ecu.h"
#include "board.h"
#include "registers.h"

#ifndef ROLE
#error "say which ECU: -DROLE=ROLE_IFD or -DROLE=ROLE_SOFT_SENSOR"
#endif

#define FRAMES_A_CYCLE 2u

extern const calibration calibration_image; /* its own flash section, see link.ld */
extern const uint8_t calibration_room;

static ecu state;

/* An ECU without valid calibration keeps off the bus. */
static void __attribute__((noinline, noreturn)) calibration_refused(void) {
    for (;;) {
        __asm volatile("wfi");
    }
}

static void answer(void) {
    can_frame frame;
    step_pin(1);
    uint32_t start = DWT_CYCCNT;
    ecu_step(&state);
    uint32_t cycles = DWT_CYCCNT - start;
    step_pin(0);
    if (can_waiting() >= FRAMES_A_CYCLE) ecu_overrun(&state);
    ecu_status(&state, &frame);
    can_send(&frame);
    ecu_timing(&state, cycles, &frame);
    can_send(&frame);
}

int main(void) {
    board_init();
    if (ecu_init(&state, &calibration_image, (uint32_t)&calibration_room, ROLE) != CALIBRATION_OK) {
        calibration_refused();
    }
    can_init(state.need);
    for (;;) {
        can_frame frame;
        while (can_take(&frame)) {
            if (ecu_receive(&state, &frame)) answer();
        }
        sleep_until_frame();
    }
}
