"""Independent watchdog (RM0090 section 21), on the internal oscillator of 32 kHz.

On silicon the LSI lies between 17 and 47 kHz (DS8626 table 35); here it is exact (FIDELITY.md).
"""

from targets.jit import njit
from targets.mcu import rcc
from targets.mcu.clock import NS, cycles_at, now_ns
from targets.mcu.state import (
    ATTEND,
    IWDG_EXPIRES_NS,
    IWDG_PR,
    IWDG_PVU_NS,
    IWDG_RLR,
    IWDG_RUNNING,
    IWDG_RVU_NS,
    IWDG_UNLOCKED,
    RESET_CAUSE,
    RESET_REQUEST,
    State,
)

BASE = 0x40003000
LSI_HZ = 32_000
START, RELOAD, UNLOCK = 0xCCCC, 0xAAAA, 0x5555
_UPDATE_NS = 5 * NS // LSI_HZ  # section 21.4.4: up to five periods of the LSI


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 21.4: stopped; only a reset stops it."""
    S[IWDG_PR] = S[IWDG_UNLOCKED] = S[IWDG_RUNNING] = 0
    S[IWDG_RLR] = 0xFFF
    S[IWDG_PVU_NS] = S[IWDG_RVU_NS] = -rcc.NEVER


@njit(cache=True)
def _count_ns(S: State) -> int:
    """One count of the watchdog; PR of 6 and 7 both divide by 256."""
    return (4 << min(S[IWDG_PR], 6)) * NS // LSI_HZ


@njit(cache=True)
def _reload(S: State) -> None:
    S[IWDG_EXPIRES_NS] = now_ns(S) + (S[IWDG_RLR] + 1) * _count_ns(S)


@njit(cache=True)
def _set_prescaler(S: State, value: int) -> None:
    """The counts that are left go on at the new pace."""
    left = -((now_ns(S) - S[IWDG_EXPIRES_NS]) // _count_ns(S))
    S[IWDG_PR] = value & 7
    S[IWDG_EXPIRES_NS] = now_ns(S) + left * _count_ns(S)
    S[IWDG_PVU_NS] = now_ns(S) + _UPDATE_NS


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which the watchdog bites."""
    return cycles_at(S, S[IWDG_EXPIRES_NS]) if S[IWDG_RUNNING] else rcc.NEVER


@njit(cache=True)
def service(S: State) -> None:
    """Ask for a reset if the time is over."""
    if S[IWDG_RUNNING] and now_ns(S) >= S[IWDG_EXPIRES_NS]:
        S[RESET_REQUEST] = 1
        S[RESET_CAUSE] = rcc.INDEPENDENT_WATCHDOG


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset == 0x00:  # KR is write-only
        return 0
    if offset == 0x04:
        return S[IWDG_PR]
    if offset == 0x08:
        return S[IWDG_RLR]
    if offset == 0x0C:
        return int(now_ns(S) < S[IWDG_PVU_NS]) | int(now_ns(S) < S[IWDG_RVU_NS]) << 1
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    service(S)  # a reload may come too late
    if offset == 0x00:
        S[IWDG_UNLOCKED] = int(value == UNLOCK)
        if value == START and not S[IWDG_RUNNING]:
            S[IWDG_RUNNING] = 1
            rcc.start_lsi(S)
            _reload(S)
        elif value == RELOAD:
            _reload(S)
        S[ATTEND] = 1
    elif offset == 0x04:
        if S[IWDG_UNLOCKED]:
            _set_prescaler(S, value)
            S[ATTEND] = 1
    elif offset == 0x08:
        if S[IWDG_UNLOCKED]:
            S[IWDG_RLR] = value & 0xFFF
            S[IWDG_RVU_NS] = now_ns(S) + _UPDATE_NS
    else:
        return offset == 0x0C
    return True
