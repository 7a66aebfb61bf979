"""Time by basic blocks: the block hook charges each block before it runs, and stops the engine when due.

What a block costs depends on the state in which the pipeline reaches it. A state has a number, and
(state, block) -> (cycles, next state) is computed once and remembered, so that the sum over a run is the
simulation of all its instructions. Belongs here: remembering, charging. Never: what an instruction costs.
"""

from typing import Any

from numba import carray, types
from unicorn import arm_const as arm

from targets.jit import cfunc, njit
from targets.mcu import art, attention, native, pipeline
from targets.mcu.decode import INFO, SIZE_AT
from targets.mcu.pipeline import NOWHERE
from targets.mcu.state import (
    ATTEND,
    BASE_NS,
    BLOCK,
    BLOCK_CYCLES,
    BLOCK_END,
    BLOCK_FLOW,
    BLOCK_TAKEN,
    CALL_END,
    CYCLES,
    CYCLES_MAX,
    CYCLES_MIN,
    DEADLINE,
    DECODE_AT,
    DECODE_SIZE,
    FLASH_ACR,
    FLOW,
    FLOW_WORDS,
    FLOWS,
    FLOWS_MAX,
    FLOWS_USED,
    INSTRUCTIONS,
    MEMO,
    MEMO_MAX,
    MEMO_WORDS,
    NEXT,
    PC,
    RESULT,
    SITE,
    SIZE,
    STOPPED,
    THUMB,
    UNTIL_NS,
    State,
)

AT_BLOCK = 1
"""STOPPED by the block hook, which puts the block's address into PC: the engine's own may be stale."""

REG_XPSR = arm.UC_ARM_REG_XPSR
SETS = 3
MODEL, OPTIMISTIC, PESSIMISTIC = range(SETS)
_BITS, _MASK = 20, (1 << 20) - 1
_SPREAD = 0x2545F4914F6CDD1D


@njit(cache=True)
def cycles_of(packed: int, figures: int) -> int:
    """Cycles that one set of figures gives a block, from its memory."""
    return packed >> _BITS * figures & _MASK


@njit(cache=True)
def _stop(S: State, address: int) -> None:
    S[STOPPED] = AT_BLOCK
    S[PC] = address
    S[THUMB] = native.get_register(S, REG_XPSR) >> 24 & 1
    native.stop(S)


@njit(cache=True)
def restart(S: State) -> None:
    """The next instruction does not follow from the last: an exception, or a debugger, came between."""
    S[NEXT] = S[PC]
    S[FLOW] = 0


@njit(cache=True)
def refund(S: State, address: int) -> None:
    """The last block was left at `address`: take back what was charged for the rest of it."""
    if not S[BLOCK] <= address < S[NEXT]:
        return
    flow = FLOWS + FLOW_WORDS * S[BLOCK_FLOW]
    taken = S[BLOCK_TAKEN] != 0
    for k in range(SETS):
        word = flow + 3 * k
        spent = 0
        for j in range(3):
            S[RESULT + j] = S[word + j]
        if address > S[BLOCK]:
            spent = pipeline.simulate(
                S, k, S[word], S[word + 1], S[word + 2], S[BLOCK], address, taken, NOWHERE
            )
        for j in range(3):
            S[RESULT + 3 + 3 * k + j] = S[RESULT + j]
        S[CYCLES if k == MODEL else CYCLES_MIN + k - 1] -= cycles_of(S[BLOCK_CYCLES], k) - spent
    at = address
    while at < S[NEXT]:
        S[INSTRUCTIONS] -= 1
        at += 2 * (S[pipeline.row(at) + INFO] >> SIZE_AT & 3)
    S[FLOW] = _number(S) if S[RESULT + 3] else 0
    # Left before its first instruction, the block is yet to be entered, by the branch it was entered by.
    S[NEXT] = NOWHERE if taken and address == S[BLOCK] else address


@njit(cache=True)
def _remember(S: State, entry: int, key: int, at: int, size: int, taken: int) -> bool:
    """Simulate a block and keep the result at `entry`; False if it has no rows yet."""
    end = at + size
    instructions = 0
    address = at
    while address < end:
        row = pipeline.row(address)
        if row == NOWHERE or S[row + INFO] == 0:
            return False
        address += 2 * (S[row + INFO] >> SIZE_AT & 3)
        instructions += 1
    cycles = 0
    flow = FLOWS + FLOW_WORDS * S[FLOW]
    for k in range(SETS):
        word = flow + 3 * k
        spent = pipeline.simulate(S, k, S[word], S[word + 1], S[word + 2], at, end, taken != 0, NOWHERE)
        cycles |= min(spent, _MASK) << _BITS * k
        for j in range(3):
            S[RESULT + 3 + 3 * k + j] = S[RESULT + j]
    S[entry] = key
    S[entry + 1] = cycles
    S[entry + 2] = _number(S) | instructions << 16
    return True


@njit(cache=True)
def _settle(S: State) -> None:
    """A called function has returned: charge the refill up to where the next instruction would execute."""
    flow = FLOWS + FLOW_WORDS * S[FLOW]
    S[CYCLES] += pipeline.refill(S, MODEL, S[flow])
    S[CYCLES_MIN] += pipeline.refill(S, OPTIMISTIC, S[flow + 3])
    S[CYCLES_MAX] += pipeline.refill(S, PESSIMISTIC, S[flow + 6])


@njit(cache=True)
def _number(S: State) -> int:
    """The number of the state in RESULT + 3: the one it has, or a new one."""
    mixed = 0
    for k in range(FLOW_WORDS):
        mixed = (mixed ^ S[RESULT + 3 + k]) * _SPREAD
    slot = (mixed >> 40) & FLOWS_MAX - 1
    while True:
        at = FLOWS + FLOW_WORDS * slot
        same = True
        for k in range(FLOW_WORDS):
            same = same and S[at + k] == S[RESULT + 3 + k]
        if same:
            return slot
        # Number 0 is the state of a program's begin, all zero; no block leaves that.
        if slot and S[at] == 0:
            for k in range(FLOW_WORDS):
                S[at + k] = S[RESULT + 3 + k]
            S[FLOWS_USED] += 1
            return slot
        slot = slot + 1 & FLOWS_MAX - 1


@njit(cache=True)
def _forget(S: State) -> None:
    """Make room: all states but the present one go, and with them all blocks. It costs time, not accuracy."""
    present = FLOWS + FLOW_WORDS * S[FLOW]
    for k in range(FLOW_WORDS):
        S[RESULT + 3 + k] = S[present + k]
    S[FLOWS : FLOWS + FLOW_WORDS * FLOWS_MAX] = 0
    S[MEMO : MEMO + MEMO_WORDS * MEMO_MAX] = 0
    S[FLOWS_USED] = 0
    S[FLOW] = _number(S) if S[RESULT + 3] else 0


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_block(engine: Any, address: int, size: int, user: Any) -> None:
    """uc_cb_hookcode_t of basic blocks: charge the block, or stop before it."""
    S = carray(user, (SIZE,), types.int64)
    at = types.int64(address)
    if S[CYCLES] >= S[DEADLINE] or (S[ATTEND] != 0 and attention.stops(S, at, types.int64(size))):
        _stop(S, at)
        return
    if S[FLOWS_USED] >= FLOWS_MAX * 3 // 4:
        _forget(S)
    flow = S[FLOW]
    taken = types.int64(at != S[NEXT])
    key = at | taken << 32 | flow << 33 | types.int64(size) << 45
    entry = MEMO + MEMO_WORDS * ((key * _SPREAD) >> 40 & MEMO_MAX - 1)
    if S[entry] != key and not _remember(S, entry, key, at, types.int64(size), taken):
        if at == S[CALL_END] != 0:
            _settle(S)
            S[UNTIL_NS] = S[BASE_NS]
        else:
            S[DECODE_AT] = at
            S[DECODE_SIZE] = size
        _stop(S, at)
        return
    end = at + size
    S[BLOCK] = at
    S[BLOCK_END] = end
    S[BLOCK_FLOW] = flow
    S[BLOCK_TAKEN] = taken
    S[SITE] = 0
    S[NEXT] = end
    cycles = S[entry + 1]
    S[BLOCK_CYCLES] = cycles
    S[CYCLES] += cycles & _MASK
    S[CYCLES_MIN] += cycles >> _BITS & _MASK
    S[CYCLES_MAX] += cycles >> 2 * _BITS
    if S[FLASH_ACR] & art.LATENCY:
        art.charge(S, at, end, cycles & _MASK)
    after = S[entry + 2]
    S[FLOW] = after & 0xFFFF
    S[INSTRUCTIONS] += after >> 16
