"""Devices as a program reaches them: by loads and stores, through unicorn."""

import numpy as np
import pytest

from targets.errors import FirmwareFault
from targets.mcu import gating, pins
from targets.mcu.machine import TIME, Stm32f405
from targets.mcu.state import RESET_CAUSE
from tests.targets.mcu.assembled import program

MS = 1_000_000

BIT_BANDS = """
    4804 2101 6001    ldr r0, =alias of AHB1ENR bit 2;  movs r1, #1;  str r1, [r0]
    4804 6001 6802    ldr r0, =alias of GPIOC_ODR bit 5;  str r1, [r0];  ldr r2, [r0]
    4803 6001 7803    ldr r0, =alias of 0x20000101 bit 1;  str r1, [r0];  ldrb r3, [r0]
    e7fe              b .
    0608 4247 0294 4241 2024 2200
"""
WATCHDOG = """
    4802 f64c 41cc 6001    ldr r0, =IWDG_KR;  movw r1, #0xcccc;  str r1, [r0]
    bf30 e7fe              wfi;  b .
    3000 4000
"""
BLINK = """
    4809 2101 6301 6401    ldr r0, =RCC;  movs r1, #1;  str r1, [r0, #0x30];  str r1, [r0, #0x40]
    4c08 6021              ldr r4, =GPIOA;  str r1, [r4]
    f04f 4080 f643 627f    mov r0, #TIM2;  movw r2, #15999
    62c2 60c1 6001         str r2, [r0, #ARR];  str r1, [r0, #DIER];  str r1, [r0, #CR1]
    4a05 f04f 5380 6013    ldr r2, =NVIC_ISER0;  mov r3, #1 << 28;  str r3, [r2]
    bf30 e7fd 0000         wfi;  b .-2
    3800 4002 0000 4002 e100 e000
"""
BLINK_HANDLER = """
    f04f 4080 2100 6101    mov r0, #TIM2;  movs r1, #0;  str r1, [r0, #SR]
    4c02 6962              ldr r4, =GPIOA;  ldr r2, [r4, #ODR]
    f082 0201 6162 4770    eor r2, r2, #1;  str r2, [r4, #ODR];  bx lr
    0000 4002
"""


def test_bit_band_aliases_from_a_program():
    """A program sets single bits of a device and of SRAM through their aliases, and reads them."""
    mcu = Stm32f405(program(BIT_BANDS))
    mcu.run(MS)
    assert mcu.read_word(0x20000100) == 1 << 9
    assert pins_of_port_c(mcu) == 1 << 5
    assert gating.unclocked(mcu.state) == {}
    assert mcu.unmodelled() == {}


def pins_of_port_c(mcu):
    return mcu.read_word(0x40020814)


def test_watchdog_that_is_never_fed_ends_the_run():
    """A program that starts the watchdog and sleeps is reset after 512 ms, not later."""
    mcu = Stm32f405(program(WATCHDOG))
    assert mcu.run(511 * MS) == TIME
    with pytest.raises(FirmwareFault):
        mcu.run(1000 * MS)
    assert mcu.state[RESET_CAUSE] == 2
    assert 512 * MS <= mcu.now_ns < 513 * MS


def test_timer_interrupt_wakes_a_sleeping_core():
    """A pin toggled by TIM2's handler has its edges a millisecond apart, and nothing runs in between."""
    mcu = Stm32f405(program(BLINK, {28: BLINK_HANDLER}))
    mcu.run(100 * MS + MS // 2)
    edges = pins.edges(mcu, "PA0")
    assert edges.level.tolist() == [1, 0] * 50
    assert set(np.diff(edges.ns)) == {MS}
    assert mcu.unmodelled() == {}
