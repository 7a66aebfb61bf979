"""The emulated STM32F405: a Cortex-M4F on unicorn, its devices at register level, a cycle model."""
