/* Says hello on USART2 at 115200 baud and on ITM port 0; touches a timer whose clock is off. */
#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define USART2 0x40004400
#define ITM 0xE0000000

static void say(const char *text)
{
	for (; *text; text++) {
		while (!(REGISTER(USART2) & 1 << 7)) {
		}
		REGISTER(USART2 + 4) = *text;
		while (!REGISTER(ITM)) {
		}
		*(volatile uint8_t *)ITM = *text;
	}
}

int main(void)
{
	REGISTER(0x40023830) |= 1; /* GPIOA */
	REGISTER(0x40020000) |= 2 << 4;
	REGISTER(0x40020020) |= 7 << 8;
	REGISTER(0x40023840) |= 1 << 17; /* USART2 */
	REGISTER(USART2 + 8) = 139; /* 16 MHz / 115200 */
	REGISTER(USART2 + 12) = 1 << 13 | 1 << 3;
	REGISTER(0xE000EDFC) |= 1 << 24;
	REGISTER(ITM + 0xFB0) = 0xC5ACCE55;
	REGISTER(ITM + 0xE80) = 1;
	REGISTER(ITM + 0xE00) = 1;
	REGISTER(0x40000000) = 1; /* TIM2 without its clock */
	say("hello, bench\n");
	say("second line\n");
	for (;;)
		__asm volatile("wfi");
}
