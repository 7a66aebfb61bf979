"""Window watchdog (RM0090 section 22): counts PCLK1 / 4096, bites below 0x40 and when fed too early."""

from targets.jit import njit
from targets.mcu import gating, rcc
from targets.mcu.clock import now_cycles
from targets.mcu.state import (
    ATTEND,
    RESET_CAUSE,
    RESET_REQUEST,
    WWDG_ACTIVE,
    WWDG_BASE,
    WWDG_CFR,
    WWDG_COUNT,
    WWDG_PHASE,
    WWDG_SR,
    State,
)

BASE = 0x40002C00
IRQ = 0
WARNING = 0x40
EWI = 1 << 9


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 22.6: not active."""
    S[WWDG_ACTIVE] = S[WWDG_SR] = 0
    S[WWDG_CFR] = S[WWDG_COUNT] = 0x7F
    S[WWDG_BASE], S[WWDG_PHASE] = now_cycles(S), 0


@njit(cache=True)
def _count_cycles(S: State) -> int:
    """CPU cycles in one count."""
    return 4096 * rcc.apb1_divisor(S) << (S[WWDG_CFR] >> 7 & 3)


@njit(cache=True)
def _bite(S: State) -> None:
    S[RESET_REQUEST] = S[ATTEND] = 1
    S[RESET_CAUSE] = rcc.WINDOW_WATCHDOG


@njit(cache=True)
def _is_clocked(S: State) -> bool:
    return gating.is_on(S, gating.APB1, 11)


@njit(cache=True)
def settle(S: State) -> None:
    """Count to the present. The counter runs whether the watchdog is active or not (section 22.4)."""
    counts = (now_cycles(S) - S[WWDG_BASE]) // _count_cycles(S)
    if counts <= 0 or not _is_clocked(S):
        return
    before, after = S[WWDG_COUNT], S[WWDG_COUNT] - counts
    S[WWDG_BASE] += counts * _count_cycles(S)
    S[WWDG_COUNT] = after & 0x7F
    if before > WARNING >= after:
        S[WWDG_SR] = 1
    if after < WARNING and S[WWDG_ACTIVE]:
        _bite(S)


@njit(cache=True)
def service(S: State) -> None:
    """Count to the present if something comes of it."""
    if S[WWDG_ACTIVE]:
        settle(S)


@njit(cache=True)
def pause(S: State) -> None:
    """PCLK1 is about to change: count, and note how far the present count is."""
    settle(S)
    if _is_clocked(S):
        S[WWDG_PHASE] = (now_cycles(S) - S[WWDG_BASE]) // rcc.apb1_divisor(S)


@njit(cache=True)
def resume(S: State) -> None:
    """PCLK1 has changed: the count goes on at its pace."""
    S[WWDG_BASE] = now_cycles(S) - S[WWDG_PHASE] * rcc.apb1_divisor(S)


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles of the early wake-up, then of the reset."""
    if not S[WWDG_ACTIVE] or not _is_clocked(S):
        return rcc.NEVER
    counts = S[WWDG_COUNT] - WARNING
    return S[WWDG_BASE] + (counts if counts > 0 else counts + 1) * _count_cycles(S)


@njit(cache=True)
def line(S: State) -> bool:
    """Level of the early wake-up interrupt."""
    return S[WWDG_SR] != 0 and S[WWDG_CFR] & EWI != 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    settle(S)
    if offset == 0x00:
        return S[WWDG_ACTIVE] << 7 | S[WWDG_COUNT]
    if offset == 0x04:
        return S[WWDG_CFR]
    return S[WWDG_SR] if offset == 0x08 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    settle(S)
    S[ATTEND] = 1
    if offset == 0x00:
        if S[WWDG_ACTIVE] and S[WWDG_COUNT] > S[WWDG_CFR] & 0x7F:
            _bite(S)
        S[WWDG_ACTIVE] |= value >> 7 & 1
        S[WWDG_COUNT] = value & 0x7F
        S[WWDG_BASE] = now_cycles(S)
        if S[WWDG_ACTIVE] and value & WARNING == 0:
            _bite(S)
    elif offset == 0x04:
        # EWI, once set, is cleared by a reset only
        S[WWDG_CFR] = value & 0x3FF | S[WWDG_CFR] & EWI
        S[WWDG_BASE] = now_cycles(S) - (now_cycles(S) - S[WWDG_BASE]) % _count_cycles(S)
    elif offset == 0x08:
        S[WWDG_SR] &= value
    else:
        return False
    return True
