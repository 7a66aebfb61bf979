"""bxCAN's three transmit mailboxes: request, priority, abort, outcome (RM0090 section 32.7.1, figure 340)."""

from targets.jit import njit
from targets.mcu.bxcan import timing
from targets.mcu.bxcan.registers import (
    ABRQ,
    ALST,
    IDE,
    LOW0,
    MAILBOXES,
    NART,
    OUTCOME,
    RQCP,
    RTR,
    TERR,
    TGT,
    TME0,
    TXFP,
    TXOK,
    TXRQ,
)
from targets.mcu.clock import now_ns
from targets.mcu.state import (
    CAN_MAILBOX,
    CAN_MCR,
    CAN_REQUESTS,
    CAN_SENDING,
    CAN_STRIDE,
    CAN_TSR,
    CAN_TX_NEW,
    CAN_TX_NS,
    CAN_TX_ORDER,
    State,
)

NONE = -1


@njit(cache=True)
def is_pending(S: State, c: int, mailbox: int) -> bool:
    """Whether the mailbox has been requested and not completed: software cannot write it."""
    return S[CAN_TSR + c] >> (TME0 + mailbox) & 1 == 0


@njit(cache=True)
def _rank(S: State, c: int, mailbox: int) -> int:
    """Lowest for what is sent first: order of request with TXFP, else the bits that arbitration compares."""
    if S[CAN_MCR + c] & TXFP:
        return S[CAN_TX_ORDER + c + mailbox]
    tir = S[CAN_MAILBOX + c + 4 * mailbox]
    base, remote = tir >> 21, 1 if tir & RTR else 0
    if tir & IDE:  # SRR and IDE recessive, extension, RTR
        return base << 21 | 3 << 19 | (tir >> 3 & 0x3FFFF) << 1 | remote
    return base << 21 | remote << 20


@njit(cache=True)
def first(S: State, c: int, t_ns: int) -> int:
    """The mailbox to be sent first of those requested by `t_ns`, NONE if there is none."""
    winner, best = NONE, 0
    for mailbox in range(MAILBOXES):
        if is_pending(S, c, mailbox) and S[CAN_TX_NS + c + mailbox] <= t_ns:
            rank = _rank(S, c, mailbox)
            if winner == NONE or rank < best:
                winner, best = mailbox, rank
    return winner


@njit(cache=True)
def _last(S: State, c: int) -> int:
    """The pending mailbox of lowest priority."""
    loser, worst = NONE, 0
    for mailbox in range(MAILBOXES):
        if is_pending(S, c, mailbox):
            rank = _rank(S, c, mailbox)
            if loser == NONE or rank >= worst:
                loser, worst = mailbox, rank
    return loser


@njit(cache=True)
def read_tsr(S: State, c: int) -> int:
    """TSR with CODE, the next empty mailbox or the one of lowest priority, and LOW."""
    tsr = S[CAN_TSR + c]
    empty, pending = NONE, 0
    for mailbox in range(MAILBOXES):
        if is_pending(S, c, mailbox):
            pending += 1
        elif empty == NONE:
            empty = mailbox
    if pending < 2:  # LOW is zero while no more than one waits
        return tsr | empty << 24
    last = _last(S, c)
    return tsr | 1 << (LOW0 + last) | (last if empty == NONE else empty) << 24


@njit(cache=True)
def announce(S: State, c: int) -> None:
    """Tell the bus of every pending mailbox: it may be sent from now on."""
    for mailbox in range(MAILBOXES):
        if is_pending(S, c, mailbox):
            S[CAN_TX_NEW] |= 1 << (8 * (c // CAN_STRIDE) + mailbox)


@njit(cache=True)
def request(S: State, c: int, mailbox: int) -> None:
    """TXRQ was set: the mailbox is pending."""
    S[CAN_TSR + c] &= ~(1 << (TME0 + mailbox) | OUTCOME << (8 * mailbox))
    S[CAN_TX_NS + c + mailbox] = now_ns(S)
    S[CAN_TX_ORDER + c + mailbox] = S[CAN_REQUESTS + c]
    S[CAN_REQUESTS + c] += 1


@njit(cache=True)
def complete(S: State, c: int, mailbox: int, outcome: int) -> None:
    """The mailbox is empty again; outcome: TXOK, ALST, TERR or 0 for an abort."""
    S[CAN_MAILBOX + c + 4 * mailbox] &= ~TXRQ
    S[CAN_TSR + c] &= ~((ABRQ | OUTCOME) << (8 * mailbox))
    S[CAN_TSR + c] |= (RQCP | outcome) << (8 * mailbox) | 1 << (TME0 + mailbox)


@njit(cache=True)
def failed(S: State, c: int, mailbox: int, cause: int) -> None:
    """An attempt failed by `cause`, ALST or TERR: given up with NART or on abort request, else repeated."""
    if not is_pending(S, c, mailbox):
        return
    if S[CAN_MCR + c] & NART or S[CAN_TSR + c] >> (8 * mailbox) & ABRQ:
        complete(S, c, mailbox, cause)
    else:
        S[CAN_TSR + c] = S[CAN_TSR + c] & ~((ALST | TERR | TXOK) << (8 * mailbox)) | cause << (8 * mailbox)


@njit(cache=True)
def write_tsr(S: State, c: int, value: int) -> None:
    """RQCP by a one clears the outcome; ABRQ aborts at once, or when the attempt on the wire has ended."""
    for mailbox in range(MAILBOXES):
        bits = value >> (8 * mailbox)
        if bits & RQCP and S[CAN_TSR + c] >> (8 * mailbox) & RQCP:
            S[CAN_TSR + c] &= ~(OUTCOME << (8 * mailbox))
        if bits & ABRQ and is_pending(S, c, mailbox):
            if S[CAN_SENDING + c] == mailbox + 1:
                S[CAN_TSR + c] |= ABRQ << (8 * mailbox)
            else:
                complete(S, c, mailbox, 0)


@njit(cache=True)
def start(S: State, c: int, mailbox: int, t_ns: int) -> None:
    """The frame of `mailbox` starts on the wire at `t_ns`: its time stamp is taken."""
    S[CAN_SENDING + c] = mailbox + 1
    at = CAN_MAILBOX + c + 4 * mailbox + 1
    S[at] = S[at] & 0xFFFF | timing.stamp(S, c, t_ns) << 16


@njit(cache=True)
def high_word(S: State, c: int, mailbox: int, t_ns: int) -> int:
    """Data bytes 4 to 7 as sent from `t_ns` on: with TGT the time stamp replaces the last two (32.9.3)."""
    tdtr, high = S[CAN_MAILBOX + c + 4 * mailbox + 1], S[CAN_MAILBOX + c + 4 * mailbox + 3]
    if tdtr & TGT and tdtr & 0xF == 8:
        time = timing.stamp(S, c, t_ns)
        # upper half in byte 6, lower half in byte 7
        return high & 0xFFFF | (time >> 8) << 16 | (time & 0xFF) << 24
    return high
