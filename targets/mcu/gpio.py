"""General-purpose pins A to I (RM0090 section 8), as registers."""

from targets.jit import njit
from targets.mcu.state import GPIO, GPIO_STRIDE, State

BASE = 0x40020000
PORTS = 9
ODR = 5


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from port A's first, -1 if it is not modelled."""
    port, register = offset // 0x400, (offset % 0x400) // 4
    if register in (6, 7) or register >= GPIO_STRIDE:
        return -1
    if register == 4:  # IDR: outputs read back, nothing drives the inputs
        register = ODR
    return S[GPIO + GPIO_STRIDE * port + register]


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    port, register = offset // 0x400, (offset % 0x400) // 4
    at = GPIO + GPIO_STRIDE * port
    if register == 6:  # BSRR: set in the low half wins over reset in the high half
        S[at + ODR] = S[at + ODR] & ~(value >> 16) | value & 0xFFFF
        return True
    if register in (4, 7) or register >= GPIO_STRIDE:
        return False
    S[at + register] = value
    return True
