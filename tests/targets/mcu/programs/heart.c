/* A heartbeat on CAN1 at 168 MHz: ticks from a function in SRAM, an extended frame every fourth time. */
#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define RCC_CR REGISTER(0x40023800)
#define RCC_PLLCFGR REGISTER(0x40023804)
#define RCC_CFGR REGISTER(0x40023808)
#define RCC_AHB1ENR REGISTER(0x40023830)
#define RCC_APB1ENR REGISTER(0x40023840)
#define RCC_APB2ENR REGISTER(0x40023844)
#define FLASH_ACR REGISTER(0x40023C00)
#define CAN1 0x40006400
#define SPI1_CR1 REGISTER(0x40013000)
#define SPI1_SR REGISTER(0x40013008)
#define DEMCR REGISTER(0xE000EDFC)
#define DWT_CTRL REGISTER(0xE0001000)
#define DWT_CYCCNT REGISTER(0xE0001004)

static uint8_t beats = 0x40;

__attribute__((section(".fast"), noinline)) static void wait_cycles(uint32_t cycles)
{
	uint32_t begun = DWT_CYCCNT;
	while (DWT_CYCCNT - begun < cycles) {
	}
}

static void run_at_168_mhz(void)
{
	RCC_CR |= 1u << 16;
	while (!(RCC_CR & 1u << 17)) {
	}
	RCC_PLLCFGR = 8 | 336 << 6 | 0 << 16 | 1 << 22 | 7 << 24;
	RCC_CR |= 1u << 24;
	while (!(RCC_CR & 1u << 25)) {
	}
	FLASH_ACR = 0x705;
	RCC_CFGR = 5u << 10 | 4u << 13; /* APB1 at 42 MHz, APB2 at 84 */
	RCC_CFGR |= 2;
	while ((RCC_CFGR >> 2 & 3) != 2) {
	}
}

static void open_can(void)
{
	RCC_AHB1ENR |= 1 << 1; /* GPIOB: RX on PB8, TX on PB9 */
	RCC_APB1ENR |= 1 << 25;
	REGISTER(0x40020400) = (REGISTER(0x40020400) & ~(0xFu << 16)) | 0xAu << 16;
	REGISTER(0x40020424) = (REGISTER(0x40020424) & ~0xFFu) | 0x99;
	REGISTER(CAN1) = 1; /* out of sleep, into initialisation */
	while ((REGISTER(CAN1 + 4) & 3) != 1) {
	}
	REGISTER(CAN1 + 0x1C) = BRP - 1 | 9 << 16 | 2 << 20; /* 14 quanta */
	REGISTER(CAN1) = 0;
	while (REGISTER(CAN1 + 4) & 1) {
	}
}

static void send(uint32_t tir)
{
	while (!(REGISTER(CAN1 + 8) & 1u << 26)) {
	}
	REGISTER(CAN1 + 0x184) = 2;
	REGISTER(CAN1 + 0x188) = 0xA500u | beats++;
	REGISTER(CAN1 + 0x180) = tir | 1;
}

int main(void)
{
	run_at_168_mhz();
	RCC_APB2ENR |= 1 << 12;
	SPI1_CR1 = 0x344;
	(void)SPI1_SR;
	(void)SPI1_SR;
	DEMCR |= 1 << 24;
	DWT_CYCCNT = 0;
	DWT_CTRL |= 1;
	open_can();
	for (uint32_t k = 1;; k++) {
		send(k % 4 ? 0x123u << 21 : 0x1234567u << 3 | 4);
		wait_cycles(1680000); /* 10 ms */
	}
}
