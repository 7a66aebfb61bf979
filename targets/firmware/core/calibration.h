/* Calibration data: everything a newly trained network changes. One image, in its own flash section,
 * little-endian, read in place. Layout mirrored by targets/calibration.py. */
#ifndef CALIBRATION_H
#define CALIBRATION_H

#include <stdint.h>

#define CALIBRATION_MAGIC 0x4C414353u /* "SCAL" */
#define CALIBRATION_VERSION 2u
#define MAX_NEURONS 32u
#define MAX_DELAYS 16u
#define MAX_INPUTS 7u
#define MAX_SHIFT 15u
#define MAX_WINDOW 128u
#define MAX_MULTIPLE 10000u
#define MAX_HOLD_WINDOW 128u
#define MAX_LOSS_WINDOW 512u
#define MAX_REGRESSORS ((MAX_INPUTS + 1u) * MAX_DELAYS)
/* Within these no sum and no product of a step overflows, and nothing is divided by zero: what the ECU says is
 * always a number. A residual that is none would lie above no threshold, and raise no alarm. */
#define MAX_NUMBER 1e9f
#define MIN_FLOOR_MM 1e-6f

enum feedback { FEEDBACK_PREDICTED = 0, FEEDBACK_MEASURED = 1 };
enum detector { DETECTOR_RESIDUAL = 0, DETECTOR_CHECKS = 1 };

/* x = (value - offset) * gain maps a sensor's range to [-1, 1] (section III.3). */
typedef struct {
    uint32_t channel; /* an enum channel of frames.h */
    float offset;
    float gain;
} input_scaling;

typedef struct {
    uint32_t magic;
    uint32_t version;
    uint32_t size;  /* bytes of the whole image */
    uint32_t crc32; /* IEEE 802.3, over what follows this word */
    uint32_t neurons;
    uint32_t delays;   /* d_in, samples */
    uint32_t inputs;   /* exogenous ones */
    uint32_t feedback; /* enum feedback */
    uint32_t shift;    /* samples by which the prediction runs ahead (section III.3) */
    uint32_t window;   /* L_s, samples (V.1) */
    uint32_t multiple; /* n, windows above the threshold before the alarm (Figure V.8) */
    uint32_t warmup;   /* steps before the residual is trusted */
    float threshold;   /* T, relative */
    float floor_mm;    /* smallest divisor of the residual */
    float initial_mm;  /* what the fed-back stroke starts from */
    float out_gain;    /* y_mm = y * out_gain + out_offset */
    float out_offset;
    float out_scale;   /* y = (y_mm - out_offset) * out_scale */
    uint32_t detector;      /* enum detector; the next are the second one's, checks.h */
    uint32_t rail_steps;    /* at a rail before it is a fault */
    uint32_t repeat_steps;  /* with the same value before it is a fault */
    uint32_t hold_window;   /* samples of the motion check */
    uint32_t loss_window;   /* samples of the loss check */
    uint32_t heal_steps;    /* without a finding before the alarm is taken back */
    float rail_low_mm;      /* the rails, as measured */
    float rail_high_mm;
    float rail_gap_mm;      /* nearer to a rail than this the model expects the stop */
    float repeat_motion_mm; /* what the predicted stroke moves meanwhile */
    float hold_ratio;       /* of measured to predicted standard deviation */
    float still_mm;         /* predicted standard deviation below which nothing is said */
    float loss_threshold;   /* of the mean log ratio */
    float loss_floor_mm;    /* smaller strokes count as this */
    input_scaling input[MAX_INPUTS];
    float output_bias;
    float weights[]; /* neurons rows of [bias, w_1 .. w_stride]; then neurons output weights */
} calibration;

/* Rows are padded with zero weights to a multiple of four, so that the inner loop needs no remainder. */
static inline uint32_t calibration_stride(const calibration *c) {
    return ((c->inputs + 1u) * c->delays + 3u) & ~3u;
}

enum calibration_fault { CALIBRATION_OK = 0, CALIBRATION_ABSENT, CALIBRATION_SHAPE, CALIBRATION_CRC, CALIBRATION_NUMBER };

/* room: bytes of flash set aside for the image. */
enum calibration_fault calibration_check(const calibration *c, uint32_t room);

#endif
