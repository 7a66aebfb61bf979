"""Memory protection unit (ARMv7-M B3.5): its registers. They protect nothing: see FIDELITY.md."""

from targets.jit import njit
from targets.mcu.state import MPU_CTRL, MPU_RASR, MPU_RBAR, MPU_RNR, State

BASE, SIZE = 0xE000ED90, 0x2C
REGIONS = 8
ENABLE, VALID = 1, 1 << 4


@njit(cache=True)
def reset(S: State) -> None:
    """Off; the regions hold nothing."""
    S[MPU_CTRL] = S[MPU_RNR] = 0
    S[MPU_RBAR : MPU_RBAR + REGIONS] = 0
    S[MPU_RASR : MPU_RASR + REGIONS] = 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from BASE, -1 if it is not modelled."""
    if offset == 0x00:
        return REGIONS << 8
    if offset == 0x04:
        return S[MPU_CTRL]
    if offset == 0x08:
        return S[MPU_RNR]
    region = S[MPU_RNR]
    if offset & 4:  # RBAR and its aliases, at 0x0C, 0x14, 0x1C, 0x24
        return S[MPU_RBAR + region] | region
    return S[MPU_RASR + region]


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset` from BASE; False for what is not modelled: to switch protection on."""
    if offset == 0x04:
        S[MPU_CTRL] = value & 7
        return value & ENABLE == 0
    if offset == 0x08:
        S[MPU_RNR] = value & (REGIONS - 1)
    elif offset >= 0x0C:
        if offset & 4:
            if value & VALID:
                S[MPU_RNR] = value & (REGIONS - 1)
            S[MPU_RBAR + S[MPU_RNR]] = value & ~0x1F
        else:
            S[MPU_RASR + S[MPU_RNR]] = value & 0x173FFF3F
    return True
