"""The core's run loop: exceptions in and out, device events, sleep. All compiled.

unicorn executes instructions; what it lacks on Cortex-M is done around it: `exceptions` takes and leaves
them, `traps` says why it stopped, and here is the stop at a deadline or a device's next event. Time passes in
`blocks`.
"""

from unicorn import arm_const as arm

from targets.jit import njit
from targets.mcu import attention, blocks, events, exceptions, faulting, faults, native, preemption, traps
from targets.mcu.clock import cycles_at, now_ns
from targets.mcu.preemption import NEVER_NS
from targets.mcu.state import (
    ATTEND,
    BLOCK,
    CAN_TX_NEW,
    COUNT,
    CYCLES,
    DEADLINE,
    ERROR,
    EVENT,
    FAULTED_NS,
    HALT_ON_BKPT,
    MASKED_NS,
    NEXT,
    PATIENCE_NS,
    PC,
    RESET_REQUEST,
    SET_UP,
    SLEEPING,
    STOPPED,
    THUMB,
    TRAP,
    UNTIL_NS,
    WAITING,
    State,
)

REG_PC, REG_SP, REG_LR = arm.UC_ARM_REG_PC, arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR
REG_R0, REG_S0, REG_FPSCR, REG_XPSR = (
    arm.UC_ARM_REG_R0,
    arm.UC_ARM_REG_S0,
    arm.UC_ARM_REG_FPSCR,
    arm.UC_ARM_REG_XPSR,
)

REGISTERS = {
    **{f"r{k}": REG_R0 + k for k in range(13)},
    "sp": REG_SP,
    "lr": REG_LR,
    "pc": REG_PC,
    "xpsr": REG_XPSR,
    "msp": arm.UC_ARM_REG_MSP,
    "psp": arm.UC_ARM_REG_PSP,
    "primask": arm.UC_ARM_REG_PRIMASK,
    "basepri": arm.UC_ARM_REG_BASEPRI,
    "faultmask": arm.UC_ARM_REG_FAULTMASK,
    "control": arm.UC_ARM_REG_CONTROL,
    "fpscr": REG_FPSCR,
    **{f"s{k}": REG_S0 + k for k in range(32)},
}
"""A debugger's names of the core registers, to unicorn's numbers."""

# What `run` stopped for
TIME, TRANSMIT, FAULT, RESET, BREAKPOINT, STEP, MORE_HOOKS = range(7)
GO_ON = -1


@njit(cache=True)
def run(S: State) -> int:
    """Run until UNTIL_NS, a transmit request, a fault or a reset request; which of them.

    Time may pass UNTIL_NS by the length of one basic block or exception entry.
    """
    while True:
        events.service(S)
        if S[RESET_REQUEST]:
            return RESET
        if S[CAN_TX_NEW]:
            return TRANSMIT
        if S[SET_UP]:
            return MORE_HOOKS
        until = cycles_at(S, S[UNTIL_NS])
        if S[CYCLES] >= until:
            return TIME
        S[DEADLINE] = min(until, events.due(S))
        S[ATTEND] = attention.watches(S)
        _preempt(S)
        _lose_patience(S)
        if S[ERROR]:
            return FAULT
        if S[SLEEPING] and not _wakes(S):
            exceptions.charge(S, S[DEADLINE] - S[CYCLES])
            continue
        reason = _execute(S)
        if S[ERROR]:
            return FAULT
        if reason != GO_ON:
            return reason


@njit(cache=True)
def _preempt(S: State) -> None:
    """Take the exception that is due, or watch for the mask register that holds it back."""
    preemption.note_pending(S)
    following = preemption.candidate(S)
    if following == 0:
        S[MASKED_NS] = NEVER_NS
        return
    if preemption.admits(S, following, True):
        S[MASKED_NS] = NEVER_NS
        S[SLEEPING] = exceptions.AWAKE
        exceptions.enter(S, following)
        return
    S[WAITING] = following
    S[ATTEND] |= attention.MASKED
    if not preemption.disabled(S):
        S[MASKED_NS] = NEVER_NS
    elif S[MASKED_NS] == NEVER_NS:
        S[MASKED_NS] = now_ns(S)
    if S[SLEEPING] == exceptions.IN_WFI and preemption.admits(S, following, False):
        S[SLEEPING] = exceptions.AWAKE  # PRIMASK keeps the handler from running, not the core from waking


@njit(cache=True)
def _lose_patience(S: State) -> None:
    """Interrupts that stay disabled with one waiting, or the handler of a fault that runs on, end the run."""
    if S[MASKED_NS] != NEVER_NS:
        at = cycles_at(S, S[MASKED_NS] + S[PATIENCE_NS])
        S[DEADLINE] = min(S[DEADLINE], at)
        if S[CYCLES] >= at:
            faulting.end(S, faults.MASKED, S[WAITING])
    if S[FAULTED_NS] != NEVER_NS:
        at = cycles_at(S, S[FAULTED_NS] + S[PATIENCE_NS])
        S[DEADLINE] = min(S[DEADLINE], at)
        if S[CYCLES] >= at:
            S[ERROR] = faults.HANDLER_STUCK


@njit(cache=True)
def _wakes(S: State) -> bool:
    """Whether WFE has come to its end by an event."""
    if S[SLEEPING] == exceptions.IN_WFE and S[EVENT]:
        S[EVENT] = 0
        S[SLEEPING] = exceptions.AWAKE
    return S[SLEEPING] == exceptions.AWAKE


@njit(cache=True)
def _execute(S: State) -> int:
    """Run the engine once and act on why it stopped; GO_ON, or a reason to stop the run."""
    if not S[THUMB]:
        S[THUMB] = 1
        traps.take_fault(S, faults.INVALID_STATE, S[PC])
        return GO_ON
    S[STOPPED] = 0
    S[BLOCK] = -1  # none yet
    error = native.start(S, S[PC] | 1, S[COUNT])
    if S[STOPPED] == blocks.AT_BLOCK:
        # With a count set the hook may have stopped at the block after its instruction.
        return STEP if S[COUNT] and S[BLOCK] >= 0 else GO_ON
    S[PC] = native.get_register(S, REG_PC) & 0xFFFFFFFF
    behind = S[PC] == S[NEXT]  # a whole block has run, and what stopped the engine is its last instruction
    blocks.refund(S, S[PC])
    if S[STOPPED] == traps.AT_BREAKPOINT or _halts(S):
        return BREAKPOINT
    if S[STOPPED] == traps.AT_INTERRUPT:
        traps.interrupted(S)
    elif S[STOPPED] == traps.AT_DIVISION:
        traps.take_fault(S, faults.DIVIDE_BY_ZERO, S[PC])
    elif S[STOPPED] == traps.AT_FP:
        traps.take_fault(S, faults.NO_COPROCESSOR, S[PC])
    elif error:
        traps.failed(S, error, behind)
    elif behind:
        S[SLEEPING] = exceptions.IN_WFI
    return STEP if S[COUNT] else GO_ON


@njit(cache=True)
def _halts(S: State) -> bool:
    """Whether a debugger takes the BKPT that unicorn stopped with."""
    return S[STOPPED] == traps.AT_INTERRUPT and S[TRAP] == traps.BKPT and S[HALT_ON_BKPT] != 0
