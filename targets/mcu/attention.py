"""What the block hook has to look after between two stops of the run loop: ATTEND, a bit for each matter.

Most blocks find none of them set. Anything that wants the run loop's attention sets STOP.
"""

from targets.jit import njit
from targets.mcu import exceptions, faults, memory, preemption
from targets.mcu.state import ATTEND, CPACR, FPCCR, FPU_WATCH, SET_UP, WAITING, State

STOP = 1  # stop at the next block
MASKED = 2  # an exception is pending behind a mask register
LAZY = 4  # FP registers wait to be stacked
NO_FPU = 8  # the FPU is off, and the program has instructions for it

# FPU_WATCH. A program that uses the FPU switches it on early: until then blocks are searched. One that uses
# it before that gets a hook on each FP instruction, as long as it stays off.
UNUSED, BY_BLOCK, BY_INSTRUCTION = 0, 1, 2


@njit(cache=True)
def watches(S: State) -> int:
    """What has to be watched whatever is pending."""
    value = LAZY if S[FPCCR] & exceptions.LSPACT else 0
    if S[FPU_WATCH] == BY_BLOCK and not has_fpu(S):
        value |= NO_FPU
    return value


@njit(cache=True)
def has_fpu(S: State) -> bool:
    """Whether CPACR grants access to coprocessors 10 and 11, to privileged code or to all."""
    return S[CPACR] >> 20 & 0x5 == 0x5


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
        return _find_fp(S, at, size)
    return False


@njit(cache=True)
def _find_fp(S: State, at: int, size: int) -> bool:
    """Whether the block has an instruction for the FPU: then they all get a hook before it runs."""
    end = at + size
    while at < end:
        first = memory.halfword(S, at)
        if first < 0xE800:
            at += 2
            continue
        # Coprocessor instructions (ARMv7-M A5.3.18), of which 10 and 11 are the FPU's.
        if first & 0xEC00 == 0xEC00 and memory.halfword(S, at + 2) >> 8 & 0xE == 0xA:
            S[SET_UP] |= faults.FPU_OFF
            S[FPU_WATCH] = BY_INSTRUCTION
            return True
        at += 4
    return False
