/* The STM32F405 board: clock, pins, bxCAN. */
#ifndef BOARD_H
#define BOARD_H

#include "../core/ecu.h"

/* What decides the CPU's frequency, and what depends on it: register words. */
typedef struct {
    uint32_t pllcfgr; /* RCC: the PLL, from an 8 MHz crystal */
    uint32_t cfgr;    /* RCC: SYSCLK from the PLL, divisors of AHB and APB */
    uint32_t acr;     /* flash: wait states, prefetch, caches */
    uint32_t btr;     /* CAN: the bit */
} board_clock;

extern const volatile board_clock clock_setting;

/* Clock, CAN pins, step pin, cycle counter. */
void board_init(void);

/* bxCAN, letting in the messages of `need` (a bit each), receiving by interrupt. */
void can_init(uint32_t need);

/* Queues a frame, waiting for a mailbox if all three are taken. */
void can_send(const can_frame *f);

/* Takes the oldest received frame; 0 if there is none. */
int can_take(can_frame *f);

/* Frames received and not taken yet. */
uint32_t can_waiting(void);

/* High while a step is being computed: what an oscilloscope measures (Table V.13). */
void step_pin(int high);

/* Sleeps until an interrupt, unless a frame is waiting already. */
void sleep_until_frame(void);

#endif
