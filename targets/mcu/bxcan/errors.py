"""bxCAN's error counters, flags and error interrupt (RM0090 section 32.7.6, ISO 11898-1 clause 12.1.4).

How much an error counts, the bus says, which knows the rules; here stand the counters and what follows.
"""

from targets.jit import njit
from targets.mcu.bxcan.registers import BOFF, BOFIE, EPVF, EPVIE, ERRI, EWGF, EWGIE, LEC, LECIE
from targets.mcu.state import CAN_BOFF, CAN_IER, CAN_LEC, CAN_MSR, CAN_REC, CAN_TEC, State

WARNING, PASSIVE, BUS_OFF = 96, 128, 256
_REC_MAX = 255
_REC_AFTER = 120  # of a controller that was beyond the passive limit and has received (CAN_ESR, REC)


@njit(cache=True)
def is_passive(S: State, c: int) -> bool:
    """Error passive: at least one counter beyond 127."""
    return S[CAN_TEC + c] >= PASSIVE or S[CAN_REC + c] >= PASSIVE


@njit(cache=True)
def flags(S: State, c: int) -> int:
    """EWGF, EPVF and BOFF."""
    tec, rec = S[CAN_TEC + c], S[CAN_REC + c]
    value = BOFF if S[CAN_BOFF + c] else 0
    if tec >= PASSIVE or rec >= PASSIVE:
        value |= EPVF
    if tec >= WARNING or rec >= WARNING:
        value |= EWGF
    return value


@njit(cache=True)
def read(S: State, c: int) -> int:
    """ESR."""
    counters = S[CAN_REC + c] << 24 | (S[CAN_TEC + c] & 0xFF) << 16
    return counters | S[CAN_LEC + c] << 4 | flags(S, c)


@njit(cache=True)
def write(S: State, c: int, value: int) -> None:
    """ESR takes LEC only: software sets it to 7 to see the next update."""
    S[CAN_LEC + c] = (value & LEC) >> 4


@njit(cache=True)
def count(S: State, c: int, code: int, tec: int, rec: int) -> None:
    """An error of last-error code `code`, which adds to the counters; ERRI, if what it sets is enabled."""
    before = flags(S, c)
    S[CAN_TEC + c] += tec
    S[CAN_REC + c] = min(S[CAN_REC + c] + rec, _REC_MAX)
    S[CAN_LEC + c] = code
    if S[CAN_TEC + c] >= BUS_OFF:
        S[CAN_BOFF + c] = 1
    risen, ier = flags(S, c) & ~before, S[CAN_IER + c]
    if (
        ier & LECIE
        or (ier & EWGIE and risen & EWGF)
        or (ier & EPVIE and risen & EPVF)
        or (ier & BOFIE and risen & BOFF)
    ):
        S[CAN_MSR + c] |= ERRI


@njit(cache=True)
def transmitted(S: State, c: int) -> None:
    """A frame was sent without error."""
    S[CAN_LEC + c] = 0
    S[CAN_TEC + c] = max(S[CAN_TEC + c] - 1, 0)


@njit(cache=True)
def received(S: State, c: int) -> None:
    """A frame was received without error."""
    S[CAN_LEC + c] = 0
    rec = S[CAN_REC + c]
    S[CAN_REC + c] = _REC_AFTER if rec > PASSIVE else max(rec - 1, 0)


@njit(cache=True)
def recover(S: State, c: int) -> None:
    """Bus-off is over."""
    S[CAN_BOFF + c] = S[CAN_TEC + c] = S[CAN_REC + c] = 0
