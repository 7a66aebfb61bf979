"""A trace of the program: which functions it enters, or which basic blocks it runs, and when.

A block's instant is the one at its end, as everywhere in the emulator: its time is charged at once.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import carray, types

from targets.jit import cfunc
from targets.mcu import clock, state
from targets.mcu.machine import Stm32f405
from targets.mcu.native import pointer
from targets.mcu.state import CYCLES

CAPACITY = 1 << 18
"""Entries between two calls of `take`: more than the cycles of a millisecond at 168 MHz."""

_STATE, _COUNT, _STARTS, _HEAD = 0, 1, 2, 3


class Step(NamedTuple):
    """The program was at `address`, at `t_ns`."""

    t_ns: int
    address: int


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_block(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of basic blocks: note this one, if it begins a function or all are wanted."""
    head = carray(user, (_HEAD,), types.int64)
    at, starts, count = types.int64(address), head[_STARTS], head[_COUNT]
    table = carray(user, (_HEAD + starts + 2 * CAPACITY,), types.int64)
    if starts:
        low, high = 0, starts
        while low < high:
            middle = (low + high) // 2
            if table[_HEAD + middle] < at:
                low = middle + 1
            else:
                high = middle
        if low == starts or table[_HEAD + low] != at:
            return
    if count < CAPACITY:
        S = carray(pointer(head[_STATE]), (state.SIZE,), types.int64)
        place = _HEAD + starts + 2 * count
        table[place] = clock.ns_of(S, S[CYCLES])
        table[place + 1] = at
    head[_COUNT] = count + 1


class Trace:
    """Follows `mcu` from now on: entries of functions, or every basic block."""

    def __init__(self, mcu: Stm32f405, every_block: bool = False) -> None:
        starts = [] if every_block else sorted({address for address, _ in mcu.image.functions})
        self._table = np.zeros(_HEAD + len(starts) + 2 * CAPACITY, dtype=np.int64)
        self._first = _HEAD + len(starts)
        self._table[:_HEAD] = state.as_pointer(mcu.state), 0, len(starts)
        self._table[_HEAD : self._first] = starts
        mcu.watch_blocks(on_block.address, self._table)

    def take(self) -> tuple[list[Step], int]:
        """What has come since the last time, and how many more there was no room for."""
        count = int(self._table[_COUNT])
        kept = min(count, CAPACITY)
        rows = self._table[self._first : self._first + 2 * kept].reshape(-1, 2).tolist()
        self._table[_COUNT] = 0
        return [Step(*row) for row in rows], count - kept
