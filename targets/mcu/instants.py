"""Where in a block an access to a device happens: blocks are charged whole, a device wants its instant.

The engine does not say which instruction of a block is at work, but its registers are up to date: the access
is that of the first load or store, after the last one found, whose registers give its address.
"""

from unicorn import arm_const as arm

from targets.jit import njit
from targets.mcu import native, pipeline
from targets.mcu.blocks import SETS, cycles_of
from targets.mcu.decode import ADDRESS, HAS_INDEX, INFO, OFFSET_AT, SIZE_AT
from targets.mcu.state import (
    BLOCK,
    BLOCK_CYCLES,
    BLOCK_END,
    BLOCK_FLOW,
    BLOCK_TAKEN,
    FLOW_WORDS,
    FLOWS,
    LATE,
    SITE,
    State,
)

REG_R0, REG_SP, REG_LR = arm.UC_ARM_REG_R0, arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR


@njit(cache=True)
def locate(S: State, address: int) -> None:
    """Put into LATE how many of the block's cycles lie behind the access to `address` that happens now."""
    site = _search(S, S[SITE] + 1 if S[SITE] else S[BLOCK], address)
    if site == pipeline.NOWHERE:
        return
    S[SITE] = site
    flow = FLOWS + FLOW_WORDS * S[BLOCK_FLOW]
    for k in range(SETS):
        word = flow + 3 * k
        taken = S[BLOCK_TAKEN] != 0
        begin = pipeline.simulate(
            S, k, S[word], S[word + 1], S[word + 2], S[BLOCK], S[BLOCK_END], taken, site
        )
        S[LATE + k] = max(cycles_of(S[BLOCK_CYCLES], k) - begin - 1, 0)


@njit(cache=True)
def leave(S: State) -> None:
    """The access is over."""
    S[LATE] = 0
    S[LATE + 1] = 0
    S[LATE + 2] = 0


@njit(cache=True)
def _search(S: State, start: int, address: int) -> int:
    """The first load or store from `start` on whose registers give `address`; NOWHERE if there is none."""
    at = S[BLOCK]
    while at < S[BLOCK_END]:
        row = pipeline.row(at)
        place = S[row + ADDRESS]
        if place and at >= start:
            target = _register(S, place & 0xF) + (place >> OFFSET_AT)
            if place & HAS_INDEX:
                target += _register(S, place >> 4 & 0xF) << (place >> 9 & 7)
            if target & 0xFFFFFFFF == address:
                return at
        at += 2 * (S[row + INFO] >> SIZE_AT & 3)
    return pipeline.NOWHERE


@njit(cache=True)
def _register(S: State, number: int) -> int:
    if number == 13:
        return native.get_register(S, REG_SP)
    if number == 14:
        return native.get_register(S, REG_LR)
    return native.get_register(S, REG_R0 + number)
