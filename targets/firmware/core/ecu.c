#include "ecu.h"

static uint32_t saturate(uint32_t count, uint32_t more) { return count + more > 255u ? 255u : count + more; }

enum calibration_fault ecu_init(ecu *e, const calibration *cal, uint32_t room, enum role role) {
    enum calibration_fault fault = calibration_check(cal, room);
    if (fault != CALIBRATION_OK) return fault;
    *e = (ecu){.cal = cal, .role = role};
    for (uint32_t i = 0; i < cal->inputs; i++) e->need |= 1u << frames_message_of(cal->input[i].channel);
    if (role == ROLE_IFD) e->need |= 1u << frames_message_of(CHANNEL_REAR_STROKE_MM);
    narx_init(&e->narx, cal);
    ifd_init(&e->ifd);
    return CALIBRATION_OK;
}

int ecu_receive(ecu *e, const can_frame *f) {
    uint32_t alive = 0;
    int message = frames_read(f->id, f->length, f->data, e->channel, &alive);
    if (message < 0 || !(e->need >> message & 1u)) return 0;
    if (!e->synced || alive != e->alive) {
        if (e->synced) {
            uint32_t gap = (alive - e->alive - 1u) & 15u; /* cycles of which no frame came */
            e->missed = saturate(e->missed, gap + !e->complete);
        }
        e->synced = 1;
        e->alive = alive;
        e->got = 0;
        e->complete = 0;
    }
    e->got |= 1u << message;
    if (e->complete || e->got != e->need) return 0;
    e->complete = 1;
    return 1;
}

void ecu_step(ecu *e) {
    e->predicted_mm = narx_step(&e->narx, e->cal, e->channel);
    /* The soft sensor has no stroke to compare with; the IFD's warm-up count serves both. */
    float measured = e->role == ROLE_IFD ? e->channel[CHANNEL_REAR_STROKE_MM] : e->predicted_mm;
    e->verdict = ifd_step(&e->ifd, e->cal, e->predicted_mm, measured);
    e->step++;
}

void ecu_status(const ecu *e, can_frame *f) {
    if (e->role == ROLE_SOFT_SENSOR) {
        *f = (can_frame){.id = SOFT_STROKE_ID, .length = SOFT_STROKE_LENGTH};
        soft_stroke_set_predicted_mm(f->data, e->predicted_mm);
        soft_stroke_set_ready(f->data, e->verdict.ready);
        soft_stroke_set_alive(f->data, e->alive);
        soft_stroke_set_step(f->data, e->step & 0xFFFFu);
        return;
    }
    *f = (can_frame){.id = IFD_STATUS_ID, .length = IFD_STATUS_LENGTH};
    ifd_status_set_predicted_mm(f->data, e->predicted_mm);
    ifd_status_set_residual_pct(f->data, e->verdict.residual * 100.0f);
    ifd_status_set_alarm(f->data, e->verdict.alarm);
    ifd_status_set_ready(f->data, e->verdict.ready);
    ifd_status_set_alive(f->data, e->alive);
    ifd_status_set_step(f->data, e->step & 0xFFFFu);
    ifd_status_set_kind(f->data, e->verdict.kind);
}

void ecu_timing(const ecu *e, uint32_t cycles, can_frame *f) {
    if (e->role == ROLE_SOFT_SENSOR) {
        *f = (can_frame){.id = SOFT_TIMING_ID, .length = SOFT_TIMING_LENGTH};
        soft_timing_set_step_cycles(f->data, cycles);
        soft_timing_set_missed_inputs(f->data, e->missed);
        soft_timing_set_overruns(f->data, e->overruns);
        soft_timing_set_alive(f->data, e->alive);
        return;
    }
    *f = (can_frame){.id = IFD_TIMING_ID, .length = IFD_TIMING_LENGTH};
    ifd_timing_set_step_cycles(f->data, cycles);
    ifd_timing_set_missed_inputs(f->data, e->missed);
    ifd_timing_set_overruns(f->data, e->overruns);
    ifd_timing_set_alive(f->data, e->alive);
}

void ecu_overrun(ecu *e) { e->overruns = saturate(e->overruns, 1u); }
