"""Flash interface (RM0090 section 3): the access control register. What it costs to wait is in `art`."""

from targets.jit import njit
from targets.mcu import art
from targets.mcu.state import FLASH_ACR, State

BASE = 0x40023C00
ICRST = 1 << 11


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    return S[FLASH_ACR] if offset == 0 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    if offset != 0:
        return False
    if value & ICRST and not value & art.ICACHE:
        art.clear(S)
    S[FLASH_ACR] = value & 0x1F0F
    return True
