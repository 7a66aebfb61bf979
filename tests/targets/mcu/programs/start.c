/* A start-up unlike the shipped firmware's: addresses from the linker, constructors, a default handler. */
#include <stdint.h>

extern uint32_t stack_top, data_start, data_end, bss_start, bss_end;
extern const uint32_t data_load;
extern void (*constructors_start[])(void), (*constructors_end[])(void);
int main(void);

void Reset_Handler(void)
{
	const uint32_t *from = &data_load;
	for (volatile uint32_t *to = &data_start; to < &data_end; to++)
		*to = *from++;
	for (volatile uint32_t *to = &bss_start; to < &bss_end; to++)
		*to = 0;
	for (void (**each)(void) = constructors_start; each < constructors_end; each++)
		(*each)();
	main();
}

void Default_Handler(void)
{
	for (;;) {
	}
}

void NMI_Handler(void) __attribute__((weak, alias("Default_Handler")));
void HardFault_Handler(void) __attribute__((weak, alias("Default_Handler")));

__attribute__((section(".vectors"), used)) static const void *const vectors[98] = {
	&stack_top, Reset_Handler, NMI_Handler, HardFault_Handler,
};
