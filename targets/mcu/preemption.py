"""Exception priorities (ARMv7-M B1.5.4): of all that is pending, system exceptions and interrupts alike,
what runs next, and what holds it back.
"""

from unicorn import arm_const as arm

from targets.jit import njit
from targets.mcu import native, nvic
from targets.mcu.state import (
    ACTIVE,
    ACTIVE_DEPTH,
    ATTEND,
    EVENT,
    FAULTED_NS,
    NVIC_PRIORITY,
    PENDING_SEEN,
    PRIGROUP,
    SCR,
    SHCSR,
    SYSTEM_PENDING,
    SYSTEM_PRIORITY,
    State,
)

NMI, HARD_FAULT, MEM_MANAGE, BUS_FAULT, USAGE_FAULT = 2, 3, 4, 5, 6
SV_CALL, DEBUG_MONITOR, PEND_SV, SYS_TICK = 11, 12, 14, 15

IDLE = 256
"""Execution priority of thread mode: below every exception."""
NEVER_NS = 1 << 62

REG_PRIMASK, REG_BASEPRI = arm.UC_ARM_REG_PRIMASK, arm.UC_ARM_REG_BASEPRI
REG_FAULTMASK, REG_CONTROL, REG_IPSR = arm.UC_ARM_REG_FAULTMASK, arm.UC_ARM_REG_CONTROL, arm.UC_ARM_REG_IPSR

SEVONPEND = 1 << 4


@njit(cache=True)
def priority(S: State, exception: int) -> int:
    """The priority of an exception: the smaller, the more urgent."""
    if exception >= 16:
        return S[NVIC_PRIORITY + exception - 16]
    if exception == NMI:
        return -2
    if exception == HARD_FAULT:
        return -1
    return S[SYSTEM_PRIORITY + exception]


@njit(cache=True)
def group(S: State, value: int) -> int:
    """The part of a priority that decides about preemption: without its subpriority (B1.5.4)."""
    return value if value < 0 else value & ~((2 << S[PRIGROUP]) - 1)


@njit(cache=True)
def active_priority(S: State) -> int:
    """Group priority of the most urgent active handler, IDLE in thread mode; masks left out."""
    best = IDLE
    for k in range(S[ACTIVE_DEPTH]):
        best = min(best, group(S, priority(S, S[ACTIVE + k])))
    return best


@njit(cache=True)
def masks(S: State) -> tuple[int, int, int]:
    """FAULTMASK, PRIMASK and BASEPRI. Unprivileged code reads them as 0, and the engine does so for it."""
    unprivileged = S[ACTIVE_DEPTH] == 0 and native.get_register(S, REG_CONTROL) & 1
    if unprivileged:
        native.set_register(S, REG_IPSR, HARD_FAULT)
    faultmask = native.get_register(S, REG_FAULTMASK)
    primask = native.get_register(S, REG_PRIMASK)
    basepri = native.get_register(S, REG_BASEPRI)
    if unprivileged:
        native.set_register(S, REG_IPSR, 0)
    return faultmask & 1, primask & 1, basepri


@njit(cache=True)
def mask_priority(S: State, primask: bool) -> int:
    """What the mask registers boost the execution priority to; PRIMASK counts if `primask`."""
    faults, interrupts, base = masks(S)
    if faults:
        return -1
    if primask and interrupts:
        return 0
    return group(S, base) if base else IDLE


@njit(cache=True)
def disabled(S: State) -> bool:
    """Whether PRIMASK or FAULTMASK keeps every interrupt away."""
    faults, interrupts, _ = masks(S)
    return faults + interrupts > 0


@njit(cache=True)
def execution_priority(S: State) -> int:
    """The priority at which the CPU runs (B1.5.4)."""
    return min(active_priority(S), mask_priority(S, True))


@njit(cache=True)
def admits(S: State, exception: int, primask: bool) -> bool:
    """Whether the mask registers let `exception` through; PRIMASK counts if `primask`."""
    return group(S, priority(S, exception)) < mask_priority(S, primask)


@njit(cache=True)
def is_enabled(S: State, exception: int) -> bool:
    """Whether a pending system exception may run: three faults have an enable bit in SHCSR."""
    if MEM_MANAGE <= exception <= USAGE_FAULT:
        return S[SHCSR] >> (exception + 12) & 1 == 1
    return True


@njit(cache=True)
def pend(S: State, exception: int) -> None:
    """Make a system exception pending."""
    S[SYSTEM_PENDING] |= 1 << exception
    S[ATTEND] |= 1


@njit(cache=True)
def unpend(S: State, exception: int) -> None:
    """A system exception is pending no longer."""
    S[SYSTEM_PENDING] &= ~(1 << exception)


@njit(cache=True)
def highest_pending(S: State, below: int) -> int:
    """The most urgent exception pending and enabled, if its group priority is under `below`; else 0."""
    winner, best = 0, IDLE
    pending = S[SYSTEM_PENDING]
    if pending:
        for exception in range(NMI, 16):
            if pending >> exception & 1 and is_enabled(S, exception):
                value = priority(S, exception)
                if value < best:
                    best, winner = value, exception
    irq = nvic.most_urgent(S, best)
    if irq >= 0:
        best, winner = S[NVIC_PRIORITY + irq], irq + 16
    return winner if winner and group(S, best) < below else 0


@njit(cache=True)
def candidate(S: State) -> int:
    """The exception that may preempt what runs now, the mask registers left out; 0 if there is none."""
    return highest_pending(S, active_priority(S))


@njit(cache=True)
def activate(S: State, exception: int) -> None:
    """The handler of `exception` begins."""
    if exception < 16:
        unpend(S, exception)
    else:
        nvic.unlatch(S, exception - 16)
    S[ACTIVE + S[ACTIVE_DEPTH]] = exception
    S[ACTIVE_DEPTH] += 1


@njit(cache=True)
def deactivate(S: State, exception: int) -> bool:
    """The handler of `exception` ends; False if it was not active."""
    depth = S[ACTIVE_DEPTH]
    for k in range(depth - 1, -1, -1):
        if S[ACTIVE + k] == exception:
            for j in range(k, depth - 1):
                S[ACTIVE + j] = S[ACTIVE + j + 1]
            S[ACTIVE_DEPTH] = depth - 1
            if HARD_FAULT <= exception <= USAGE_FAULT:
                S[FAULTED_NS] = NEVER_NS
            return True
    return False


@njit(cache=True)
def note_pending(S: State) -> None:
    """With SEVONPEND an exception that becomes pending, enabled or not, is an event (B1.5.18)."""
    if not S[SCR] & SEVONPEND:
        return
    for word in range(4):
        pending = nvic.pending_word(S, word) if word < 3 else S[SYSTEM_PENDING]
        if pending & ~S[PENDING_SEEN + word]:
            S[EVENT] = 1
        S[PENDING_SEEN + word] = pending
