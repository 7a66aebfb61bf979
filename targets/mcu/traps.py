"""Why unicorn stopped, in the architecture's terms: its hooks note it, and here it becomes an exception.

unicorn stops before the instruction at fault, with the registers as that found them (measured for each case
in the tests); after SVC, WFI and WFE it stands behind them.
"""

from typing import Any

from numba import carray, types
from unicorn import unicorn_const as uc

from targets.jit import cfunc, njit
from targets.mcu import exceptions, faulting, faults, native, preemption
from targets.mcu.attention import has_fpu
from targets.mcu.faulting import REG_R0, REG_XPSR
from targets.mcu.memory import halfword
from targets.mcu.memory_map import CCM
from targets.mcu.preemption import SV_CALL
from targets.mcu.state import (
    ACCESS,
    ACCESS_ADDRESS,
    ACTIVE_DEPTH,
    BREAK_PASSED,
    CCR,
    ERROR,
    EVENT,
    PC,
    SIZE,
    SLEEPING,
    STOPPED,
    TRAP,
    State,
)

# STOPPED, beside blocks.AT_BLOCK
AT_INTERRUPT, AT_BREAKPOINT, AT_DIVISION, AT_FP = range(2, 6)

# unicorn's exception numbers
SVC, PREFETCH_ABORT, DATA_ABORT, BKPT, EXC_RETURN, NOCP, INVSTATE = 2, 3, 4, 7, 8, 17, 18

WFE, WIDE_HINT, WIDE_WFE = 0xBF20, 0xF3AF, 0x8002
DIV_0_TRP = 1 << 4

_CODE_HOOK = types.void(types.voidptr, types.uint64, types.uint32, types.voidptr)


@cfunc(types.void(types.voidptr, types.uint32, types.voidptr), cache=True)
def on_interrupt(engine: Any, number: int, user: Any) -> None:
    """uc_cb_hookintr_t: what unicorn leaves to an interrupt controller."""
    S = carray(user, (SIZE,), types.int64)
    S[TRAP] = types.int64(number)
    S[STOPPED] = AT_INTERRUPT
    native.stop(S)


@cfunc(
    types.uint8(types.voidptr, types.int32, types.uint64, types.int32, types.int64, types.voidptr),
    cache=True,
)
def on_invalid(engine: Any, kind: int, address: int, size: int, value: int, user: Any) -> int:
    """uc_cb_eventmem_t of an access that memory refuses: note it, and let it fail."""
    S = carray(user, (SIZE,), types.int64)
    S[ACCESS_ADDRESS] = types.int64(address)
    if kind in (uc.UC_MEM_FETCH_UNMAPPED, uc.UC_MEM_FETCH_PROT):
        S[ACCESS] = faults.FETCH
    elif kind in (uc.UC_MEM_WRITE_UNMAPPED, uc.UC_MEM_WRITE_PROT):
        S[ACCESS] = faults.WRITE
    else:
        S[ACCESS] = faults.READ
    return 0


@cfunc(_CODE_HOOK, cache=True)
def on_breakpoint(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of an instruction with a breakpoint: stop before it."""
    S = carray(user, (SIZE,), types.int64)
    if S[BREAK_PASSED] == types.int64(address):
        S[BREAK_PASSED] = -1
        return
    S[STOPPED] = AT_BREAKPOINT
    native.stop(S)


@njit(cache=True)
def divide_trap(S: State, address: int) -> bool:
    """Whether the SDIV or UDIV at `address` traps: it would divide by zero, and DIV_0_TRP is set."""
    if not S[CCR] & DIV_0_TRP:
        return False
    # T1 of both (ARMv7-M A7.7.127): Rm in bits 3:0 of the second halfword, never SP or PC
    divisor = halfword(S, address + 2) & 0xF
    if divisor == 14:
        return native.get_register(S, faulting.REG_LR) == 0
    return native.get_register(S, REG_R0 + divisor) == 0


@cfunc(_CODE_HOOK, cache=True)
def on_division(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of SDIV and UDIV: stop before one that traps."""
    S = carray(user, (SIZE,), types.int64)
    if divide_trap(S, types.int64(address)):
        S[STOPPED] = AT_DIVISION
        native.stop(S)


@cfunc(_CODE_HOOK, cache=True)
def on_fp(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of an FP instruction: stop before it while the FPU is off."""
    S = carray(user, (SIZE,), types.int64)
    if not has_fpu(S):
        S[STOPPED] = AT_FP
        native.stop(S)


@cfunc(_CODE_HOOK, cache=True)
def on_send_event(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of SEV."""
    S = carray(user, (SIZE,), types.int64)
    S[EVENT] = 1


@njit(cache=True)
def take_fault(S: State, kind: int, address: int) -> None:
    """The instruction at PC faults: the exception is taken, or ERROR set."""
    exception = faulting.fault(S, kind, address)
    if not S[ERROR]:
        exceptions.enter(S, exception)


@njit(cache=True)
def interrupted(S: State) -> None:
    """Act on the interrupt that unicorn stopped with, BKPT under a debugger left out."""
    number, pc = S[TRAP], S[PC]
    if number == EXC_RETURN and S[ACTIVE_DEPTH]:
        exceptions.leave(S)
    elif number == EXC_RETURN:
        take_fault(S, faults.FETCH_XN, pc)
    elif number == SVC:
        _call_supervisor(S)
    elif number == BKPT:
        take_fault(S, faults.BREAKPOINT, pc)
    elif number == NOCP:
        take_fault(S, faults.NO_COPROCESSOR, pc)
    elif number == INVSTATE:
        take_fault(S, faults.INVALID_STATE, pc)
    elif number == PREFETCH_ABORT:
        take_fault(S, faults.FETCH_XN if _in_thumb(S) else faults.INVALID_STATE, pc)
    elif number == DATA_ABORT:
        take_fault(S, faults.UNALIGNED, pc)
    else:
        faulting.end(S, faults.UNKNOWN, number)


@njit(cache=True)
def _call_supervisor(S: State) -> None:
    """SVCall waits for what is more urgent, but for nothing else (B1.5.4)."""
    priority = preemption.group(S, preemption.priority(S, SV_CALL))
    if priority < preemption.execution_priority(S):
        preemption.pend(S, SV_CALL)
    else:
        take_fault(S, faults.SUPERVISOR_CALL, S[PC])


@njit(cache=True)
def failed(S: State, error: int, behind: bool) -> None:
    """Act on unicorn's error; behind: PC is past the instruction that led to it."""
    address = S[ACCESS_ADDRESS]
    if error == uc.UC_ERR_INSN_INVALID:
        if behind:
            _hint(S)
        elif _in_thumb(S):
            take_fault(S, faults.UNDEFINED, S[PC])
        else:
            take_fault(S, faults.INVALID_STATE, S[PC])
    elif error in (uc.UC_ERR_FETCH_UNMAPPED, uc.UC_ERR_FETCH_PROT):
        take_fault(S, faults.FETCH_XN if _holds_no_code(S[PC]) else faults.FETCH_BUS, S[PC])
    elif error == uc.UC_ERR_WRITE_PROT:
        # Flash, at its own addresses or its alias; what else is read-only is ROM and answers no write.
        take_fault(S, faults.FLASH_WRITE if address < CCM else faults.DATA_BUS, address)
    elif error in (uc.UC_ERR_READ_UNMAPPED, uc.UC_ERR_WRITE_UNMAPPED, uc.UC_ERR_READ_PROT):
        take_fault(S, faults.DATA_BUS, address)
    else:
        faulting.end(S, faults.UNKNOWN, error)


@njit(cache=True)
def _in_thumb(S: State) -> bool:
    """Whether the engine was still in Thumb state: a branch to an even address leads out of it."""
    return native.get_register(S, REG_XPSR) & exceptions.T_BIT != 0


@njit(cache=True)
def _holds_no_code(address: int) -> bool:
    """The regions that are never executed from: peripherals, devices, system (B3.1)."""
    return 0x40000000 <= address < 0x60000000 or address >= 0xA0000000


@njit(cache=True)
def _hint(S: State) -> None:
    """WFE or YIELD: unicorn takes both for invalid, but stands behind them. YIELD does nothing."""
    behind = S[PC]
    wide = halfword(S, behind - 4) == WIDE_HINT and halfword(S, behind - 2) == WIDE_WFE
    if not wide and halfword(S, behind - 2) != WFE:
        return
    if S[EVENT]:
        S[EVENT] = 0
    else:
        S[SLEEPING] = exceptions.IN_WFE
