"""Flash interface (RM0090 section 3): the access control register. Wait states do not cost time yet."""

from targets.jit import njit
from targets.mcu.state import FLASH_ACR, State

BASE = 0x40023C00


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    return S[FLASH_ACR] if offset == 0 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    if offset != 0:
        return False
    S[FLASH_ACR] = value
    return True
