/* The STM32F405 board: clock, pins, bxCAN. */
#ifndef BOARD_H
#define BOARD_H

#include "../core/ecu.h"

/* 22 MHz from an 8 MHz crystal (section V.5.2), CAN pins, step pin, cycle counter. */
void board_init(void);

/* bxCAN at 500 kbit/s, letting in the messages of `need` (a bit each), receiving by interrupt. */
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
