"""bxCAN's own instants: synchronisation, end of bus-off, loop-back frames, a sender that waits in bus-off."""

from targets.jit import njit
from targets.mcu.bxcan import loopback, mailboxes, modes
from targets.mcu.bxcan.registers import ABOM
from targets.mcu.clock import now_ns
from targets.mcu.state import (
    CAN_BOFF,
    CAN_DUE_NS,
    CAN_LOOP_NS,
    CAN_MCR,
    CAN_RECOVER,
    CAN_STRIDE,
    CAN_STUCK_MAILBOX,
    CAN_STUCK_NS,
    CAN_TX_NEW,
    State,
)

NEVER = 1 << 62
STUCK_AFTER_NS = 100_000_000
"""A request made in bus-off, where nothing can end it, is the firmware's fault after this time."""
STUCK = 1 << 7  # in CAN_TX_NEW


@njit(cache=True)
def _is_stuck(S: State, c: int) -> bool:
    """In bus-off, and neither hardware nor software has begun to leave it."""
    hopeless = S[CAN_BOFF + c] and S[CAN_RECOVER + c] == 0 and not S[CAN_MCR + c] & ABOM
    return bool(hopeless and modes.in_normal_mode(S, c))


@njit(cache=True)
def asked(S: State, c: int, mailbox: int, t_ns: int) -> None:
    """A mailbox was requested at `t_ns`: if the controller can only stay in bus-off, time runs."""
    if S[CAN_STUCK_NS + c] == NEVER and _is_stuck(S, c):
        S[CAN_STUCK_NS + c] = t_ns + STUCK_AFTER_NS
        S[CAN_STUCK_MAILBOX + c] = mailbox


@njit(cache=True)
def plan(S: State, c: int) -> None:
    """Find the next instant at which something happens by itself."""
    waits = mailboxes.is_pending(S, c, S[CAN_STUCK_MAILBOX + c])
    if S[CAN_STUCK_NS + c] != NEVER and not (waits and _is_stuck(S, c)):
        S[CAN_STUCK_NS + c] = NEVER
    S[CAN_DUE_NS + c] = min(S[CAN_LOOP_NS + c], S[CAN_STUCK_NS + c], modes.next_ns(S, c, NEVER))


@njit(cache=True)
def run_to(S: State, c: int, t_ns: int) -> None:
    """Do what has fallen due by `t_ns`, in order."""
    while S[CAN_DUE_NS + c] <= t_ns:
        at_ns = S[CAN_DUE_NS + c]
        modes.watched(S, c, at_ns)
        if S[CAN_LOOP_NS + c] <= at_ns:
            loopback.step(S, c, at_ns, NEVER)
        loopback.kick(S, c, at_ns, NEVER)
        if S[CAN_STUCK_NS + c] <= at_ns:
            S[CAN_TX_NEW] |= STUCK << (8 * (c // CAN_STRIDE))
            S[CAN_STUCK_NS + c] = NEVER
        plan(S, c)


@njit(cache=True)
def due_ns(S: State) -> int:
    """The earliest instant of either controller, NEVER if there is none."""
    return min(S[CAN_DUE_NS], S[CAN_DUE_NS + CAN_STRIDE])


@njit(cache=True)
def service(S: State) -> None:
    """Bring both controllers to the CPU's time."""
    if due_ns(S) != NEVER:
        now = now_ns(S)
        run_to(S, 0, now)
        run_to(S, CAN_STRIDE, now)
