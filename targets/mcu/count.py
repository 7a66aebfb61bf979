"""Counting executed instructions: how often each basic block ran, then how many instructions each one has.

An instruction in an IT block counts whether or not its condition held: it passes through the pipeline.
"""

from typing import Any

import numpy as np
from numba import carray, types

from targets.jit import cfunc
from targets.mcu.machine import Stm32f405

SLOTS = 1 << 16
"""Of the table of blocks, a power of two. Two words each, and one for those that found no room."""


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_block(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of basic blocks: one more time this one."""
    table = carray(user, (2 * SLOTS + 1,), types.int64)
    key = types.int64(address) << 16 | types.int64(size)
    slot = (key >> 1 ^ key >> 17) & (SLOTS - 1)
    for _ in range(SLOTS):
        if table[2 * slot] == key or table[2 * slot + 1] == 0:
            table[2 * slot] = key
            table[2 * slot + 1] += 1
            return
        slot = (slot + 1) & (SLOTS - 1)
    table[2 * SLOTS] += 1


class Counter:
    """Counts the instructions that `mcu` executes from `begin` on."""

    def __init__(self, mcu: Stm32f405) -> None:
        self._mcu = mcu
        self._table = np.zeros(2 * SLOTS + 1, dtype=np.int64)
        mcu.watch_blocks(on_block.address, self._table)

    def begin(self) -> None:
        """Count from here."""
        self._table[:] = 0

    def instructions(self) -> int:
        """Executed since `begin`, as far as their code still stands in memory."""
        blocks = self._table[:-1].reshape(-1, 2)
        blocks = blocks[blocks[:, 1] > 0]
        return sum(
            times * length(self._mcu.read_bytes(key >> 16, key & 0xFFFF)) for key, times in blocks.tolist()
        )


def length(code: bytes) -> int:
    """Instructions in a run of Thumb code: 0b11101, 11110 or 11111 begins one of four bytes."""
    at = count = 0
    while at < len(code):
        at += 4 if code[at + 1] >= 0xE8 else 2
        count += 1
    return count
