"""Time by basic blocks: unicorn's block hook charges each block before it runs, and stops the engine when
due.
"""

from typing import Any

from numba import carray, types

from targets.jit import cfunc, njit
from targets.mcu import attention, native
from targets.mcu.state import (
    ATTEND,
    BLOCK,
    BRANCH_PENALTY,
    CODE_HALFWORDS,
    COST,
    CYCLES,
    DEADLINE,
    HALFWORDS,
    NEXT,
    PC,
    RAM_BLOCKS,
    STOPPED,
    State,
)

FLASH = 0x08000000

AT_BLOCK = 1
"""STOPPED by the block hook, which puts the block's address into PC: the engine's own may be stale."""


@njit(cache=True)
def _stop(S: State, address: int) -> None:
    S[STOPPED] = AT_BLOCK
    S[PC] = address
    native.stop(S)


@njit(cache=True)
def refund(S: State, address: int) -> None:
    """The last block was left at `address`: take back what was charged for the rest of it."""
    if not S[BLOCK] <= address < S[NEXT]:
        return
    first = (address - FLASH) >> 1
    last = (S[NEXT] - FLASH) >> 1
    S[HALFWORDS] -= last - first
    if first < 0 or last > S[CODE_HALFWORDS]:
        S[CYCLES] -= last - first
    else:
        S[CYCLES] -= S[COST + last] - S[COST + first]
    S[NEXT] = address


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_block(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of basic blocks: charge the block, or stop before it."""
    head = carray(user, (COST,), types.int64)
    at = types.int64(address)
    if head[CYCLES] >= head[DEADLINE] or (head[ATTEND] != 0 and attention.stops(head, at, size)):
        _stop(head, at)
        return
    if at != head[NEXT]:
        head[CYCLES] += head[BRANCH_PENALTY]
    end = at + size
    head[BLOCK] = at
    head[NEXT] = end
    first = (at - FLASH) >> 1
    last = (end - FLASH) >> 1
    limit = head[CODE_HALFWORDS]
    head[HALFWORDS] += last - first
    if first < 0 or last > limit:
        # Code in RAM has no costs yet: a halfword a cycle, and reported.
        head[CYCLES] += last - first
        head[RAM_BLOCKS] += 1
        return
    S = carray(user, (COST + limit + 1,), types.int64)
    head[CYCLES] += S[COST + last] - S[COST + first]
