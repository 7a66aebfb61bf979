"""A fault happens (ARMv7-M B1.5.14): status registers, escalation, lockup, and whether the run ends with it.

The kinds are in `faults`. Belongs here: from a kind to the exception to be taken. Never: taking it.
"""

from unicorn import arm_const as arm

from targets.jit import njit
from targets.mcu import faults, memory, native, nvic, preemption
from targets.mcu.clock import now_ns
from targets.mcu.preemption import (
    BUS_FAULT,
    DEBUG_MONITOR,
    HARD_FAULT,
    MEM_MANAGE,
    SV_CALL,
    USAGE_FAULT,
)
from targets.mcu.state import (
    ACCESS,
    BFAR,
    CFSR,
    DEMCR,
    DFSR,
    ERROR,
    FAULT_ACCESS,
    FAULT_ADDRESS,
    FAULT_COUNT,
    FAULT_EXCEPTION,
    FAULT_KIND,
    FAULT_REGISTERS,
    FAULTED_NS,
    HFSR,
    MMFAR,
    ON_FAULT,
    PC,
    VTOR,
    State,
)

REG_R0, REG_SP, REG_LR, REG_XPSR = (
    arm.UC_ARM_REG_R0,
    arm.UC_ARM_REG_SP,
    arm.UC_ARM_REG_LR,
    arm.UC_ARM_REG_XPSR,
)
MON_EN = 1 << 16
BRANCH_TO_SELF = 0xE7FE
NO_VECTOR = -1


@njit(cache=True)
def vector(S: State, exception: int) -> int:
    """The entry of `exception` in the vector table, NO_VECTOR if that lies outside memory."""
    return memory.word(S, S[VTOR] + 4 * exception)


@njit(cache=True)
def is_dead_end(S: State, handler: int) -> bool:
    """Whether a handler is an endless loop: a program's way to say that it expects no such exception."""
    return memory.halfword(S, handler & ~1) == BRANCH_TO_SELF


@njit(cache=True)
def record(S: State, kind: int, address: int) -> None:
    """Keep what the report of a fault will want to know: the registers as they are now."""
    S[FAULT_KIND] = kind
    S[FAULT_ADDRESS] = address
    S[FAULT_ACCESS] = S[ACCESS]
    S[FAULT_COUNT] += 1
    for k in range(13):
        S[FAULT_REGISTERS + k] = native.get_register(S, REG_R0 + k)
    S[FAULT_REGISTERS + 13] = native.get_register(S, REG_SP)
    S[FAULT_REGISTERS + 14] = native.get_register(S, REG_LR)
    S[FAULT_REGISTERS + 15] = S[PC]
    S[FAULT_REGISTERS + 16] = native.get_register(S, REG_XPSR) & ~0x1FF | nvic.current(S)


@njit(cache=True)
def end(S: State, kind: int, address: int) -> None:
    """End the run with a fault of the emulator's own making."""
    record(S, kind, address)
    S[FAULT_EXCEPTION] = HARD_FAULT
    S[ERROR] = faults.ENDED


@njit(cache=True)
def fault(S: State, kind: int, address: int) -> int:
    """The exception with which the CPU answers a fault at PC; ERROR is set if the run ends here instead."""
    record(S, kind, address)
    wanted = _mark(S, kind, address)
    exception = wanted
    if wanted == DEBUG_MONITOR:
        if not (S[DEMCR] & MON_EN and _takes(S, wanted)):
            S[HFSR] |= faults.DEBUGEVT
            exception = HARD_FAULT
    elif wanted != HARD_FAULT and not (preemption.is_enabled(S, wanted) and _takes(S, wanted)):
        S[HFSR] |= faults.FORCED
        exception = HARD_FAULT
    if exception == HARD_FAULT and preemption.execution_priority(S) < 0:
        exception = faults.LOCKUP
    S[FAULT_EXCEPTION] = exception
    if exception <= USAGE_FAULT:
        S[FAULTED_NS] = now_ns(S)
    if exception == faults.LOCKUP or _is_the_end(S, exception):
        S[ERROR] = faults.ENDED
    return exception


@njit(cache=True)
def _takes(S: State, exception: int) -> bool:
    priority = preemption.group(S, preemption.priority(S, exception))
    return priority < preemption.execution_priority(S)


@njit(cache=True)
def _mark(S: State, kind: int, address: int) -> int:
    """Set the status and address registers (B3.2.15 to 19); the exception that belongs to the kind."""
    if kind == faults.VECTOR_TABLE:
        S[HFSR] |= faults.VECTTBL
        return HARD_FAULT
    if kind == faults.BREAKPOINT:
        S[DFSR] |= faults.BKPT
        return DEBUG_MONITOR
    if kind == faults.SUPERVISOR_CALL:
        return SV_CALL
    if kind == faults.FLASH_WRITE:
        kind = faults.DATA_BUS
    S[CFSR] |= 1 << kind
    if kind == faults.DATA_BUS:
        S[BFAR] = address
        S[CFSR] |= faults.BFARVALID
    if kind == faults.DATA_VIOLATION:
        S[MMFAR] = address
        S[CFSR] |= faults.MMARVALID
    if kind < 8:
        return MEM_MANAGE
    return BUS_FAULT if kind < 16 else USAGE_FAULT


@njit(cache=True)
def _is_the_end(S: State, exception: int) -> bool:
    """Whether the run ends with the fault: its handler does nothing, or nobody asked for it to be run.

    A configurable fault has a handler of its own if its vector differs from HardFault's.
    """
    handler = vector(S, exception)
    if handler == NO_VECTOR:
        return False  # the vector fetch will fail, and that is another fault
    if is_dead_end(S, handler):
        return True
    if S[ON_FAULT] == faults.TAKE:
        return False
    return exception == HARD_FAULT or handler == vector(S, HARD_FAULT)
