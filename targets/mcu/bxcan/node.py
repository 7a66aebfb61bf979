"""bxCAN as a node: what the bus tells it, and what the bus may ask of it. Instants come from the bus."""

from targets.jit import njit
from targets.mcu.bxcan import course, errors, fifos, loopback, mailboxes, modes, timing
from targets.mcu.bxcan.registers import ABOM, ALST, AWUM, SLAK, SLEEP, TERR, TXOK, WKUI
from targets.mcu.state import (
    CAN_BITRATE,
    CAN_BOFF,
    CAN_BUSY,
    CAN_LOST,
    CAN_MCR,
    CAN_MSR,
    CAN_SENDING,
    CAN_SOF_NS,
    State,
)

NONE = mailboxes.NONE
OFF, SILENT, PASSIVE, ACTIVE = range(4)
"""What `confinement` answers: `targets.ecu.Confinement`."""


@njit(cache=True)
def confinement(S: State, c: int) -> int:
    """How far it takes part in the bus."""
    if not modes.listens(S, c):
        return OFF
    if modes.is_silent(S, c):
        return SILENT
    return PASSIVE if errors.is_passive(S, c) else ACTIVE


@njit(cache=True)
def off_rate(S: State, c: int) -> bool:
    """On the bus, and set to another bit rate by more than the 0.5 % that resynchronisation makes up for."""
    bus = S[CAN_BITRATE + c]
    return bool(modes.listens(S, c) and abs(timing.bitrate(S, c) - bus) * 200 > bus)


@njit(cache=True)
def offer(S: State, c: int, t_ns: int) -> int:
    """The mailbox whose frame it would start at `t_ns`, NONE if none."""
    course.run_to(S, c, t_ns)
    if S[CAN_BUSY + c] != modes.IDLE or not modes.may_send(S, c):
        return NONE
    return mailboxes.first(S, c, t_ns)


@njit(cache=True)
def started(S: State, c: int, t_ns: int, mailbox: int) -> None:
    """A frame starts on the bus: its own of `mailbox`, NONE: another node's."""
    course.run_to(S, c, t_ns)
    modes.watched(S, c, t_ns)  # it ends a run of recessive bits
    S[CAN_BUSY + c] = modes.JOINED if modes.listens(S, c) else modes.OVERHEARD
    S[CAN_SOF_NS + c] = t_ns
    if mailbox != NONE:
        mailboxes.start(S, c, mailbox, t_ns)
    elif S[CAN_MSR + c] & SLAK:
        # its start of frame wakes the controller, which then needs 11 recessive bits: the frame is missed
        S[CAN_MSR + c] |= WKUI
        if S[CAN_MCR + c] & AWUM:
            S[CAN_MCR + c] &= ~SLEEP
            modes.settle(S, c, t_ns)
    course.plan(S, c)


@njit(cache=True)
def lost(S: State, c: int, mailbox: int) -> None:
    """The frame of `mailbox` took part in the arbitration of the frame that has just started, and lost."""
    mailboxes.failed(S, c, mailbox, ALST)


@njit(cache=True)
def receive(S: State, c: int, t_ns: int, head: int, data: int) -> bool:
    """Another node's frame ended well at `t_ns`. False if this one's bit rate is not the bus's.

    head: identifier register and, from bit 32 on, the length. data: eight bytes, little-endian.
    """
    rir, length = head & 0xFFFFFFFF, head >> 32
    low, high = data & 0xFFFFFFFF, data >> 32 & 0xFFFFFFFF
    if S[CAN_BUSY + c] == modes.IDLE:  # a bus that does not tell when frames start
        bits = loopback.frame_bits(rir, length, low, high)
        started(S, c, t_ns - timing.span_ns(S, c, bits), NONE)
    fits = True
    if S[CAN_BUSY + c] != modes.JOINED:
        S[CAN_LOST + c] += 1
    elif off_rate(S, c):
        fits = False
    else:
        errors.received(S, c)
        fifos.take(S, c, rir, length, timing.stamp(S, c, S[CAN_SOF_NS + c]), low, high)
    ended(S, c, t_ns)
    return fits


@njit(cache=True)
def sent(S: State, c: int, t_ns: int, mailbox: int) -> None:
    """The frame of `mailbox` ended well at `t_ns`."""
    if mailboxes.is_pending(S, c, mailbox):
        errors.transmitted(S, c)
        mailboxes.complete(S, c, mailbox, TXOK)
    ended(S, c, t_ns)


@njit(cache=True)
def error(S: State, c: int, t_ns: int, mailbox: int, code: int, tec: int, rec: int) -> None:
    """It saw an error in the frame under way, its own of `mailbox` or (NONE) another node's.

    code: last error code. tec, rec: what the error adds to the counters.
    """
    if S[CAN_BUSY + c] != modes.JOINED:
        return
    errors.count(S, c, code, tec, rec)
    if mailbox != NONE:
        mailboxes.failed(S, c, mailbox, TERR)
    if S[CAN_BOFF + c]:
        S[CAN_BUSY + c] = modes.OVERHEARD
        S[CAN_SENDING + c] = 0
        if S[CAN_MCR + c] & ABOM:
            modes.start_recovery(S, c, t_ns)
        course.plan(S, c)


@njit(cache=True)
def ended(S: State, c: int, t_ns: int) -> None:
    """The bus is free again after a frame or an error frame that ended at `t_ns`."""
    modes.bus_is_free(S, c, t_ns)
    course.plan(S, c)
