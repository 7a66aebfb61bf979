"""Power controller (RM0090 section 5.4), as far as start-up code asks it: voltage scale, backup domain."""

from targets.jit import njit
from targets.mcu.state import PWR_CR, PWR_CSR, State

BASE = 0x40007000
VOS = 1 << 14
_STORED = 0x43F3  # all but CSBF and CWUF, which clear flags and read as zero
_STOP_AND_PVD = 0x0213  # LPDS, PDDS, PVDE, FPDS: what they bring about is not modelled
_BACKUP_REGULATOR = 1 << 9


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 5.4: voltage scale 1."""
    S[PWR_CR] = VOS
    S[PWR_CSR] = 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset == 0x00:
        return S[PWR_CR]
    if offset == 0x04:  # VOSRDY, and the backup regulator ready (BRR) as soon as it is on
        return S[PWR_CSR] | VOS | (8 if S[PWR_CSR] & _BACKUP_REGULATOR else 0)
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    if offset == 0x00:
        S[PWR_CR] = value & _STORED
        return value & _STOP_AND_PVD == 0
    if offset == 0x04:
        S[PWR_CSR] = value & (_BACKUP_REGULATOR | 1 << 8)
        return True
    return False
