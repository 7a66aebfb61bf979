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
    FN_REG_READ,
    FN_REG_WRITE,
    FN_START,
    FN_STOP,
    SCRATCH,
    SELF,
    UC,
    State,
)

NOWHERE = 1
"""An address at which no instruction can lie: the engine stops at none."""

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


def _peeker(width: int) -> Callable[..., Any]:
    """A compiled function from a host address to the unsigned number of `width` bits there."""

    def peek(typingctx: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = builder.inttoptr(args[0], ir.IntType(width).as_pointer())
            return builder.zext(builder.load(pointer, align=1), ir.IntType(64))

        return types.int64(types.int64), codegen

    return intrinsic(peek)


peek = _peeker(32)
peek_half = _peeker(16)


@intrinsic
def poke(typingctx: Any, address: Any, value: Any) -> Any:
    """Write the low 32 bits of `value` at a host address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(32)
        pointer = builder.inttoptr(args[0], word.as_pointer())
        builder.store(builder.trunc(args[1], word), pointer, align=1)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), codegen


_start = _caller(types.int64, types.int64, types.int64, types.int64, types.int64)
_stop = _caller(types.int64)
_register = _caller(types.int64, types.int32, types.int64)


@intrinsic
def pointer(typingctx: Any, address: Any) -> Any:
    """An address as a pointer."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.IntType(8).as_pointer())

    return types.voidptr(types.int64), codegen


@njit(cache=True)
def start(S: State, address: int, count: int) -> int:
    """Run from `address` until a hook stops the engine, the core waits, or `count` instructions have run.

    count: 0 for any number. Returns unicorn's error code.
    """
    return _start(S[FN_START], (S[UC], address, NOWHERE, 0, count))


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


def bind(S: State, handle: int, library: ctypes.CDLL) -> None:
    """Put the engine's handle and the addresses of its functions into the state."""
    S[UC] = handle
    for slot, name in (
        (FN_START, "uc_emu_start"),
        (FN_STOP, "uc_emu_stop"),
        (FN_REG_READ, "uc_reg_read"),
        (FN_REG_WRITE, "uc_reg_write"),
    ):
        S[slot] = ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
