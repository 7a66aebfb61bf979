"""External interrupt controller (RM0090 section 12.2): edges on pins, and software's, to interrupt lines."""

from targets.jit import njit
from targets.mcu.state import ATTEND, EXTI, SYSCFG, State

BASE = 0x40013C00
LINES = 0x7FFFFF
IMR, EMR, RTSR, FTSR, SWIER, PR = range(6)
_EXTICR = SYSCFG + 2


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 12.3."""
    for register in range(6):
        S[EXTI + register] = 0


@njit(cache=True)
def edge(S: State, port: int, rising: int, falling: int) -> None:
    """Pins of `port` have changed: the lines that look at them (SYSCFG_EXTICR) become pending."""
    lines = rising & S[EXTI + RTSR] | falling & S[EXTI + FTSR]
    for k in range(16):
        if lines >> k & 1 and S[_EXTICR + k // 4] >> (4 * (k % 4)) & 0xF == port:
            S[EXTI + PR] |= 1 << k
            S[ATTEND] = 1


@njit(cache=True)
def _lines_of(irq: int) -> int:
    """The lines that share an interrupt (RM0090 table 61)."""
    if 6 <= irq <= 10:
        return 1 << (irq - 6)
    if irq == 23:
        return 0x3E0
    if irq == 40:
        return 0xFC00
    if 1 <= irq <= 3:  # PVD, tamper, wake-up
        return (1 << 16, 1 << 21, 1 << 22)[irq - 1]
    if irq in (41, 42):  # RTC alarm, OTG FS wake-up
        return 1 << (irq - 24)
    if irq == 62:  # Ethernet wake-up
        return 1 << 19
    return 1 << 20 if irq == 76 else 0  # OTG HS wake-up


@njit(cache=True)
def line(S: State, irq: int) -> bool:
    """Level of an interrupt line."""
    return S[EXTI + PR] & S[EXTI + IMR] & _lines_of(irq) != 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    return S[EXTI + offset // 4] if offset < 0x18 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled. Events (EMR) wake nothing."""
    S[ATTEND] = 1
    value &= LINES
    register = offset // 4
    if register == PR:
        S[EXTI + PR] &= ~value
        S[EXTI + SWIER] &= ~value
    elif register == SWIER:
        S[EXTI + PR] |= value & ~S[EXTI + SWIER] & S[EXTI + IMR]
        S[EXTI + SWIER] |= value
    elif register < PR:
        S[EXTI + register] = value
        return register != EMR or value == 0
    else:
        return False
    return True
