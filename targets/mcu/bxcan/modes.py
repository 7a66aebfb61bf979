"""bxCAN's operating modes and its synchronisation to the bus (RM0090 sections 32.4 and 32.7.6).

Leaving initialisation or sleep waits for 11 recessive bits in a row, leaving bus-off for 128 times as many.
They are not stepped through: the bus says when a frame starts and ends, and the instant follows.
"""

from targets.jit import njit
from targets.mcu.bxcan import errors, mailboxes, timing
from targets.mcu.bxcan.registers import ABOM, INAK, INRQ, LBKM, SILM, SLAK, SLAKI, SLEEP, SLKIE
from targets.mcu.state import (
    CAN_BITRATE,
    CAN_BOFF,
    CAN_BTR,
    CAN_BUSY,
    CAN_EPOCH_NS,
    CAN_IER,
    CAN_MCR,
    CAN_MSR,
    CAN_RECOVER,
    CAN_SENDING,
    CAN_SYNC,
    CAN_WATCH_NS,
    State,
)

IDLE, OVERHEARD, JOINED = 0, 1, 2  # CAN_BUSY
RECESSIVE_BITS = 11
SEQUENCES = 128  # before the end of bus-off
TRAILING_BITS = 8
"""Recessive bits at the end of every frame: ACK delimiter and end of frame, or the error delimiter."""


@njit(cache=True)
def in_normal_mode(S: State, c: int) -> bool:
    """Neither initialisation nor sleep is acknowledged."""
    return S[CAN_MSR + c] & (INAK | SLAK) == 0


@njit(cache=True)
def loops_back(S: State, c: int) -> bool:
    """In loop-back mode (32.5.2), where the bus is not heard."""
    return S[CAN_BTR + c] & LBKM != 0


@njit(cache=True)
def is_silent(S: State, c: int) -> bool:
    """In silent mode (32.5.1): hears, and drives nothing dominant."""
    return S[CAN_BTR + c] & SILM != 0


@njit(cache=True)
def listens(S: State, c: int) -> bool:
    """Whether frames that start on the bus now are followed."""
    return in_normal_mode(S, c) and not S[CAN_BOFF + c] and not loops_back(S, c)


@njit(cache=True)
def may_send(S: State, c: int) -> bool:
    """Whether a frame may be started on the bus now, as far as modes go."""
    return listens(S, c) and not is_silent(S, c) and S[CAN_MCR + c] & (INRQ | SLEEP) == 0


@njit(cache=True)
def announce(S: State, c: int) -> None:
    """Requests that waited for this mode may be sent from now on."""
    if S[CAN_BITRATE + c] and may_send(S, c):
        mailboxes.announce(S, c)


@njit(cache=True)
def _watch(S: State, c: int, t_ns: int) -> None:
    if S[CAN_SYNC + c] == 0 and S[CAN_RECOVER + c] == 0:
        S[CAN_WATCH_NS + c] = t_ns


@njit(cache=True)
def start_recovery(S: State, c: int, t_ns: int) -> None:
    """From `t_ns` on the bus-off controller counts recessive bits."""
    _watch(S, c, t_ns)
    S[CAN_RECOVER + c] = SEQUENCES


@njit(cache=True)
def _synchronise(S: State, c: int, t_ns: int) -> None:
    if S[CAN_SYNC + c] == 0:
        _watch(S, c, t_ns)
        S[CAN_SYNC + c] = 1


@njit(cache=True)
def _stop_watching(S: State, c: int) -> None:
    # In initialisation and sleep mode CANRX is not monitored.
    S[CAN_SYNC + c] = S[CAN_RECOVER + c] = 0


@njit(cache=True)
def _initialise(S: State, c: int) -> None:
    _stop_watching(S, c)
    S[CAN_MSR + c] = S[CAN_MSR + c] & ~(SLAK | SLAKI) | INAK


@njit(cache=True)
def _sleep(S: State, c: int) -> None:
    _stop_watching(S, c)
    S[CAN_MSR + c] = S[CAN_MSR + c] & ~INAK | SLAK
    if S[CAN_IER + c] & SLKIE:
        S[CAN_MSR + c] |= SLAKI


@njit(cache=True)
def settle(S: State, c: int, t_ns: int) -> None:
    """Follow what MCR requests, as far as the present mode and the frame under way allow (figure 336)."""
    mcr, msr = S[CAN_MCR + c], S[CAN_MSR + c]
    if msr & SLAK:
        if mcr & SLEEP:  # INRQ alone does not end sleep
            S[CAN_SYNC + c] = 0
        elif mcr & INRQ:
            _initialise(S, c)
        else:
            _synchronise(S, c, t_ns)
    elif msr & INAK:
        if mcr & INRQ:
            _stop_watching(S, c)
        elif mcr & SLEEP:
            _sleep(S, c)
        else:
            if S[CAN_BOFF + c] and S[CAN_RECOVER + c] == 0:
                start_recovery(S, c, t_ns)
            _synchronise(S, c, t_ns)
    elif S[CAN_BUSY + c] != JOINED and S[CAN_SENDING + c] == 0:
        if mcr & INRQ:
            _initialise(S, c)
        elif mcr & SLEEP:
            _sleep(S, c)
        elif mcr & ABOM and S[CAN_BOFF + c] and S[CAN_RECOVER + c] == 0:
            start_recovery(S, c, t_ns)


@njit(cache=True)
def watched(S: State, c: int, t_ns: int) -> None:
    """Count the recessive bits up to `t_ns`, if the bus is idle and they matter."""
    sync, left = S[CAN_SYNC + c], S[CAN_RECOVER + c]
    if S[CAN_BUSY + c] != IDLE or (sync == 0 and left == 0):
        return
    begun = S[CAN_WATCH_NS + c]
    seen = min(timing.whole_spans(S, c, t_ns - begun, RECESSIVE_BITS), max(sync, left))
    if seen == 0:
        return
    S[CAN_WATCH_NS + c] = begun + timing.span_ns(S, c, seen * RECESSIVE_BITS)
    S[CAN_RECOVER + c] = max(left - seen, 0)
    if left and S[CAN_RECOVER + c] == 0:
        errors.recover(S, c)
    if sync:
        S[CAN_SYNC + c] = 0
        S[CAN_MSR + c] &= ~(INAK | SLAK | SLAKI)
        S[CAN_EPOCH_NS + c] = begun + timing.span_ns(S, c, RECESSIVE_BITS)
    settle(S, c, t_ns)  # back from sleep, a bus-off with ABOM goes on
    announce(S, c)


@njit(cache=True)
def next_ns(S: State, c: int, never: int) -> int:
    """When `watched` next changes something if the bus stays idle, `never` if nothing is waited for."""
    sync, left = S[CAN_SYNC + c], S[CAN_RECOVER + c]
    if S[CAN_BUSY + c] != IDLE or (sync == 0 and left == 0):
        return never
    return S[CAN_WATCH_NS + c] + timing.span_ns(S, c, RECESSIVE_BITS * (sync if sync else left))


@njit(cache=True)
def bus_is_free(S: State, c: int, t_ns: int) -> None:
    """A frame, good or bad, ended on the bus at `t_ns`."""
    if S[CAN_BUSY + c] == JOINED:
        S[CAN_SENDING + c] = 0
    S[CAN_BUSY + c] = IDLE
    if S[CAN_SYNC + c] or S[CAN_RECOVER + c]:
        recessive_ns = t_ns - timing.span_ns(S, c, TRAILING_BITS)
        S[CAN_WATCH_NS + c] = max(S[CAN_WATCH_NS + c], recessive_ns)
    settle(S, c, t_ns)
