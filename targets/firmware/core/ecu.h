/* The application, free of hardware: frames in, frames out. The STM32F405 shell and the host call it alike. */
#ifndef ECU_H
#define ECU_H

#include <stdint.h>

#include "calibration.h"
#include "frames.h"
#include "ifd.h"
#include "narx.h"

typedef struct {
    uint32_t id;
    uint32_t length;
    uint8_t data[8];
} can_frame;

enum role { ROLE_IFD = 0, ROLE_SOFT_SENSOR = 1 };

typedef struct {
    const calibration *cal;
    enum role role;
    float channel[CHANNELS]; /* latest physical values */
    uint32_t need;           /* messages that make an input cycle complete, a bit each */
    uint32_t got;
    uint32_t alive; /* of the cycle being collected */
    uint32_t synced;
    uint32_t complete; /* the cycle `alive` has been answered */
    uint32_t missed;   /* input cycles that never became complete, saturating */
    uint32_t overruns; /* cycles that waited for the one before, saturating */
    uint32_t step;
    float predicted_mm;
    ifd_verdict verdict;
    narx_state narx;
    ifd_state ifd;
} ecu;

enum calibration_fault ecu_init(ecu *e, const calibration *cal, uint32_t room, enum role role);

/* Takes a frame; 1 if it made an input cycle complete and ecu_step is due. */
int ecu_receive(ecu *e, const can_frame *f);

/* One step on the complete cycle: soft sensor, and for the IFD residual and decision. */
void ecu_step(ecu *e);

/* The frames that report the last step. */
void ecu_status(const ecu *e, can_frame *f);
void ecu_timing(const ecu *e, uint32_t cycles, can_frame *f);

/* A cycle became complete before the step of the one before it had ended. */
void ecu_overrun(ecu *e);

#endif
