#include "calibration.h"

#include <stddef.h>

#include "frames.h"

/* Four bits at a time: a sixteen-word table instead of a kilobyte of flash, twice the speed of bitwise. */
static uint32_t crc32(const uint8_t *data, uint32_t length) {
    static const uint32_t nibble[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    uint32_t crc = 0xFFFFFFFFu;
    for (uint32_t i = 0; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ nibble[crc & 15u];
        crc = (crc >> 4) ^ nibble[crc & 15u];
    }
    return ~crc;
}

/* Whether all floats from one offset to another are; NaN is not. */
static int bounded(const calibration *c, size_t from, size_t to) {
    for (; from < to; from += sizeof(float)) {
        float v = *(const float *)(const void *)((const uint8_t *)c + from);
        if (!(v >= -MAX_NUMBER && v <= MAX_NUMBER)) return 0;
    }
    return 1;
}

static int numbers_bounded(const calibration *c) {
    for (uint32_t i = 0; i < c->inputs; i++) {
        size_t end = offsetof(calibration, input) + (i + 1u) * sizeof(input_scaling);
        if (!bounded(c, end - 2u * sizeof(float), end)) return 0;
    }
    return bounded(c, offsetof(calibration, threshold), offsetof(calibration, detector)) &&
           bounded(c, offsetof(calibration, rail_low_mm), offsetof(calibration, input)) &&
           bounded(c, offsetof(calibration, output_bias), c->size) && c->floor_mm >= MIN_FLOOR_MM &&
           c->loss_floor_mm >= MIN_FLOOR_MM;
}

enum calibration_fault calibration_check(const calibration *c, uint32_t room) {
    if (c->magic != CALIBRATION_MAGIC || c->version != CALIBRATION_VERSION) return CALIBRATION_ABSENT;
    if (c->neurons < 1u || c->neurons > MAX_NEURONS || c->delays < 1u || c->delays > MAX_DELAYS) {
        return CALIBRATION_SHAPE;
    }
    if (c->inputs < 1u || c->inputs > MAX_INPUTS || c->window < 1u || c->window > MAX_WINDOW) return CALIBRATION_SHAPE;
    if (c->shift > MAX_SHIFT || c->detector > DETECTOR_CHECKS) return CALIBRATION_SHAPE;
    if (c->multiple < 1u || c->multiple > MAX_MULTIPLE) return CALIBRATION_SHAPE;
    if (c->hold_window < 2u || c->hold_window > MAX_HOLD_WINDOW) return CALIBRATION_SHAPE;
    if (c->loss_window < 1u || c->loss_window > MAX_LOSS_WINDOW) return CALIBRATION_SHAPE;
    for (uint32_t i = 0; i < c->inputs; i++) {
        if (c->input[i].channel >= CHANNELS) return CALIBRATION_SHAPE;
    }
    uint32_t numbers = c->neurons * (1u + calibration_stride(c)) + c->neurons;
    uint32_t size = (uint32_t)offsetof(calibration, weights) + numbers * (uint32_t)sizeof(float);
    if (c->size != size || size > room) return CALIBRATION_SHAPE;
    uint32_t skip = (uint32_t)offsetof(calibration, neurons);
    if (crc32((const uint8_t *)c + skip, size - skip) != c->crc32) return CALIBRATION_CRC;
    return numbers_bounded(c) ? CALIBRATION_OK : CALIBRATION_NUMBER;
}
