"""Nested vectored interrupt controller (ARMv7-M B3.4): what is pending, what may preempt what."""

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
IDLE = 256
"""Priority of thread mode: below every interrupt."""


@njit(cache=True)
def _bit(S: State, table: int, irq: int) -> int:
    return S[table + irq // 32] >> (irq % 32) & 1


@njit(cache=True)
def _is_active(S: State, exception: int) -> bool:
    for k in range(S[ACTIVE_DEPTH]):  # noqa: SIM110  # compiled code has no generators
        if S[ACTIVE + k] == exception:
            return True
    return False


@njit(cache=True)
def is_pending(S: State, irq: int) -> bool:
    """Latched by software, or its line is up and its handler not running."""
    return _bit(S, NVIC_LATCHED, irq) == 1 or (lines.level(S, irq) and not _is_active(S, irq + 16))


@njit(cache=True)
def running_priority(S: State) -> int:
    """Priority of the innermost active handler, IDLE in thread mode."""
    best = IDLE
    for k in range(S[ACTIVE_DEPTH]):
        priority = S[NVIC_PRIORITY + S[ACTIVE + k] - 16]
        best = min(best, priority)
    return best


@njit(cache=True)
def candidate(S: State) -> int:
    """The pending, enabled interrupt that may preempt what runs now; -1 if there is none."""
    best, winner = running_priority(S), -1
    for word in range(IRQS // 32):
        enabled = S[NVIC_ENABLED + word]
        if enabled == 0:
            continue
        for k in range(32):
            if enabled >> k & 1:
                irq = 32 * word + k
                priority = S[NVIC_PRIORITY + irq]
                if priority < best and is_pending(S, irq):
                    best, winner = priority, irq
    return winner


@njit(cache=True)
def enter(S: State, irq: int) -> None:
    """The handler of `irq` begins."""
    S[NVIC_LATCHED + irq // 32] &= ~(1 << (irq % 32))
    S[ACTIVE + S[ACTIVE_DEPTH]] = irq + 16
    S[ACTIVE_DEPTH] += 1


@njit(cache=True)
def leave(S: State) -> None:
    """The innermost handler ends."""
    S[ACTIVE_DEPTH] -= 1


@njit(cache=True)
def current(S: State) -> int:
    """Exception number of the innermost handler, 0 in thread mode."""
    depth = S[ACTIVE_DEPTH]
    return S[ACTIVE + depth - 1] if depth else 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from 0xE000E100, -1 if it is not modelled."""
    word = (offset & 0x7F) // 4
    if offset < 0x280 and word >= IRQS // 32:
        return -1
    if offset < 0x100:
        return S[NVIC_ENABLED + word]
    if offset < 0x200:
        value = 0
        for k in range(32):
            value |= (1 << k) if is_pending(S, 32 * word + k) else 0
        return value
    if offset < 0x280:
        value = 0
        for k in range(32):
            value |= (1 << k) if _is_active(S, 32 * word + k + 16) else 0
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
    S[ATTEND] = 1
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
