"""SysTick (ARMv7-M B3.3): a 24-bit down-counter on the CPU's clock, or on an eighth of it."""

from targets.jit import njit
from targets.mcu import preemption
from targets.mcu.clock import now_cycles
from targets.mcu.state import (
    ATTEND,
    SYST_BASE,
    SYST_CTRL,
    SYST_DUE,
    SYST_LOAD,
    SYST_VALUE,
    State,
)

BASE = 0xE000E010
ENABLE, TICKINT, CLKSOURCE, COUNTFLAG = 1, 2, 4, 1 << 16
CALIBRATION = 0x40000000 | 18750
"""RM0090 section 12.1.3: 1 ms at 18.75 MHz, an eighth of 150 MHz; SKEW, for it is not 10 ms."""
NEVER = 1 << 62


@njit(cache=True)
def reset(S: State) -> None:
    """Stopped, and not to come to zero."""
    S[SYST_CTRL] = S[SYST_LOAD] = S[SYST_VALUE] = 0
    S[SYST_DUE] = NEVER


@njit(cache=True)
def _divisor(S: State) -> int:
    return 1 if S[SYST_CTRL] & CLKSOURCE else 8


@njit(cache=True)
def _settle(S: State) -> None:
    """Bring the count up to date: SYST_VALUE at SYST_BASE, a whole count at or before CYCLES."""
    if not S[SYST_CTRL] & ENABLE:
        return
    counts = (now_cycles(S) - S[SYST_BASE]) // _divisor(S)
    S[SYST_BASE] += counts * _divisor(S)
    value, load = S[SYST_VALUE], S[SYST_LOAD]
    if counts < value:
        S[SYST_VALUE] = value - counts
        return
    if value > 0:
        _reached_zero(S)
        counts -= value
    # At zero: the next count reloads, and every load + 1 counts from here it is zero again.
    if load == 0 or counts == 0:
        S[SYST_VALUE] = 0
        return
    if counts > load:
        _reached_zero(S)
    S[SYST_VALUE] = (load + 1 - counts % (load + 1)) % (load + 1)


@njit(cache=True)
def _reached_zero(S: State) -> None:
    S[SYST_CTRL] |= COUNTFLAG
    if S[SYST_CTRL] & TICKINT:
        preemption.pend(S, preemption.SYS_TICK)


@njit(cache=True)
def _schedule(S: State) -> None:
    """When the count comes to zero next; without an interrupt nobody waits for that."""
    value, load = S[SYST_VALUE], S[SYST_LOAD]
    S[SYST_DUE] = NEVER
    if S[SYST_CTRL] & ENABLE and S[SYST_CTRL] & TICKINT and (value or load):
        S[SYST_DUE] = S[SYST_BASE] + _divisor(S) * (value or load + 1)
    S[ATTEND] |= 1


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which the exception becomes pending, NEVER if it does not."""
    return S[SYST_DUE]


@njit(cache=True)
def service(S: State) -> None:
    """Make the exception pending if the count has come to zero."""
    if now_cycles(S) >= S[SYST_DUE]:
        _settle(S)
        _schedule(S)


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from BASE; reading CTRL clears COUNTFLAG."""
    _settle(S)
    if offset == 0x0:
        value = S[SYST_CTRL]
        S[SYST_CTRL] &= ~COUNTFLAG
        return value
    if offset == 0x4:
        return S[SYST_LOAD]
    if offset == 0x8:
        return S[SYST_VALUE]
    return CALIBRATION


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset` from BASE; CALIB is read-only."""
    _settle(S)
    if offset == 0x0:
        if value & ~S[SYST_CTRL] & ENABLE:
            S[SYST_BASE] = now_cycles(S)
        S[SYST_CTRL] = S[SYST_CTRL] & COUNTFLAG | value & (ENABLE | TICKINT | CLKSOURCE)
    elif offset == 0x4:
        S[SYST_LOAD] = value & 0xFFFFFF
    elif offset == 0x8:  # any value clears the count, and COUNTFLAG
        S[SYST_VALUE] = 0
        S[SYST_BASE] = now_cycles(S)
        S[SYST_CTRL] &= ~COUNTFLAG
    _schedule(S)
    return True
