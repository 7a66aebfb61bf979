/* Made from dbc/motorcycle.dbc by `python -m targets.firmware.frames`; change that, not this. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>

/* Half to even, for 0 <= x < 2^22: the addition rounds, as every IEEE 754 addition does. */
static inline uint32_t frames_round(float x) { return (uint32_t)((x + 8388608.0f) - 8388608.0f); }

static inline uint32_t frames_saturate(float x, float top) {
    if (!(x > 0.0f)) return 0u; /* NaN goes to zero, too */
    return x >= top ? (uint32_t)top : frames_round(x);
}

enum channel {
    CHANNEL_FORK_STROKE_MM,
    CHANNEL_REAR_STROKE_MM,
    CHANNEL_PITCH_RATE_DPS,
    CHANNEL_SPEED_KMH,
    CHANNEL_ACC_FRONT_MS2,
    CHANNEL_ACC_REAR_MS2,
    CHANNEL_ACC_BODY_MS2,
    CHANNELS
};

enum message {
    MESSAGE_STROKES,
    MESSAGE_MOTION,
    MESSAGE_ACCELERATIONS,
    MESSAGES
};
#define FRAMES_MESSAGE_IDS {256u, 257u, 258u}

static inline uint32_t frames_message_of(uint32_t channel) {
    static const uint8_t message[CHANNELS] = {
        MESSAGE_STROKES, /* fork_stroke_mm */
        MESSAGE_STROKES, /* rear_stroke_mm */
        MESSAGE_MOTION, /* pitch_rate_dps */
        MESSAGE_MOTION, /* speed_kmh */
        MESSAGE_ACCELERATIONS, /* acc_front_ms2 */
        MESSAGE_ACCELERATIONS, /* acc_rear_ms2 */
        MESSAGE_ACCELERATIONS, /* acc_body_ms2 */
    };
    return message[channel];
}

/* Takes a frame of the data logger apart; the message it is, or -1 if it is not one of them. */
static inline int frames_read(uint32_t id, uint32_t length, const uint8_t *d, float *channel,
                              uint32_t *alive) {
    uint32_t raw;
    if (id == 256u && length == 4u) {
        raw = (uint32_t)d[0] | (((uint32_t)d[1] & 15u) << 8);
        channel[CHANNEL_FORK_STROKE_MM] = (float)raw * 0x1.2c12c20000000p-5f;
        raw = ((uint32_t)d[1] >> 4) | ((uint32_t)d[2] << 4);
        channel[CHANNEL_REAR_STROKE_MM] = (float)raw * 0x1.b81b820000000p-6f;
        *alive = ((uint32_t)d[3] & 15u);
        return MESSAGE_STROKES;
    }
    if (id == 257u && length == 5u) {
        raw = (uint32_t)d[0] | ((uint32_t)d[1] << 8);
        channel[CHANNEL_PITCH_RATE_DPS] = (float)((int32_t)(raw << 16) >> 16) * 0x1.1eb8520000000p-7f;
        raw = (uint32_t)d[2] | ((uint32_t)d[3] << 8);
        channel[CHANNEL_SPEED_KMH] = (float)raw * 0x1.47ae140000000p-7f;
        *alive = ((uint32_t)d[4] & 15u);
        return MESSAGE_MOTION;
    }
    if (id == 258u && length == 5u) {
        raw = (uint32_t)d[0] | (((uint32_t)d[1] & 15u) << 8);
        channel[CHANNEL_ACC_FRONT_MS2] = (float)((int32_t)(raw << 20) >> 20) * 0x1.e204360000000p-4f;
        raw = ((uint32_t)d[1] >> 4) | ((uint32_t)d[2] << 4);
        channel[CHANNEL_ACC_REAR_MS2] = (float)((int32_t)(raw << 20) >> 20) * 0x1.e204360000000p-4f;
        raw = (uint32_t)d[3] | (((uint32_t)d[4] & 15u) << 8);
        channel[CHANNEL_ACC_BODY_MS2] = (float)((int32_t)(raw << 20) >> 20) * 0x1.e204360000000p-4f;
        *alive = ((uint32_t)d[4] >> 4);
        return MESSAGE_ACCELERATIONS;
    }
    return -1;
}

#define IFD_STATUS_ID 512u
#define IFD_STATUS_LENGTH 8u

static inline void ifd_status_set_predicted_mm(uint8_t *d, float v) {
    uint32_t raw = frames_saturate(v / 0x1.0624de0000000p-9f, 0x1.fffe000000000p+15f);
    d[0] = (uint8_t)(raw);
    d[1] = (uint8_t)(raw >> 8);
}

static inline void ifd_status_set_residual_pct(uint8_t *d, float v) {
    uint32_t raw = frames_saturate(v / 0x1.47ae140000000p-7f, 0x1.fffe000000000p+15f);
    d[2] = (uint8_t)(raw);
    d[3] = (uint8_t)(raw >> 8);
}

static inline void ifd_status_set_alarm(uint8_t *d, uint32_t raw) {
    d[4] = (uint8_t)((d[4] & 0xFEu) | (((raw) & 1u) << 0));
}

static inline void ifd_status_set_ready(uint8_t *d, uint32_t raw) {
    d[4] = (uint8_t)((d[4] & 0xFDu) | (((raw) & 1u) << 1));
}

static inline void ifd_status_set_alive(uint8_t *d, uint32_t raw) {
    d[4] = (uint8_t)((d[4] & 0x0Fu) | (((raw) & 15u) << 4));
}

static inline void ifd_status_set_step(uint8_t *d, uint32_t raw) {
    d[5] = (uint8_t)(raw);
    d[6] = (uint8_t)(raw >> 8);
}

static inline void ifd_status_set_kind(uint8_t *d, uint32_t raw) {
    d[7] = (uint8_t)((d[7] & 0xF0u) | (((raw) & 15u) << 0));
}

#define IFD_TIMING_ID 513u
#define IFD_TIMING_LENGTH 7u

static inline void ifd_timing_set_step_cycles(uint8_t *d, uint32_t raw) {
    d[0] = (uint8_t)(raw);
    d[1] = (uint8_t)(raw >> 8);
    d[2] = (uint8_t)(raw >> 16);
    d[3] = (uint8_t)(raw >> 24);
}

static inline void ifd_timing_set_missed_inputs(uint8_t *d, uint32_t raw) {
    d[4] = (uint8_t)(raw);
}

static inline void ifd_timing_set_overruns(uint8_t *d, uint32_t raw) {
    d[5] = (uint8_t)(raw);
}

static inline void ifd_timing_set_alive(uint8_t *d, uint32_t raw) {
    d[6] = (uint8_t)((d[6] & 0xF0u) | (((raw) & 15u) << 0));
}

#define SOFT_STROKE_ID 528u
#define SOFT_STROKE_LENGTH 5u

static inline void soft_stroke_set_predicted_mm(uint8_t *d, float v) {
    uint32_t raw = frames_saturate(v / 0x1.0624de0000000p-9f, 0x1.fffe000000000p+15f);
    d[0] = (uint8_t)(raw);
    d[1] = (uint8_t)(raw >> 8);
}

static inline void soft_stroke_set_ready(uint8_t *d, uint32_t raw) {
    d[2] = (uint8_t)((d[2] & 0xFEu) | (((raw) & 1u) << 0));
}

static inline void soft_stroke_set_alive(uint8_t *d, uint32_t raw) {
    d[2] = (uint8_t)((d[2] & 0x0Fu) | (((raw) & 15u) << 4));
}

static inline void soft_stroke_set_step(uint8_t *d, uint32_t raw) {
    d[3] = (uint8_t)(raw);
    d[4] = (uint8_t)(raw >> 8);
}

#define SOFT_TIMING_ID 529u
#define SOFT_TIMING_LENGTH 7u

static inline void soft_timing_set_step_cycles(uint8_t *d, uint32_t raw) {
    d[0] = (uint8_t)(raw);
    d[1] = (uint8_t)(raw >> 8);
    d[2] = (uint8_t)(raw >> 16);
    d[3] = (uint8_t)(raw >> 24);
}

static inline void soft_timing_set_missed_inputs(uint8_t *d, uint32_t raw) {
    d[4] = (uint8_t)(raw);
}

static inline void soft_timing_set_overruns(uint8_t *d, uint32_t raw) {
    d[5] = (uint8_t)(raw);
}

static inline void soft_timing_set_alive(uint8_t *d, uint32_t raw) {
    d[6] = (uint8_t)((d[6] & 0xF0u) | (((raw) & 15u) << 0));
}

#endif
