"""Instrumentation trace macrocell (ARMv7-M C1.7) and the trace port behind it, as a log.

What a program writes to a stimulus port is out at once: the trace port is never slower than the program.
"""

from targets.jit import njit
from targets.mcu import records
from targets.mcu.clock import now_ns
from targets.mcu.state import DEMCR, ITM_TCR, ITM_TER, ITM_TPR, ITM_UNLOCKED, TPIU, State

BASE = 0xE0000000
SIZE = 0x1000
TPIU_BASE = 0xE0040000
KEY = 0xC5ACCE55
SIZE_SHIFT, PORT_SHIFT = 32, 36
"""Where a record of the log holds how many bytes were written, and to which stimulus port."""
RING = records.LOG + 6
TRCENA = 1 << 24


@njit(cache=True)
def reset(S: State) -> None:
    """Reset values of C1.7: off and locked, the trace port (C1.10) one pin wide."""
    S[ITM_TER] = S[ITM_TPR] = S[ITM_TCR] = S[ITM_UNLOCKED] = 0
    for k, value in enumerate((1, 0, 1, 0x102)):
        S[TPIU + k] = value


@njit(cache=True)
def _is_open(S: State, port: int) -> bool:
    """Whether a stimulus port lets anything through."""
    return S[DEMCR] & TRCENA != 0 and S[ITM_TCR] & 1 == 1 and S[ITM_TER] >> port & 1 == 1


@njit(cache=True)
def stimulate(S: State, port: int, size: int, value: int) -> None:
    """`size` bytes written to a stimulus port: the log's record is the instant, then value, size and port."""
    if _is_open(S, port):
        records.append(S, RING, (now_ns(S), value | size << SIZE_SHIFT | port << PORT_SHIFT))


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset < 0x80:  # FIFOREADY
        return int(_is_open(S, offset // 4))
    if offset == 0xE00:
        return S[ITM_TER]
    if offset == 0xE40:
        return S[ITM_TPR]
    if offset == 0xE80:
        return S[ITM_TCR]
    if offset == 0xFB4:
        return 1 if S[ITM_UNLOCKED] else 3
    return 0 if offset == 0xFB0 else -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`, which is no stimulus port; False if it is not modelled."""
    if offset == 0xFB0:
        S[ITM_UNLOCKED] = int(value == KEY)
    elif offset == 0xE00:
        if S[ITM_UNLOCKED]:
            S[ITM_TER] = value
    elif offset == 0xE40:
        if S[ITM_UNLOCKED]:
            S[ITM_TPR] = value & 0xF
    elif offset == 0xE80:
        if S[ITM_UNLOCKED]:
            S[ITM_TCR] = value & 0x007F0F1F
    else:
        return False
    return True


@njit(cache=True)
def _port_register(offset: int) -> int:
    """The slot of CSPSR, ACPR, SPPR or FFCR, -1 for another register."""
    if offset == 0x004:
        return TPIU
    if offset == 0x010:
        return TPIU + 1
    if offset == 0x0F0:
        return TPIU + 2
    return TPIU + 3 if offset == 0x304 else -1


@njit(cache=True)
def read_port(S: State, offset: int) -> int:
    """Value of the trace port's register at `offset`, -1 if it is not modelled."""
    slot = _port_register(offset)
    return S[slot] if slot >= 0 else -1


@njit(cache=True)
def write_port(S: State, offset: int, value: int) -> bool:
    """Write the trace port's register at `offset`; False if it is not modelled."""
    slot = _port_register(offset)
    if slot < 0:
        return False
    S[slot] = value
    return True
