"""bxCAN's two receive FIFOs of three messages (RM0090 section 32.7.3)."""

from targets.jit import njit
from targets.mcu.bxcan import filters
from targets.mcu.bxcan.registers import FOVR, FULL, RFLM, RFOM
from targets.mcu.rcc import apb1_divisor
from targets.mcu.state import (
    CAN_FIFO,
    CAN_FIFO_COUNT,
    CAN_FIFO_FLAGS,
    CAN_LOST,
    CAN_MCR,
    CAN_RELEASED,
    CYCLES,
    State,
)

DEPTH = 3
_BUSY_CLOCKS = 2  # of APB1: RFOM reads as set so long; the manual gives no figure


@njit(cache=True)
def take(S: State, c: int, rir: int, length: int, time: int, low: int, high: int) -> None:
    """A valid message: into the FIFO of the filter that lets it in, if one does."""
    found = filters.match(S, c, rir)
    if found == filters.NONE:
        S[CAN_LOST + c] += 1
        return
    fifo = found >> 8
    count = S[CAN_FIFO_COUNT + c + fifo]
    if count == DEPTH:
        S[CAN_FIFO_FLAGS + c + fifo] |= FOVR
        S[CAN_LOST + c] += 1
        if S[CAN_MCR + c] & RFLM:  # locked: the newest is discarded
            return
        count = DEPTH - 1  # else it overwrites the last one stored
    at = CAN_FIFO + c + 12 * fifo + 4 * count
    S[at] = rir
    S[at + 1] = time << 16 | (found & 0xFF) << 8 | length
    S[at + 2] = low
    S[at + 3] = high
    S[CAN_FIFO_COUNT + c + fifo] = count + 1
    if count + 1 == DEPTH:
        S[CAN_FIFO_FLAGS + c + fifo] |= FULL


@njit(cache=True)
def read(S: State, c: int, fifo: int) -> int:
    """RFxR: messages pending, FULL, FOVR, and RFOM for a moment after a release."""
    busy = RFOM if S[CAN_RELEASED + c + fifo] > S[CYCLES] else 0
    return S[CAN_FIFO_COUNT + c + fifo] | S[CAN_FIFO_FLAGS + c + fifo] | busy


@njit(cache=True)
def write(S: State, c: int, fifo: int, value: int) -> None:
    """Write RFxR: a one clears FULL or FOVR, RFOM releases the output mailbox."""
    S[CAN_FIFO_FLAGS + c + fifo] &= ~(value & (FULL | FOVR))
    count = S[CAN_FIFO_COUNT + c + fifo]
    if not value & RFOM or count == 0:
        return
    at = CAN_FIFO + c + 12 * fifo
    for k in range(8):
        S[at + k] = S[at + k + 4]
    S[CAN_FIFO_COUNT + c + fifo] = count - 1
    S[CAN_RELEASED + c + fifo] = S[CYCLES] + _BUSY_CLOCKS * apb1_divisor(S)
