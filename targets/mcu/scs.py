"""System control space beside the NVIC: SCB, FPU, and DWT's cycle counter (ARMv7-M B3, C1)."""

from targets.jit import njit
from targets.mcu.state import (
    ATTEND,
    CCR,
    CPACR,
    CYCLES,
    DEMCR,
    DWT_CTRL,
    DWT_OFFSET,
    FPCCR,
    RESET_REQUEST,
    SCR,
    SHCSR,
    VTOR,
    State,
)

CPUID = 0x410FC241  # Cortex-M4 r0p1
M32 = 0xFFFFFFFF


def reset(S: State) -> None:
    """Reset values; the vector table is at the start of flash, where the boot pins put it."""
    S[VTOR] = 0x08000000
    S[CCR] = 0x200
    S[FPCCR] = 0xC0000000
    S[DWT_CTRL] = 0x40000000


@njit(cache=True)
def read(S: State, address: int) -> int:
    """Value of the register at `address`, -1 if it is not modelled."""
    if address == 0xE0001000:
        return S[DWT_CTRL]
    if address == 0xE0001004:
        return (S[CYCLES] - S[DWT_OFFSET]) & M32 if S[DWT_CTRL] & 1 else S[DWT_OFFSET] & M32
    if address == 0xE000EDFC:
        return S[DEMCR]
    if address == 0xE000ED00:
        return CPUID
    if address == 0xE000ED08:
        return S[VTOR]
    if address == 0xE000ED0C:
        return 0xFA050000
    if address == 0xE000ED10:
        return S[SCR]
    if address == 0xE000ED14:
        return S[CCR]
    if address == 0xE000ED24:
        return S[SHCSR]
    if address == 0xE000ED88:
        return S[CPACR]
    if address == 0xE000EF34:
        return S[FPCCR]
    return -1


@njit(cache=True)
def write(S: State, address: int, value: int) -> bool:
    """Write the register at `address`; False if it is not modelled."""
    if address == 0xE0001000:
        _count(S, value & 1)
        S[DWT_CTRL] = 0x40000000 | value & 0xFFFFFFF
    elif address == 0xE0001004:
        S[DWT_OFFSET] = S[CYCLES] - value if S[DWT_CTRL] & 1 else value
    elif address == 0xE000EDFC:
        S[DEMCR] = value
    elif address == 0xE000ED08:
        S[VTOR] = value & 0xFFFFFF80
    elif address == 0xE000ED0C:
        if value >> 16 == 0x05FA and value & 4:
            S[RESET_REQUEST] = 1
            S[ATTEND] = 1
    elif address == 0xE000ED10:
        S[SCR] = value
    elif address == 0xE000ED14:
        S[CCR] = value
    elif address == 0xE000ED24:
        S[SHCSR] = value
    elif address == 0xE000ED88:
        S[CPACR] = value
    elif address == 0xE000EF34:
        S[FPCCR] = value
    else:
        return False
    return True


@njit(cache=True)
def _count(S: State, enable: int) -> None:
    """CYCCNT starts or stops: while stopped the slot holds its value, while running the offset to CYCLES."""
    running = S[DWT_CTRL] & 1
    if enable and not running:
        S[DWT_OFFSET] = S[CYCLES] - S[DWT_OFFSET]
    elif running and not enable:
        S[DWT_OFFSET] = (S[CYCLES] - S[DWT_OFFSET]) & M32
