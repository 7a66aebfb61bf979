"""bxCAN 1 (RM0090 section 32) at register level: modes, mailboxes, filters, FIFOs, receive interrupt lines.

The bus tells it of frames that ended (`receive`) and of its own that were sent (`sent`). Not modelled: error
counters, silent and loop-back mode, time-triggered mode, abort of a frame on the wire (FIDELITY.md).
"""

from targets.jit import njit
from targets.mcu.clock import now_ns
from targets.mcu.rcc import apb1_divisor
from targets.mcu.state import (
    ATTEND,
    CAN_BTR,
    CAN_ESR,
    CAN_FA1R,
    CAN_FFA1R,
    CAN_FIFO,
    CAN_FIFO_COUNT,
    CAN_FIFO_FLAGS,
    CAN_FILTER,
    CAN_FM1R,
    CAN_FMR,
    CAN_FS1R,
    CAN_IER,
    CAN_LOST,
    CAN_MAILBOX,
    CAN_MCR,
    CAN_MSR,
    CAN_TSR,
    CAN_TX_NEW,
    CAN_TX_NS,
    HZ,
    State,
)

BASE = 0x40006400
SIZE = 0x400
TX_IRQ, RX0_IRQ, RX1_IRQ = 19, 20, 21
INRQ, SLEEP = 1, 2
TME = 0x1C000000
RQCP, TXOK = 1, 2
FULL, FOVR = 1 << 3, 1 << 4
BANKS = 28


def reset(S: State) -> None:
    """Reset values of section 32.9: asleep, mailboxes empty."""
    S[CAN_MCR] = 0x00010002
    S[CAN_MSR] = 0x00000C02
    S[CAN_TSR] = TME
    S[CAN_BTR] = 0x01230000
    S[CAN_FMR] = 0x2A1C0E01


@njit(cache=True)
def bitrate(S: State) -> int:
    """Bits per second that BTR gives at the present clock."""
    btr = S[CAN_BTR]
    quanta = 1 + ((btr >> 16 & 0xF) + 1) + ((btr >> 20 & 7) + 1)
    return S[HZ] // apb1_divisor(S) // ((btr & 0x3FF) + 1) // quanta


@njit(cache=True)
def on_bus(S: State) -> bool:
    """In normal mode: neither initialisation nor sleep acknowledged."""
    return S[CAN_MSR] & (INRQ | SLEEP) == 0


@njit(cache=True)
def line(S: State, irq: int) -> bool:
    """Level of an interrupt line."""
    ier = S[CAN_IER]
    if irq == TX_IRQ:
        return bool(ier & 1) and S[CAN_TSR] & (RQCP | RQCP << 8 | RQCP << 16) != 0
    fifo = irq - RX0_IRQ
    flags = S[CAN_FIFO_FLAGS + fifo]
    enabled = ier >> (1 + 3 * fifo)
    return bool(
        (enabled & 1 and S[CAN_FIFO_COUNT + fifo] > 0)
        or (enabled & 2 and flags & FULL)
        or (enabled & 4 and flags & FOVR)
    )


@njit(cache=True)
def _matches(S: State, bank: int, rir: int) -> bool:
    """Whether filter `bank` lets a frame in; rir is its identifier register (section 32.7.4)."""
    one, two = S[CAN_FILTER + 2 * bank], S[CAN_FILTER + 2 * bank + 1]
    listed = S[CAN_FM1R] >> bank & 1
    if S[CAN_FS1R] >> bank & 1:
        if listed:
            return rir in (one, two)
        return (rir ^ one) & two & ~1 == 0
    # 16 bits: STID[10:0] RTR IDE EXID[17:15]
    short = (rir >> 21 << 5) | (rir >> 1 & 1) << 4 | (rir >> 2 & 1) << 3 | rir >> 18 & 7
    if listed:
        return short in (one & 0xFFFF, one >> 16, two & 0xFFFF, two >> 16)
    return (short ^ one) & (one >> 16) & 0xFFFF == 0 or (short ^ two) & (two >> 16) & 0xFFFF == 0


@njit(cache=True)
def off_rate(S: State, bus_bitrate: int) -> bool:
    """On the bus, and set to another bit rate by more than the 0.5 % that resynchronisation makes up for."""
    return on_bus(S) and abs(bitrate(S) - bus_bitrate) * 200 > bus_bitrate


@njit(cache=True)
def receive(S: State, bus_bitrate: int, rir: int, length: int, low: int, high: int) -> bool:
    """A frame ended on the bus: into a FIFO if a filter lets it in. False if the bit rates differ."""
    bank = 0
    if off_rate(S, bus_bitrate):
        return False
    if on_bus(S) and not S[CAN_FMR] & 1:
        while bank < BANKS and not (S[CAN_FA1R] >> bank & 1 and _matches(S, bank, rir)):
            bank += 1
    else:
        bank = BANKS
    if bank == BANKS:
        S[CAN_LOST] += 1
        return True
    fifo = S[CAN_FFA1R] >> bank & 1
    count = S[CAN_FIFO_COUNT + fifo]
    if count == 3:
        S[CAN_FIFO_FLAGS + fifo] |= FOVR
        S[CAN_LOST] += 1
        if S[CAN_MCR] >> 4 & 1:  # RFLM: the newest is discarded
            return True
        count = 2  # else it overwrites the last one stored
    at = CAN_FIFO + 12 * fifo + 4 * count
    S[at] = rir
    S[at + 1] = length
    S[at + 2] = low
    S[at + 3] = high
    S[CAN_FIFO_COUNT + fifo] = count + 1
    if count + 1 == 3:
        S[CAN_FIFO_FLAGS + fifo] |= FULL
    return True


@njit(cache=True)
def _release(S: State, fifo: int) -> None:
    count = S[CAN_FIFO_COUNT + fifo]
    if count == 0:
        return
    at = CAN_FIFO + 12 * fifo
    for k in range(8):
        S[at + k] = S[at + k + 4]
    S[CAN_FIFO_COUNT + fifo] = count - 1


@njit(cache=True)
def sent(S: State, mailbox: int) -> None:
    """The frame of `mailbox` ended on the bus without error."""
    S[CAN_MAILBOX + 4 * mailbox] &= ~1
    S[CAN_TSR] |= (RQCP | TXOK) << (8 * mailbox) | 1 << (26 + mailbox)


@njit(cache=True)
def _tsr(S: State) -> int:
    """TSR with CODE: the lowest empty mailbox."""
    tsr = S[CAN_TSR]
    for mailbox in range(3):
        if tsr >> (26 + mailbox) & 1:
            return tsr & ~(3 << 24) | mailbox << 24
    return tsr


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset == 0x00:
        return S[CAN_MCR]
    if offset == 0x04:
        return S[CAN_MSR]
    if offset == 0x08:
        return _tsr(S)
    if offset in (0x0C, 0x10):
        fifo = (offset - 0x0C) // 4
        return S[CAN_FIFO_COUNT + fifo] | S[CAN_FIFO_FLAGS + fifo]
    if offset == 0x14:
        return S[CAN_IER]
    if offset == 0x18:
        return S[CAN_ESR]
    if offset == 0x1C:
        return S[CAN_BTR]
    if 0x180 <= offset < 0x1B0:
        return S[CAN_MAILBOX + (offset - 0x180) // 4]
    if 0x1B0 <= offset < 0x1D0:
        word = (offset - 0x1B0) // 4
        return S[CAN_FIFO + 12 * (word // 4) + word % 4]
    if offset == 0x200:
        return S[CAN_FMR]
    if offset == 0x204:
        return S[CAN_FM1R]
    if offset == 0x20C:
        return S[CAN_FS1R]
    if offset == 0x214:
        return S[CAN_FFA1R]
    if offset == 0x21C:
        return S[CAN_FA1R]
    if 0x240 <= offset < 0x240 + 8 * BANKS:
        return S[CAN_FILTER + (offset - 0x240) // 4]
    return -1


@njit(cache=True)
def _mode(S: State, value: int) -> None:
    """MCR written: the controller acknowledges at once (on silicon after up to eleven recessive bits)."""
    S[CAN_MCR] = value
    S[CAN_MSR] &= ~3
    if value & INRQ:
        S[CAN_MSR] |= INRQ
    elif value & SLEEP:
        S[CAN_MSR] |= SLEEP


@njit(cache=True)
def _request(S: State, mailbox: int, value: int) -> None:
    """TIxR written: with TXRQ the mailbox asks for the bus."""
    if not S[CAN_TSR] >> (26 + mailbox) & 1:
        return  # a pending mailbox is read-only
    S[CAN_MAILBOX + 4 * mailbox] = value
    if value & 1:
        S[CAN_TSR] &= ~(1 << (26 + mailbox) | 0xF << (8 * mailbox))
        S[CAN_TX_NEW] |= 1 << mailbox
        S[CAN_TX_NS + mailbox] = now_ns(S)


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    S[ATTEND] = 1  # lines and requests may have changed
    if offset == 0x00:
        _mode(S, value)
    elif offset == 0x04:
        S[CAN_MSR] &= ~(value & 0x1C)
    elif offset == 0x08:
        for mailbox in range(3):
            if value >> (8 * mailbox) & RQCP:
                S[CAN_TSR] &= ~(0xF << (8 * mailbox))
    elif offset in (0x0C, 0x10):
        fifo = (offset - 0x0C) // 4
        S[CAN_FIFO_FLAGS + fifo] &= ~(value & (FULL | FOVR))
        if value & 0x20:
            S[CAN_FIFO_FLAGS + fifo] &= ~FULL
            _release(S, fifo)
    elif offset == 0x14:
        S[CAN_IER] = value
    elif offset == 0x18:
        S[CAN_ESR] = S[CAN_ESR] & ~0x70 | value & 0x70
    elif offset == 0x1C:
        if S[CAN_MSR] & INRQ:  # BTR may be written in initialisation mode only
            S[CAN_BTR] = value
    elif 0x180 <= offset < 0x1B0:
        word = (offset - 0x180) // 4
        if word % 4 == 0:
            _request(S, word // 4, value)
        elif S[CAN_TSR] >> (26 + word // 4) & 1:
            S[CAN_MAILBOX + word] = value
    elif offset == 0x200:
        S[CAN_FMR] = value
    elif offset == 0x204:
        S[CAN_FM1R] = value
    elif offset == 0x20C:
        S[CAN_FS1R] = value
    elif offset == 0x214:
        S[CAN_FFA1R] = value
    elif offset == 0x21C:
        S[CAN_FA1R] = value
    elif 0x240 <= offset < 0x240 + 8 * BANKS:
        S[CAN_FILTER + (offset - 0x240) // 4] = value
    else:
        return False
    return True
