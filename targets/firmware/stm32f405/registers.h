/* The registers this firmware touches, by their names in the reference manual RM0090. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))

/* Reset and clock control, RM0090 section 7.3 */
#define RCC_CR REG(0x40023800u)
#define RCC_PLLCFGR REG(0x40023804u)
#define RCC_CFGR REG(0x40023808u)
#define RCC_AHB1ENR REG(0x40023830u)
#define RCC_APB1ENR REG(0x40023840u)
#define RCC_CR_HSEON (1u << 16)
#define RCC_CR_HSERDY (1u << 17)
#define RCC_CR_PLLON (1u << 24)
#define RCC_CR_PLLRDY (1u << 25)
#define RCC_CFGR_SW 3u
#define RCC_CFGR_SWS 0xCu
#define RCC_CFGR_SWS_PLL 8u

/* Flash interface, section 3.9 */
#define FLASH_ACR REG(0x40023C00u)

/* GPIO, section 8.4 */
#define GPIOA_MODER REG(0x40020000u)
#define GPIOA_BSRR REG(0x40020018u)
#define GPIOB_MODER REG(0x40020400u)
#define GPIOB_AFRH REG(0x40020424u)

/* bxCAN 1, section 32.9 */
#define CAN_MCR REG(0x40006400u)
#define CAN_MSR REG(0x40006404u)
#define CAN_TSR REG(0x40006408u)
#define CAN_RF0R REG(0x4000640Cu)
#define CAN_IER REG(0x40006414u)
#define CAN_BTR REG(0x4000641Cu)
#define CAN_TIR(n) REG(0x40006580u + 16u * (n))
#define CAN_TDTR(n) REG(0x40006584u + 16u * (n))
#define CAN_TDLR(n) REG(0x40006588u + 16u * (n))
#define CAN_TDHR(n) REG(0x4000658Cu + 16u * (n))
#define CAN_RI0R REG(0x400065B0u)
#define CAN_RDT0R REG(0x400065B4u)
#define CAN_RDL0R REG(0x400065B8u)
#define CAN_RDH0R REG(0x400065BCu)
#define CAN_FMR REG(0x40006600u)
#define CAN_FM1R REG(0x40006604u)
#define CAN_FS1R REG(0x4000660Cu)
#define CAN_FFA1R REG(0x40006614u)
#define CAN_FA1R REG(0x4000661Cu)
#define CAN_FR1(bank) REG(0x40006640u + 8u * (bank))
#define CAN_FR2(bank) REG(0x40006644u + 8u * (bank))
#define CAN_MCR_INRQ (1u << 0)
#define CAN_MCR_SLEEP (1u << 1)
#define CAN_MSR_INAK (1u << 0)
#define CAN_TSR_TME (7u << 26)
#define CAN_TIR_TXRQ (1u << 0)
#define CAN_RF0R_FMP (3u << 0)
#define CAN_RF0R_RFOM (1u << 5)
#define CAN_IER_FMPIE0 (1u << 1)
#define CAN1_RX0_IRQ 20u

/* Cortex-M4 system control, ARMv7-M architecture reference manual B3 and C1 */
#define NVIC_ISER0 REG(0xE000E100u)
#define SCB_CPACR REG(0xE000ED88u)
#define DEMCR REG(0xE000EDFCu)
#define DEMCR_TRCENA (1u << 24)
#define DWT_CTRL REG(0xE0001000u)
#define DWT_CYCCNT REG(0xE0001004u)

#endif
