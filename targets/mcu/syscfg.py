"""System configuration controller (RM0090 section 9.2): which port each external interrupt line looks at."""

from targets.jit import njit
from targets.mcu.state import SYSCFG, State

BASE = 0x40013800
MEMRMP, PMC, EXTICR, CMPCR = 0, 1, 2, 6


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 9.2: the boot pins select main flash."""
    for register in range(7):
        S[SYSCFG + register] = 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset < 0x18:
        return S[SYSCFG + offset // 4]
    if offset == 0x20:  # READY follows CMP_PD
        return S[SYSCFG + CMPCR] | S[SYSCFG + CMPCR] << 8
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled, as is any other memory mapped at 0."""
    register = offset // 4
    if register == MEMRMP:
        S[SYSCFG + MEMRMP] = value & 3
        return value & 3 == 0
    if register == PMC:
        S[SYSCFG + PMC] = value & 1 << 23
    elif register < CMPCR:
        S[SYSCFG + register] = value & 0xFFFF
    elif offset == 0x20:
        S[SYSCFG + CMPCR] = value & 1
    else:
        return False
    return True
