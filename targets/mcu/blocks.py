"""Time by basic blocks: unicorn's block hook charges each block before it runs, and stops the engine when
due.
"""

from typing import Any

from numba import carray, types
from unicorn import arm_const as arm

from targets.jit import cfunc
from targets.mcu import native
from targets.mcu.state import (
    ATTEND,
    BASE_NS,
    BRANCH_PENALTY,
    CALL_END,
    CODE_HALFWORDS,
    COST,
    CYCLES,
    DEADLINE,
    HALFWORDS,
    NEXT,
    RAM_BLOCKS,
    STOPPED,
    UNTIL_NS,
)

FLASH = 0x08000000
REG_PRIMASK = arm.UC_ARM_REG_PRIMASK


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_block(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of basic blocks: charge the block, or stop before it."""
    head = carray(user, (COST,), types.int64)
    at = types.int64(address)
    if head[CYCLES] >= head[DEADLINE] or head[ATTEND] == 1:
        head[STOPPED] = 1
        native.stop(head)
        return
    if head[ATTEND] == 2 and native.get_register(head, REG_PRIMASK) & 1 == 0:
        head[STOPPED] = 1
        native.stop(head)
        return
    if at != head[NEXT]:
        head[CYCLES] += head[BRANCH_PENALTY]
    end = at + size
    head[NEXT] = end
    first = (at - FLASH) >> 1
    last = (end - FLASH) >> 1
    limit = head[CODE_HALFWORDS]
    head[HALFWORDS] += last - first
    if first < 0 or last > limit:
        if at == head[CALL_END]:
            # The branch that led here is charged, what it leads to is not.
            head[UNTIL_NS] = head[BASE_NS]
            head[STOPPED] = 1
            native.stop(head)
            return
        # Code in RAM has no costs yet: a halfword a cycle, and reported.
        head[CYCLES] += last - first
        head[RAM_BLOCKS] += 1
        return
    S = carray(user, (COST + limit + 1,), types.int64)
    head[CYCLES] += S[COST + last] - S[COST + first]
