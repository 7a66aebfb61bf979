"""Devices back to their reset values: all of them, or those whose bit in RCC's reset registers rises."""

from targets.jit import njit
from targets.mcu import crc, exti, gating, gpio, itm, iwdg, pwr, syscfg, tim, usart, wwdg
from targets.mcu.state import DBGMCU, State

_CAN = 3 << 25


@njit(cache=True)
def reset_all(S: State) -> None:
    """A system reset, but for RCC, bxCAN and what belongs to the core."""
    for port in range(gpio.PORTS):
        gpio.reset(S, port)
    for timer in range(tim.TIMERS):
        tim.reset(S, timer)
    for unit in range(len(usart.NAMES)):
        usart.reset(S, unit)
    for register in range(3):
        S[DBGMCU + register] = 0
    crc.reset(S)
    exti.reset(S)
    itm.reset(S)
    iwdg.reset(S)
    pwr.reset(S)
    syscfg.reset(S)
    wwdg.reset(S)


@njit(cache=True)
def _reset_ahb1(S: State, bits: int) -> None:
    for port in range(gpio.PORTS):
        if bits >> port & 1:
            gpio.reset(S, port)
    if bits >> 12 & 1:
        crc.reset(S)


@njit(cache=True)
def _reset_apb1(S: State, bits: int) -> None:
    for timer in range(tim.TIMERS):
        if bits >> timer & 1:
            tim.reset(S, timer)
    if bits >> 11 & 1:
        wwdg.reset(S)
    for unit in range(1, 5):
        if bits >> (16 + unit) & 1:
            usart.reset(S, unit)
    if bits >> 28 & 1:
        pwr.reset(S)


@njit(cache=True)
def _reset_apb2(S: State, bits: int) -> None:
    if bits >> 4 & 1:
        usart.reset(S, 0)
    if bits >> 5 & 1:
        usart.reset(S, 5)
    if bits >> 14 & 1:
        syscfg.reset(S)


@njit(cache=True)
def reset_by_bits(S: State, register: int, bits: int) -> bool:
    """The devices of `bits` in one of RCC's reset registers; False if one of them cannot be reset so."""
    if register == gating.AHB1:
        _reset_ahb1(S, bits)
    elif register == gating.APB1:
        _reset_apb1(S, bits)
        return bits & _CAN == 0
    elif register == gating.APB2:
        _reset_apb2(S, bits)
    return True
