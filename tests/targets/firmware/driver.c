/* The core in a process of its own, so that the sanitizers' run-time need not be loaded into Python.
 *
 * Commands come on standard input, answers go to standard output, both in this machine's own byte order:
 *   I role room size image    switch on with a calibration       -> uint32_t fault
 *   F n cycles frames         take frames in, stepping when due  -> n replies
 *   O                         a cycle came too soon              -> nothing
 *   D n size image p m        the decision maker over n strokes  -> n verdicts
 * What is read lies in blocks of exactly its own size, so that an access past its end is found. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decide.h"
#include "ecu.h"

typedef struct {
    uint32_t due;
    float predicted_mm, residual;
    can_frame status, timing;
} reply;

static void *take(size_t size) {
    void *block = malloc(size != 0u ? size : 1u);
    if (block == NULL || fread(block, 1, size, stdin) != size) exit(2);
    return block;
}

static uint32_t number(void) {
    uint32_t value;
    if (fread(&value, sizeof value, 1, stdin) != 1) exit(2);
    return value;
}

static void give(const void *data, size_t size) {
    if (fwrite(data, 1, size, stdout) != size) exit(2);
}

static reply answer(ecu *e, const can_frame *f, uint32_t cycles) {
    reply r;
    memset(&r, 0, sizeof r);
    r.due = (uint32_t)ecu_receive(e, f);
    if (r.due) {
        ecu_step(e);
        r.predicted_mm = e->predicted_mm;
        r.residual = e->verdict.residual;
        ecu_status(e, &r.status);
        ecu_timing(e, cycles, &r.timing);
    }
    return r;
}

int main(void) {
    calibration *image = NULL;
    ecu *e = malloc(sizeof *e);
    if (e == NULL) return 2;
    for (int command; (command = getchar()) != EOF;) {
        if (command == 'I') {
            enum role role = (enum role)number();
            uint32_t room = number(), size = number();
            free(image);
            image = take(size);
            memset(e, 0xA5, sizeof *e);
            uint32_t fault = ecu_init(e, image, room, role);
            give(&fault, sizeof fault);
        } else if (command == 'F') {
            uint32_t n = number(), cycles = number();
            can_frame *frames = take(n * sizeof *frames);
            for (uint32_t i = 0; i < n; i++) {
                reply r = answer(e, &frames[i], cycles);
                give(&r, sizeof r);
            }
            free(frames);
        } else if (command == 'O') {
            ecu_overrun(e);
        } else if (command == 'D') {
            uint32_t n = number(), size = number();
            calibration *c = take(size);
            float *predicted = take(n * sizeof *predicted), *measured = take(n * sizeof *measured);
            ifd_verdict *out = malloc(n * sizeof *out);
            if (out == NULL) return 2;
            decide(c, n, predicted, measured, out);
            give(out, n * sizeof *out);
            free(out);
            free(measured);
            free(predicted);
            free(c);
        } else {
            return 2;
        }
        if (fflush(stdout) != 0) return 2;
    }
    free(image);
    free(e);
    return 0;
}
