"""What the block hook has to look after between two stops of the run loop: ATTEND, a bit for each matter.

Most blocks find none of them set. Anything that wants the run loop's attention sets STOP.
"""

from targets.jit import njit
from targets.mcu import exceptions, native, preemption
from targets.mcu.state import ATTEND, BEFORE_FP, CPACR, FPCCR, HAS_FP, STACK, WAITING, State

STOP = 1  # stop at the next block
MASKED = 2  # an exception is pending behind a mask register
LAZY = 4  # FP registers wait to be stacked
NO_FPU = 8  # the FPU is off, and the program has instructions for it


@njit(cache=True)
def watches(S: State) -> int:
    """What has to be watched whatever is pending."""
    value = LAZY if S[FPCCR] & exceptions.LSPACT else 0
    if S[HAS_FP] and S[CPACR] >> 20 & 0x5 != 0x5:  # CP10 and CP11, privileged or full access
        value |= NO_FPU
    return value


@njit(cache=True)
def stops(S: State, at: int, size: int) -> bool:
    """Whether the run loop must see to something before the block at `at` runs."""
    flags = S[ATTEND]
    if flags & STOP:
        return True
    if flags & LAZY and exceptions.settle_fp(S):
        S[ATTEND] &= ~LAZY
    if flags & MASKED and preemption.admits(S, S[WAITING], True):
        return True
    if flags & NO_FPU:
        S[BEFORE_FP] = _instructions_before_fp(S, at, size)
        return S[BEFORE_FP] >= 0
    return False


@njit(cache=True)
def halfword(S: State, address: int) -> int:
    """A halfword of memory, -1 if there is none."""
    if native.read_memory(S, address, STACK, 2):
        return -1
    return S[STACK] & 0xFFFF


@njit(cache=True)
def _instructions_before_fp(S: State, at: int, size: int) -> int:
    """How many instructions of the block come before the first one for the FPU; -1 if it has none."""
    count, end = 0, at + size
    while at < end:
        first = halfword(S, at)
        if first < 0xE800:
            at += 2
        else:
            # Coprocessor instructions (ARMv7-M A5.3.18), of which 10 and 11 are the FPU's.
            if first & 0xEC00 == 0xEC00 and halfword(S, at + 2) >> 8 & 0xE == 0xA:
                return count
            at += 4
        count += 1
    return -1
