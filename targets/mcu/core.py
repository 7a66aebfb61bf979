"""The core's run loop: exceptions in and out, device events, sleep. All compiled.

unicorn executes instructions; what it lacks on Cortex-M is done here: exception entry and return with FP
context, WFI, and the stop at a deadline or a device's next event. Time passes in `blocks`.
"""

from typing import Any

from numba import carray, types
from unicorn import arm_const as arm

from targets.jit import cfunc, njit
from targets.mcu import blocks, events, native, nvic
from targets.mcu.clock import cycles_at
from targets.mcu.state import (
    ACTIVE_DEPTH,
    ATTEND,
    BLOCK,
    BREAK_PASSED,
    CAN_TX_NEW,
    COST,
    COUNT,
    CPACR,
    CYCLES,
    DEADLINE,
    ENTRY_CYCLES,
    ERROR,
    EXIT_CYCLES,
    NEXT,
    PC,
    RESET_REQUEST,
    RETURNING,
    SLEEPING,
    STACK,
    STOPPED,
    TAIL_CYCLES,
    UNTIL_NS,
    VTOR,
    State,
)

REG_PC, REG_SP, REG_LR, REG_R12 = arm.UC_ARM_REG_PC, arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR, arm.UC_ARM_REG_R12
REG_R0, REG_S0, REG_FPSCR = arm.UC_ARM_REG_R0, arm.UC_ARM_REG_S0, arm.UC_ARM_REG_FPSCR
REG_XPSR, REG_PRIMASK = arm.UC_ARM_REG_XPSR, arm.UC_ARM_REG_PRIMASK
EXC_RETURN_INTNO = 8

REGISTERS = {
    **{f"r{k}": arm.UC_ARM_REG_R0 + k for k in range(13)},
    "sp": REG_SP,
    "lr": REG_LR,
    "pc": REG_PC,
    "xpsr": REG_XPSR,
    "msp": arm.UC_ARM_REG_MSP,
    "psp": arm.UC_ARM_REG_PSP,
    "primask": REG_PRIMASK,
    "basepri": arm.UC_ARM_REG_BASEPRI,
    "faultmask": arm.UC_ARM_REG_FAULTMASK,
    "control": arm.UC_ARM_REG_CONTROL,
    "fpscr": REG_FPSCR,
    **{f"s{k}": REG_S0 + k for k in range(32)},
}
"""A debugger's names of the core registers, to unicorn's numbers."""

# What `run` stopped for
TIME, TRANSMIT, FAULT, RESET, BREAKPOINT, STEP = range(6)

# Beside blocks.AT_BLOCK in STOPPED
AT_INTERRUPT, AT_BREAKPOINT = 2, 3

# Further codes in ERROR beside unicorn's own
ERROR_STACK, ERROR_INTERRUPT = 1000, 1001

BASIC_FRAME, FP_FRAME = 32, 104


@cfunc(types.void(types.voidptr, types.uint32, types.voidptr), cache=True)
def on_interrupt(engine: Any, number: int, user: Any) -> None:
    """uc_cb_hookintr_t: EXC_RETURN, or an exception that only a fault handler could take."""
    S = carray(user, (COST,), types.int64)
    if number == EXC_RETURN_INTNO:
        S[RETURNING] = 1
    else:
        S[ERROR] = ERROR_INTERRUPT + (types.int64(number) << 16)
    S[STOPPED] = AT_INTERRUPT
    native.stop(S)


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_breakpoint(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of an instruction with a breakpoint: stop before it."""
    S = carray(user, (COST,), types.int64)
    if S[BREAK_PASSED] == types.int64(address):
        S[BREAK_PASSED] = -1
        return
    S[STOPPED] = AT_BREAKPOINT
    native.stop(S)


@njit(cache=True)
def enter_exception(S: State, irq: int) -> None:
    """Exception entry (ARMv7-M B1.5.6): stack the context, load the vector."""
    sp = native.get_register(S, REG_SP)
    fp = S[CPACR] >> 20 & 0xF == 0xF
    # Lazy stacking only leaves room for the FP registers; to a program the difference shows in time alone.
    size = FP_FRAME if fp else BASIC_FRAME
    align = 4 if sp & 4 else 0
    sp -= size + align
    xpsr = native.get_register(S, REG_XPSR) & ~0x1FF | nvic.current(S)
    for k in range(4):
        _put(S, k, native.get_register(S, REG_R0 + k))
    _put(S, 4, native.get_register(S, REG_R12))
    _put(S, 5, native.get_register(S, REG_LR))
    _put(S, 6, S[PC])
    _put(S, 7, xpsr | (1 << 9 if align else 0))
    if fp:
        for k in range(16):
            _put(S, 8 + k, native.get_register(S, REG_S0 + k))
        _put(S, 24, native.get_register(S, REG_FPSCR))
        _put(S, 25, 0)
    if native.write_memory(S, sp, STACK, size):
        S[ERROR] = ERROR_STACK
        return
    lr = 0xFFFFFFF1 if S[ACTIVE_DEPTH] else 0xFFFFFFF9
    native.set_register(S, REG_LR, lr & ~0x10 if fp else lr)
    native.set_register(S, REG_SP, sp)
    nvic.enter(S, irq)
    # The handler starts outside any IT block: bits 26:25 and 15:10 cleared.
    native.set_register(S, REG_XPSR, xpsr & ~0x0600FDFF | irq + 16 | 1 << 24)
    native.read_memory(S, S[VTOR] + 4 * (irq + 16), STACK, 4)
    S[PC] = S[STACK] & 0xFFFFFFFE
    S[NEXT] = S[PC]
    S[CYCLES] += S[ENTRY_CYCLES]


@njit(cache=True)
def leave_exception(S: State) -> None:
    """Exception return (ARMv7-M B1.5.8): unstack, or tail-chain to the next pending handler."""
    lr = S[PC]  # the EXC_RETURN value that was branched to
    sp = native.get_register(S, REG_SP)
    fp = lr & 0x10 == 0
    size = FP_FRAME if fp else BASIC_FRAME
    if native.read_memory(S, sp, STACK, size):
        S[ERROR] = ERROR_STACK
        return
    for k in range(4):
        native.set_register(S, REG_R0 + k, _take(S, k))
    native.set_register(S, REG_R12, _take(S, 4))
    native.set_register(S, REG_LR, _take(S, 5))
    S[PC] = _take(S, 6) & 0xFFFFFFFE
    xpsr = _take(S, 7)
    if fp:
        for k in range(16):
            native.set_register(S, REG_S0 + k, _take(S, 8 + k))
        native.set_register(S, REG_FPSCR, _take(S, 24))
    native.set_register(S, REG_SP, sp + size + (4 if xpsr >> 9 & 1 else 0))
    nvic.leave(S)
    native.set_register(S, REG_XPSR, xpsr & ~(1 << 9) | 1 << 24)
    S[NEXT] = S[PC]
    # The next handler, if one waits, is reached without unstacking and stacking again.
    if nvic.candidate(S) >= 0:
        S[CYCLES] += S[TAIL_CYCLES] - S[ENTRY_CYCLES]
    else:
        S[CYCLES] += S[EXIT_CYCLES]


@njit(cache=True)
def _put(S: State, word: int, value: int) -> None:
    slot, high = STACK + word // 2, word & 1
    if high:
        S[slot] = S[slot] & 0xFFFFFFFF | value << 32
    else:
        S[slot] = value & 0xFFFFFFFF


@njit(cache=True)
def _take(S: State, word: int) -> int:
    return S[STACK + word // 2] >> (32 * (word & 1)) & 0xFFFFFFFF


@njit(cache=True)
def run(S: State) -> int:
    """Run until UNTIL_NS, a transmit request, a fault or a reset request; which of them.

    Time may pass UNTIL_NS by the length of one basic block or exception entry.
    """
    while True:
        if S[RESET_REQUEST]:
            return RESET
        if S[CAN_TX_NEW]:
            return TRANSMIT
        events.service(S)
        until = cycles_at(S, S[UNTIL_NS])
        if S[CYCLES] >= until:
            return TIME
        S[DEADLINE] = min(until, events.due(S))
        irq = nvic.candidate(S)
        S[ATTEND] = 0
        if irq >= 0:
            S[SLEEPING] = 0  # a masked interrupt ends WFI, too
            if native.get_register(S, REG_PRIMASK) & 1:
                S[ATTEND] = 2
            else:
                enter_exception(S, irq)
                if S[ERROR]:
                    return FAULT
        elif S[SLEEPING]:
            S[CYCLES] = S[DEADLINE]
            continue
        S[STOPPED] = 0
        S[BLOCK] = -1  # none yet
        error = native.start(S, S[PC] | 1, S[COUNT])
        if S[STOPPED] != blocks.AT_BLOCK:
            S[PC] = native.get_register(S, REG_PC) & 0xFFFFFFFF
        if error and S[ERROR] == 0:
            S[ERROR] = error
        if S[ERROR]:
            return FAULT
        if S[RETURNING]:
            S[RETURNING] = 0
            leave_exception(S)
            if S[ERROR]:
                return FAULT
        elif S[STOPPED] == AT_BREAKPOINT:
            blocks.refund(S, S[PC])
            return BREAKPOINT
        elif not S[STOPPED] and S[PC] == S[NEXT]:
            S[SLEEPING] = 1
        if S[COUNT] and S[BLOCK] >= 0:
            if S[STOPPED] != blocks.AT_BLOCK:
                blocks.refund(S, S[PC])
            return STEP
