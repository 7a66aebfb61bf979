"""Electronic signature in system memory (RM0090 section 39) and the debug unit's registers (section 38.6)."""

from targets.jit import njit
from targets.mcu.state import DBGMCU, State

BASE = 0x1FFF0000
SIZE = 0x10000
UNIQUE_ID = (0x00420024, 0x32345117, 0x38353635)
"""96 bits at 0x1FFF7A10: X 36 and Y 66 on wafer 23 of lot "Q425658"; the same in every emulator."""
FLASH_KBYTE = 1024
DBGMCU_BASE = 0xE0042000
IDCODE = 0x100F6413  # STM32F405xx, revision Y

_UNIQUE_ID_AT, _FLASH_SIZE_AT = 0x7A10, 0x7A20
_CR, _APB1_FZ, _APB2_FZ = 0x000000E7, 0x06E01DFF, 0x00070003


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """The word at `offset` of system memory, -1 if what it holds is not known."""
    if _UNIQUE_ID_AT <= offset < _UNIQUE_ID_AT + 12:
        return UNIQUE_ID[(offset - _UNIQUE_ID_AT) // 4]
    if offset == _FLASH_SIZE_AT:  # the upper half-word; the lower one is reserved
        return FLASH_KBYTE << 16 | 0xFFFF
    return -1


@njit(cache=True)
def read_debug(S: State, offset: int) -> int:
    """Value of DBGMCU's register at `offset`, -1 if there is none."""
    if offset == 0x00:
        return IDCODE
    return S[DBGMCU + offset // 4 - 1] if offset <= 0x0C else -1


@njit(cache=True)
def write_debug(S: State, offset: int, value: int) -> bool:
    """Write DBGMCU's register at `offset`; False if there is none. No debugger halts the core: no effect."""
    if not 0x04 <= offset <= 0x0C:
        return False
    S[DBGMCU + offset // 4 - 1] = value & (_CR, _APB1_FZ, _APB2_FZ)[offset // 4 - 1]
    return True
