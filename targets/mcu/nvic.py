"""Nested vectored interrupt controller (ARMv7-M B3.4): the external interrupts' registers and states."""

from targets.jit import njit
from targets.mcu import lines
from targets.mcu.state import (
    ACTIVE,
    ACTIVE_DEPTH,
    ATTEND,
    NVIC_ENABLED,
    NVIC_LATCHED,
    NVIC_PRIORITY,
    State,
)

IRQS = 96


@njit(cache=True)
def _bit(S: State, table: int, irq: int) -> int:
    return S[table + irq // 32] >> (irq % 32) & 1


@njit(cache=True)
def is_active(S: State, exception: int) -> bool:
    """Whether the handler of `exception` has begun and not ended."""
    for k in range(S[ACTIVE_DEPTH]):  # noqa: SIM110  # compiled code has no generators
        if S[ACTIVE + k] == exception:
            return True
    return False


@njit(cache=True)
def current(S: State) -> int:
    """Exception number of the innermost handler, 0 in thread mode."""
    depth = S[ACTIVE_DEPTH]
    return S[ACTIVE + depth - 1] if depth else 0


@njit(cache=True)
def is_pending(S: State, irq: int) -> bool:
    """Latched by software, or its line is up and its handler not running."""
    return _bit(S, NVIC_LATCHED, irq) == 1 or (lines.level(S, irq) and not is_active(S, irq + 16))


@njit(cache=True)
def latch(S: State, irq: int) -> None:
    """Make an interrupt pending, as software does or the edge of a line."""
    S[NVIC_LATCHED + irq // 32] |= 1 << (irq % 32)
    S[ATTEND] |= 1


@njit(cache=True)
def unlatch(S: State, irq: int) -> None:
    """The interrupt is pending no longer, unless its line is up."""
    S[NVIC_LATCHED + irq // 32] &= ~(1 << (irq % 32))


@njit(cache=True)
def most_urgent(S: State, below: int) -> int:
    """The pending, enabled interrupt of the smallest priority value under `below`; -1 if there is none.

    A line seen up stays pending when it falls before its handler has begun (DUI 0553 section 4.2.9).
    """
    best, winner = below, -1
    for word in range(IRQS // 32):
        enabled = S[NVIC_ENABLED + word]
        if enabled == 0:
            continue
        for k in range(32):
            if enabled >> k & 1:
                irq = 32 * word + k
                if not is_pending(S, irq):
                    continue
                S[NVIC_LATCHED + word] |= 1 << k
                priority = S[NVIC_PRIORITY + irq]
                if priority < best:
                    best, winner = priority, irq
    return winner


@njit(cache=True)
def pending_word(S: State, word: int) -> int:
    """The pending bits of 32 interrupts."""
    value = 0
    for k in range(32):
        value |= (1 << k) if is_pending(S, 32 * word + k) else 0
    return value


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from 0xE000E100, -1 if it is not modelled."""
    word = (offset & 0x7F) // 4
    if offset < 0x280 and word >= IRQS // 32:
        return -1
    if offset < 0x100:
        return S[NVIC_ENABLED + word]
    if offset < 0x200:
        return pending_word(S, word)
    if offset < 0x280:
        value = 0
        for k in range(32):
            value |= (1 << k) if is_active(S, 32 * word + k + 16) else 0
        return value
    if 0x300 <= offset < 0x300 + IRQS:
        value = 0
        for k in range(4):
            value |= S[NVIC_PRIORITY + offset - 0x300 + k] << (8 * k)
        return value
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset` from 0xE000E100; False if it is not modelled."""
    S[ATTEND] |= 1
    word = (offset & 0x7F) // 4
    if offset < 0x200 and word >= IRQS // 32:
        return False
    if offset < 0x80:
        S[NVIC_ENABLED + word] |= value
    elif offset < 0x100:
        S[NVIC_ENABLED + word] &= ~value
    elif offset < 0x180:
        S[NVIC_LATCHED + word] |= value
    elif offset < 0x200:
        S[NVIC_LATCHED + word] &= ~value
    elif 0x300 <= offset < 0x300 + IRQS:
        for k in range(4):  # four bits implemented: the upper ones
            S[NVIC_PRIORITY + offset - 0x300 + k] = value >> (8 * k) & 0xF0
    else:
        return False
    return True
