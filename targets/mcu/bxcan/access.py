"""bxCAN's registers as the CPU reads and writes them (RM0090 section 32.9)."""

from targets.jit import njit
from targets.mcu.bxcan import course, errors, fifos, filters, loopback, mailboxes, modes
from targets.mcu.bxcan.registers import (
    BTR_RESET,
    BTR_WRITABLE,
    CONTROLLER_SIZE,
    ERRI,
    INAK,
    MCR_RESET,
    RESET,
    RX,
    RXM,
    SAMP,
    SLAK,
    SLAKI,
    TSR_RESET,
    TXM,
    TXRQ,
    WKUI,
)
from targets.mcu.clock import now_ns
from targets.mcu.state import (
    ATTEND,
    CAN_BITRATE,
    CAN_BTR,
    CAN_BUSY,
    CAN_DUE_NS,
    CAN_FIFO,
    CAN_FIFO_COUNT,
    CAN_IER,
    CAN_LEC,
    CAN_LOOP_NS,
    CAN_MAILBOX,
    CAN_MCR,
    CAN_MSR,
    CAN_RECOVER,
    CAN_RELEASED,
    CAN_SENDING,
    CAN_STRIDE,
    CAN_STUCK_NS,
    CAN_SYNC,
    CAN_TSR,
    CAN_TX_NEW,
    State,
)

_MCR_WRITABLE = 0x000100FF
_IER_WRITABLE = 0x00038F7F
_TDTR_WRITABLE = 0xFFFF010F
_PER_CONTROLLER = (CAN_BITRATE, CAN_BUSY)
"""What a reset of the MCU leaves: the bus outside."""


def reset(S: State) -> None:
    """Reset values of both controllers and of the filters: asleep, mailboxes empty."""
    for c in (0, CAN_STRIDE):
        outside = [S[slot + c] for slot in _PER_CONTROLLER]
        S[CAN_MCR + c : CAN_BITRATE + c] = 0
        for slot, value in zip(_PER_CONTROLLER, outside, strict=True):
            S[slot + c] = value
        S[CAN_BTR + c] = BTR_RESET
        _reset_controller(S, c)
    S[CAN_TX_NEW] = 0
    filters.reset(S)


@njit(cache=True)
def _reset_controller(S: State, c: int) -> None:
    """What MCR's RESET does: asleep, FIFOs and mailboxes empty; BTR, IER and the filters stay."""
    S[CAN_MCR + c] = MCR_RESET
    S[CAN_MSR + c] = SLAK
    S[CAN_TSR + c] = TSR_RESET
    S[CAN_LEC + c] = 0
    errors.recover(S, c)
    S[CAN_FIFO_COUNT + c : CAN_RELEASED + 2 + c] = 0
    for mailbox in range(mailboxes.MAILBOXES):
        S[CAN_MAILBOX + c + 4 * mailbox] &= ~TXRQ
    S[CAN_SENDING + c] = S[CAN_SYNC + c] = S[CAN_RECOVER + c] = 0
    if S[CAN_BUSY + c] == modes.JOINED:
        S[CAN_BUSY + c] = modes.OVERHEARD
    S[CAN_LOOP_NS + c] = S[CAN_STUCK_NS + c] = S[CAN_DUE_NS + c] = course.NEVER


@njit(cache=True)
def _msr(S: State, c: int) -> int:
    """MSR; FIDELITY: SAMP and RX read recessive at all times."""
    value = S[CAN_MSR + c] | SAMP | RX
    if S[CAN_SENDING + c]:
        return value | TXM
    return value | RXM if S[CAN_BUSY + c] == modes.JOINED else value


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from CAN1's base, -1 if it is not modelled."""
    c = 0 if offset < CONTROLLER_SIZE else CAN_STRIDE
    offset &= CONTROLLER_SIZE - 1
    if S[CAN_DUE_NS + c] != course.NEVER:
        course.run_to(S, c, now_ns(S))
    if offset == 0x00:
        return S[CAN_MCR + c]
    if offset == 0x04:
        return _msr(S, c)
    if offset == 0x08:
        return mailboxes.read_tsr(S, c)
    if offset in (0x0C, 0x10):
        return fifos.read(S, c, (offset - 0x0C) // 4)
    if offset == 0x14:
        return S[CAN_IER + c]
    if offset == 0x18:
        return errors.read(S, c)
    if offset == 0x1C:
        return S[CAN_BTR + c]
    if 0x180 <= offset < 0x1B0:
        return S[CAN_MAILBOX + c + (offset - 0x180) // 4]
    if 0x1B0 <= offset < 0x1D0:
        word = (offset - 0x1B0) // 4
        return S[CAN_FIFO + c + 12 * (word // 4) + word % 4]
    return filters.read(S, offset) if c == 0 else -1


@njit(cache=True)
def _write_mailbox(S: State, c: int, word: int, value: int) -> None:
    mailbox = word // 4
    if mailboxes.is_pending(S, c, mailbox):
        return  # read-only
    S[CAN_MAILBOX + c + word] = value & _TDTR_WRITABLE if word % 4 == 1 else value
    if word % 4 == 0 and value & TXRQ:
        mailboxes.request(S, c, mailbox)
        if S[CAN_BITRATE + c] and modes.may_send(S, c):
            S[CAN_TX_NEW] |= 1 << (8 * (c // CAN_STRIDE) + mailbox)
        course.asked(S, c, mailbox, now_ns(S))


@njit(cache=True)
def _act(S: State, c: int, offset: int, value: int) -> None:
    """Writes from which something may follow by itself."""
    if offset == 0x04:
        S[CAN_MSR + c] &= ~(value & (ERRI | WKUI | SLAKI))
    elif offset == 0x08:
        mailboxes.write_tsr(S, c, value)
    elif offset:
        _write_mailbox(S, c, (offset - 0x180) // 4, value)
    elif value & RESET:
        _reset_controller(S, c)
    else:
        S[CAN_MCR + c] = value & _MCR_WRITABLE
        modes.settle(S, c, now_ns(S))


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset` from CAN1's base; False if it is not modelled."""
    c = 0 if offset < CONTROLLER_SIZE else CAN_STRIDE
    offset &= CONTROLLER_SIZE - 1
    S[ATTEND] = 1  # lines and requests may have changed
    if S[CAN_DUE_NS + c] != course.NEVER:
        course.run_to(S, c, now_ns(S))
    if offset == 0x14:
        S[CAN_IER + c] = value & _IER_WRITABLE
    elif offset in (0x0C, 0x10):
        fifos.write(S, c, (offset - 0x0C) // 4, value)
    elif offset == 0x18:
        errors.write(S, c, value)
    elif offset == 0x1C:
        if S[CAN_MSR + c] & INAK:  # in initialisation mode only
            S[CAN_BTR + c] = value & BTR_WRITABLE
    elif offset >= 0x200:
        return c == 0 and filters.write(S, offset, value)
    elif offset in (0x00, 0x04, 0x08) or 0x180 <= offset < 0x1B0:
        _act(S, c, offset, value)
        loopback.kick(S, c, now_ns(S), course.NEVER)
        course.plan(S, c)
    else:
        return False
    return True
