"""Instructions whose cycles depend on data: divisions, and conditional ones that an IT block skips.

The block is charged for the shortest division and for every instruction executed; hooks on these instructions
alone, before each, put that right.
"""

from typing import Any

from numba import carray, types
from unicorn import arm_const as arm

from targets.jit import cfunc, njit
from targets.mcu import native, pipeline
from targets.mcu import timing as fig
from targets.mcu.decode import (
    CONDITION_AT,
    CONDITIONAL,
    COUNT_AT,
    CYCLES_AT,
    DIVIDE,
    FP,
    INFO,
    LOAD,
    LOAD_MANY,
    OPERANDS,
    STORE_INDEXED,
    STORE_MANY,
)
from targets.mcu.state import CYCLES, CYCLES_MAX, CYCLES_MIN, PIPELINE, SIZE, State

REG_XPSR, REG_R0, REG_R12, REG_SP, REG_LR = (
    arm.UC_ARM_REG_XPSR,
    arm.UC_ARM_REG_R0,
    arm.UC_ARM_REG_R12,
    arm.UC_ARM_REG_SP,
    arm.UC_ARM_REG_LR,
)


def is_dynamic(info: int) -> bool:
    """Whether the instruction of a row's INFO needs the hook."""
    kind = info & 0xFF
    if kind == DIVIDE:
        return True
    many = kind in (LOAD, LOAD_MANY, STORE_MANY, STORE_INDEXED) or (
        kind == FP and info >> CYCLES_AT & 0xFF > 1
    )
    return bool(info & CONDITIONAL) and many


@njit(cache=True)
def passes(xpsr: int, condition: int) -> bool:
    """Whether the flags fulfil a condition code (ARMv7-M A7.3)."""
    n, z, c, v = xpsr >> 31 & 1, xpsr >> 30 & 1, xpsr >> 29 & 1, xpsr >> 28 & 1
    kind = condition >> 1
    if kind == 0:
        held = z == 1
    elif kind == 1:
        held = c == 1
    elif kind == 2:
        held = n == 1
    elif kind == 3:
        held = v == 1
    elif kind == 4:
        held = c == 1 and z == 0
    elif kind == 5:
        held = n == v
    elif kind == 6:
        held = n == v and z == 0
    else:
        return True
    return held != bool(condition & 1)


@njit(cache=True)
def quotient_bits(dividend: int, divisor: int) -> int:
    """Bits of the quotient of two magnitudes, 0 if the divisor is the larger one or zero."""
    if divisor == 0 or dividend < divisor:
        return 0
    bits = 1
    while divisor << bits <= dividend:
        bits += 1
    return bits


@njit(cache=True)
def _operand(S: State, number: int, signed: bool) -> int:
    value = native.get_register(S, REG_LR if number == 14 else REG_SP if number == 13 else REG_R0 + number)
    return abs(value - (1 << 32)) if signed and value >> 31 else value


@njit(cache=True)
def correct(S: State, address: int) -> None:
    """Charge what the instruction at `address` takes beside what its block was charged for it."""
    row = pipeline.row(address)
    info = S[row + INFO]
    kind = info & 0xFF
    if info & CONDITIONAL and not passes(native.get_register(S, REG_XPSR), info >> CONDITION_AT & 0xF):
        count = info >> COUNT_AT & 0x3F
        saved = 1
        if kind in (LOAD_MANY, STORE_MANY):
            saved = count
        elif kind == FP:
            saved = (info >> CYCLES_AT & 0xFF) - 1
        elif kind == DIVIDE:
            saved = S[PIPELINE + fig.DIVIDE_LEAST] - 1
        S[CYCLES] -= saved
        S[CYCLES_MIN] -= saved
        S[CYCLES_MAX] -= saved
        return
    if kind != DIVIDE:
        return
    operands = S[row + OPERANDS]
    signed = operands >> 8 & 1 == 1
    bits = quotient_bits(_operand(S, operands & 0xF, signed), _operand(S, operands >> 4 & 0xF, signed))
    least, most = S[PIPELINE + fig.DIVIDE_LEAST], S[PIPELINE + fig.DIVIDE_MOST]
    S[CYCLES] += ((most - least) * bits + 31) // 32
    S[CYCLES_MIN] += (most - least) * bits // 40
    S[CYCLES_MAX] += most - least if bits else 0


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_instruction(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of one instruction whose cycles depend on data."""
    S = carray(user, (SIZE,), types.int64)
    correct(S, types.int64(address))
