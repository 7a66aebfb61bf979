"""bxCAN's loop-back mode (RM0090 section 32.5.2): its own frames come back, at the pace of the bit time.

FIDELITY: on silicon CANTX shows these frames unless SILM is set, too; here they never reach the bus.
"""

from targets.frame_bits import EXTENDED_AT, LENGTH_AT, REMOTE_AT, length_bits
from targets.jit import njit
from targets.mcu.bxcan import errors, fifos, mailboxes, modes, timing
from targets.mcu.bxcan.registers import IDE, INRQ, RTR, SLEEP, TXOK, TXRQ
from targets.mcu.state import (
    CAN_LOOP_FREE_NS,
    CAN_LOOP_NS,
    CAN_MAILBOX,
    CAN_MCR,
    CAN_SENDING,
    CAN_SOF_NS,
    State,
)

INTERMISSION_BITS = 3


@njit(cache=True)
def _big_endian(word: int) -> int:
    return (word & 0xFF) << 24 | (word >> 8 & 0xFF) << 16 | (word >> 16 & 0xFF) << 8 | word >> 24 & 0xFF


@njit(cache=True)
def frame_bits(rir: int, length: int, low: int, high: int) -> int:
    """Bits of the frame with these contents of identifier and data registers, intermission not included."""
    extended, remote = (1 if rir & IDE else 0), (1 if rir & RTR else 0)
    identifier = rir >> 3 if extended else rir >> 21
    head = identifier | min(length, 8) << LENGTH_AT | extended << EXTENDED_AT | remote << REMOTE_AT
    data = _big_endian(low) << 32 | _big_endian(high)
    return length_bits(head, data)


@njit(cache=True)
def kick(S: State, c: int, t_ns: int, never: int) -> None:
    """If a mailbox waits in loop-back mode and nothing is on its way, let the next frame start."""
    if (
        S[CAN_LOOP_NS + c] == never
        and modes.loops_back(S, c)
        and modes.in_normal_mode(S, c)
        and mailboxes.first(S, c, t_ns) != mailboxes.NONE
    ):
        S[CAN_LOOP_NS + c] = max(t_ns, S[CAN_LOOP_FREE_NS + c])


@njit(cache=True)
def _begin(S: State, c: int, t_ns: int, never: int) -> None:
    mailbox = mailboxes.first(S, c, t_ns)
    if mailbox == mailboxes.NONE or not modes.in_normal_mode(S, c) or S[CAN_MCR + c] & (INRQ | SLEEP):
        S[CAN_LOOP_NS + c] = never
        return
    at = CAN_MAILBOX + c + 4 * mailbox
    mailboxes.start(S, c, mailbox, t_ns)
    S[CAN_SOF_NS + c] = t_ns
    bits = frame_bits(S[at], S[at + 1] & 0xF, S[at + 2], mailboxes.high_word(S, c, mailbox, t_ns))
    S[CAN_LOOP_NS + c] = t_ns + timing.span_ns(S, c, bits)


@njit(cache=True)
def _end(S: State, c: int, t_ns: int, never: int) -> None:
    mailbox = S[CAN_SENDING + c] - 1
    at = CAN_MAILBOX + c + 4 * mailbox
    tdtr, high = S[at + 1], mailboxes.high_word(S, c, mailbox, S[CAN_SOF_NS + c])
    errors.transmitted(S, c)
    errors.received(S, c)
    fifos.take(S, c, S[at] & ~TXRQ, tdtr & 0xF, tdtr >> 16, S[at + 2], high)
    mailboxes.complete(S, c, mailbox, TXOK)
    S[CAN_SENDING + c] = 0
    S[CAN_LOOP_NS + c] = never
    S[CAN_LOOP_FREE_NS + c] = t_ns + timing.span_ns(S, c, INTERMISSION_BITS)
    modes.settle(S, c, t_ns)
    kick(S, c, t_ns, never)


@njit(cache=True)
def step(S: State, c: int, t_ns: int, never: int) -> None:
    """CAN_LOOP_NS has come."""
    if S[CAN_SENDING + c]:
        _end(S, c, t_ns, never)
    else:
        _begin(S, c, t_ns, never)
