"""CRC unit (RM0090 section 4): CRC-32 (Ethernet) polynomial, a word at a time, most significant bit first."""

import numpy as np

from targets.jit import njit
from targets.mcu.state import CRC_DR, CRC_IDR, State

BASE = 0x40023000
POLYNOMIAL = 0x04C11DB7


def _table() -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """What each byte in the remainder's upper end adds to the rest."""
    table = np.arange(256, dtype=np.int64) << 24
    for _ in range(8):
        table = (table << 1 ^ np.where(table >> 31 & 1, POLYNOMIAL, 0)) & 0xFFFFFFFF
    return table


_TABLE = _table()


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of section 4.4."""
    S[CRC_DR] = 0xFFFFFFFF
    S[CRC_IDR] = 0


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset == 0x00:
        return S[CRC_DR]
    if offset == 0x04:
        return S[CRC_IDR]
    return 0 if offset == 0x08 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    if offset == 0x00:
        remainder = S[CRC_DR] ^ value
        for _ in range(4):
            remainder = remainder << 8 & 0xFFFFFFFF ^ _TABLE[remainder >> 24]
        S[CRC_DR] = remainder
    elif offset == 0x04:
        S[CRC_IDR] = value & 0xFF
    elif offset == 0x08:
        if value & 1:
            S[CRC_DR] = 0xFFFFFFFF
    else:
        return False
    return True
