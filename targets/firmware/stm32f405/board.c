#include "board.h"

#include "registers.h"

#define RING 32u /* power of two: seven cycles of four frames, and then some */

static can_frame ring[RING];
static volatile uint32_t ring_head; /* written by the interrupt only */
static volatile uint32_t ring_tail; /* written by the main loop only */
volatile uint32_t ring_lost;

/* 22 MHz (section V.5.2), CAN at 500 kbit/s. Made by targets/firmware/clock.py; a bench may write another one over
 * it, so the compiler must not know these numbers. */
__attribute__((section(".rodata.clock"))) const volatile board_clock clock_setting = {
    .pllcfgr = 0x09424208u, /* 8 MHz / 8 * 264 / 6 = 44 MHz */
    .cfgr = 0x00000082u,    /* from the PLL, AHB by 2, APB undivided */
    .acr = 0x00000600u,     /* no wait state below 30 MHz (RM0090 table 10), caches on */
    .btr = 0x004F0001u,     /* 22 MHz / 2 = 22 quanta of a bit: 1 + 16 + 5, sampled at 77 % */
};

void board_init(void) {
    RCC_CR |= RCC_CR_HSEON;
    while (!(RCC_CR & RCC_CR_HSERDY)) {
    }
    RCC_PLLCFGR = clock_setting.pllcfgr;
    RCC_CR |= RCC_CR_PLLON;
    while (!(RCC_CR & RCC_CR_PLLRDY)) {
    }
    FLASH_ACR = clock_setting.acr;
    RCC_CFGR = clock_setting.cfgr & ~RCC_CFGR_SW; /* the divisors before the faster source */
    RCC_CFGR = clock_setting.cfgr;
    while ((RCC_CFGR & RCC_CFGR_SWS) != RCC_CFGR_SWS_PLL) {
    }

    RCC_AHB1ENR |= 3u;        /* GPIOA, GPIOB */
    RCC_APB1ENR |= 1u << 25;  /* CAN1 */
    GPIOA_MODER |= 1u;        /* PA0: step pin */
    GPIOB_MODER |= 0xAu << 16; /* PB8, PB9: CAN1 (alternate function 9) */
    GPIOB_AFRH |= 0x99u;

    DEMCR |= DEMCR_TRCENA;
    DWT_CYCCNT = 0;
    DWT_CTRL |= 1u;
}

void can_init(uint32_t need) {
    static const uint32_t id[MESSAGES] = FRAMES_MESSAGE_IDS;
    CAN_MCR = CAN_MCR_INRQ; /* and out of sleep */
    while (!(CAN_MSR & CAN_MSR_INAK)) {
    }
    CAN_BTR = clock_setting.btr;

    CAN_FMR = 1u;
    CAN_FM1R = (1u << MESSAGES) - 1u; /* identifier lists ... */
    CAN_FS1R = (1u << MESSAGES) - 1u; /* ... of 32-bit entries */
    CAN_FFA1R = 0;
    for (uint32_t m = 0; m < MESSAGES; m++) {
        CAN_FR1(m) = id[m] << 21;
        CAN_FR2(m) = id[m] << 21;
    }
    CAN_FA1R = need;
    CAN_FMR = 0;

    CAN_MCR &= ~CAN_MCR_INRQ;
    while (CAN_MSR & CAN_MSR_INAK) {
    }
    CAN_IER = CAN_IER_FMPIE0;
    NVIC_ISER0 = 1u << CAN1_RX0_IRQ;
}

void can1_rx0_handler(void) {
    while (CAN_RF0R & CAN_RF0R_FMP) {
        uint32_t head = ring_head;
        if (head - ring_tail == RING) {
            ring_lost++;
        } else {
            can_frame *f = &ring[head % RING];
            uint32_t low = CAN_RDL0R, high = CAN_RDH0R;
            f->id = CAN_RI0R >> 21;
            f->length = CAN_RDT0R & 15u;
            for (uint32_t i = 0; i < 4u; i++) {
                f->data[i] = (uint8_t)(low >> 8u * i);
                f->data[i + 4u] = (uint8_t)(high >> 8u * i);
            }
            ring_head = head + 1u;
        }
        CAN_RF0R = CAN_RF0R_RFOM;
    }
}

int can_take(can_frame *f) {
    uint32_t tail = ring_tail;
    if (tail == ring_head) return 0;
    *f = ring[tail % RING];
    ring_tail = tail + 1u;
    return 1;
}

uint32_t can_waiting(void) { return ring_head - ring_tail; }

void can_send(const can_frame *f) {
    uint32_t empty;
    while (!(empty = CAN_TSR & CAN_TSR_TME)) {
    }
    uint32_t n = (CAN_TSR >> 24) & 3u; /* CODE: the next empty mailbox */
    uint32_t low = 0, high = 0;
    for (uint32_t i = 0; i < 4u; i++) {
        low |= (uint32_t)f->data[i] << 8u * i;
        high |= (uint32_t)f->data[i + 4u] << 8u * i;
    }
    CAN_TDTR(n) = f->length;
    CAN_TDLR(n) = low;
    CAN_TDHR(n) = high;
    CAN_TIR(n) = f->id << 21 | CAN_TIR_TXRQ;
}

void step_pin(int high) { GPIOA_BSRR = high ? 1u : 1u << 16; }

void sleep_until_frame(void) {
    /* Masked, an interrupt still ends WFI: one that comes between the test and the sleep is not lost. */
    __asm volatile("cpsid i" ::: "memory");
    if (ring_head == ring_tail) __asm volatile("wfi" ::: "memory");
    __asm volatile("cpsie i" ::: "memory");
}
