"""Calls from compiled Python into unicorn's C interface, by address.

A register read from here costs nanoseconds where Python's costs microseconds. The addresses travel in the
state array, not in the code, so that the compiled functions can be cached on disk.
"""

import ctypes
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from targets.jit import njit
from targets.mcu.state import (
    FN_MEM_READ,
    FN_MEM_WRITE,
    FN_REG_READ,
    FN_REG_WRITE,
    FN_START,
    FN_STOP,
    SCRATCH,
    SELF,
    UC,
    State,
)

_WIDTH = {types.int64: 64, types.int32: 32}


def _caller(*arguments: Any) -> Callable[..., Any]:
    """A compiled function (address, *arguments as int64) -> int32 that calls the C function at `address`."""

    def call(typingctx: Any, address: Any, packed: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            kinds = [ir.IntType(_WIDTH[a]) for a in arguments]
            kind = ir.FunctionType(ir.IntType(32), kinds)
            target = builder.inttoptr(args[0], kind.as_pointer())
            values = cgutils.unpack_tuple(builder, args[1], len(arguments))
            narrowed = [
                builder.trunc(v, k) if k.width < 64 else v for v, k in zip(values, kinds, strict=True)
            ]
            return builder.call(target, narrowed)

        return types.int32(types.int64, types.UniTuple(types.int64, len(arguments))), codegen

    return intrinsic(call)


_start = _caller(types.int64, types.int64, types.int64, types.int64, types.int64)
_stop = _caller(types.int64)
_register = _caller(types.int64, types.int32, types.int64)
_memory = _caller(types.int64, types.int64, types.int64, types.int64)


@njit(cache=True)
def start(S: State, address: int) -> int:
    """Run from `address` until a hook stops the engine or the core waits; unicorn's error code."""
    return _start(S[FN_START], (S[UC], address, 0, 0, 0))


@njit(cache=True)
def stop(S: State) -> None:
    """Stop the engine; from a block hook, before the block's first instruction."""
    _stop(S[FN_STOP], (S[UC],))


@njit(cache=True)
def get_register(S: State, register: int) -> int:
    """A 32-bit core register, by unicorn's number."""
    S[SCRATCH] = 0
    _register(S[FN_REG_READ], (S[UC], register, S[SELF] + 8 * SCRATCH))
    return S[SCRATCH]


@njit(cache=True)
def set_register(S: State, register: int, value: int) -> None:
    """Write a 32-bit core register."""
    S[SCRATCH] = value
    _register(S[FN_REG_WRITE], (S[UC], register, S[SELF] + 8 * SCRATCH))


@njit(cache=True)
def read_memory(S: State, address: int, into: int, count: int) -> int:
    """Copy `count` bytes of the target's memory to the state array from word `into`; unicorn's error code."""
    return _memory(S[FN_MEM_READ], (S[UC], address, S[SELF] + 8 * into, count))


@njit(cache=True)
def write_memory(S: State, address: int, source: int, count: int) -> int:
    """Copy `count` bytes from word `source` of the state array to the target's memory."""
    return _memory(S[FN_MEM_WRITE], (S[UC], address, S[SELF] + 8 * source, count))


def bind(S: State, handle: int, library: ctypes.CDLL) -> None:
    """Put the engine's handle and the addresses of its functions into the state."""
    S[UC] = handle
    for slot, name in (
        (FN_START, "uc_emu_start"),
        (FN_STOP, "uc_emu_stop"),
        (FN_REG_READ, "uc_reg_read"),
        (FN_REG_WRITE, "uc_reg_write"),
        (FN_MEM_READ, "uc_mem_read"),
        (FN_MEM_WRITE, "uc_mem_write"),
    ):
        S[slot] = ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
