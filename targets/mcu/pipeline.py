"""The Cortex-M4's three stages, instruction by instruction: when each executes, what state a block leaves.

Fetch reads a 32-bit word a cycle and runs ahead by a few; decode takes an instruction when all its words are
there and computes addresses; execute holds it for its cycles. Times are cycles from the block's begin. The
figures are those of `timing.toml`, the rows those of `decode`. Belongs here: one block. Never: remembering
blocks (`blocks`).
"""

from targets.jit import njit
from targets.mcu import timing as fig
from targets.mcu.decode import (
    ACCUMULATES,
    AGU,
    BARRIER,
    BASE,
    BRANCH,
    BRANCH_REGISTER,
    COUNT_AT,
    CYCLES_AT,
    DIVIDE,
    FP,
    FP_LONG,
    FP_READS,
    FP_WRITES,
    INFO,
    IT,
    LITERAL,
    LOAD,
    LOAD_MANY,
    NOP,
    SIZE_AT,
    STORE,
    STORE_INDEXED,
    STORE_MANY,
    TABLE,
    WRITES,
    WRITES_PC,
)
from targets.mcu.state import (
    AGU_READY,
    FLASH_HALFWORDS,
    FP_READY,
    FREED,
    ISSUED,
    PIPELINE,
    RESULT,
    ROW_WORDS,
    ROWS,
    SRAM_HALFWORDS,
    State,
)

FLASH, SRAM = 0x08000000, 0x20000000
NOWHERE = -1

# How the fetch unit came to where a row of unaligned wide instructions can overtake it
STEADY, HELD, BRANCHED, BRANCHED_NARROW = range(4)

# What the last instruction was to the memory port
NO_ACCESS, LOADED, STORED, STORED_INDEXED = range(4)

LONG_AGO = -16
"""A time so far back that it holds nothing up any more; times in a state are kept from here to 15."""

ENTRY = (0, 0, 0)
"""State of a program's first block: nothing in flight, the fetch unit at its first instruction."""


@njit(cache=True)
def row(address: int) -> int:
    """Where the row of the instruction at `address` begins, NOWHERE if there are none for that memory."""
    half = (address - FLASH) >> 1
    if 0 <= half < FLASH_HALFWORDS:
        return ROWS + ROW_WORDS * half
    half = (address - SRAM) >> 1
    if 0 <= half < SRAM_HALFWORDS:
        return ROWS + ROW_WORDS * (FLASH_HALFWORDS + half)
    if 0 <= address >> 1 < FLASH_HALFWORDS:  # flash at its boot alias
        return ROWS + ROW_WORDS * (address >> 1)
    return NOWHERE


@njit(cache=True)
def _field(word: int, at: int) -> int:
    return (word >> at & 0x1F) + LONG_AGO


@njit(cache=True)
def _pack(time: int, at: int) -> int:
    return min(max(time, LONG_AGO), 15) - LONG_AGO << at


# First word of a state, times relative to its end
_AHEAD, _ISSUED, _FREED, _STOLEN, _REFILL, _DECODED, _ACCESS, _NARROW = 0, 2, 7, 22, 27, 32, 37, 40
_SET, _LATE, _ROW, _FLOATS = 41, 42, 44, 46


@njit(cache=True)
def refill(S: State, figures: int, a: int) -> int:
    """Cycles from the end of the state's block to where an instruction branched to executes."""
    fetch = S[PIPELINE + figures * len(fig.PIPELINE) + fig.FETCH_LATENCY]
    return max(_field(a, _REFILL) + fetch + 1, 0)


@njit(cache=True)
def simulate(
    S: State, figures: int, a: int, b: int, c: int, start: int, end: int, taken: bool, stop: int
) -> int:
    """Cycles of the instructions from `start` to `end`; the state they leave is in RESULT.

    figures: the set's number. a, b, c: the state at the begin. taken: entered by a branch, not from the
    instruction before. stop: an instruction's address, to learn when it executes instead (from the begin), or
    NOWHERE.
    """
    F = PIPELINE + figures * len(fig.PIPELINE)
    word = start >> 2
    free = 0  # when execute takes the next instruction
    decoded = -max(a >> _DECODED & 0x1F, 1)
    access = a >> _ACCESS & 7
    narrow = a >> _NARROW & 1
    late = a >> _LATE & 3
    row_length = a >> _ROW & 3  # unaligned wide instructions without a gap
    floats = a >> _FLOATS & 3
    stolen = _field(a, _STOLEN)
    for k in range(4):
        S[ISSUED + k] = LONG_AGO
        S[FREED + k] = LONG_AGO
    if taken or a == 0:
        last = word - 1
        S[ISSUED + (last & 3)] = _field(a, _REFILL) - 1 if a else LONG_AGO
        stolen = LONG_AGO
        late = STEADY if a == 0 else BRANCHED
        row_length = floats = 0
    else:
        last = word + (a & 3) - 1
        S[ISSUED + (last & 3)] = _field(a, _ISSUED)
        for k in range(3):
            S[FREED + (last - k & 3)] = _field(a, _FREED + 5 * k)
    for k in range(16):
        S[AGU_READY + k] = (b >> 2 * k & 3) - 1  # a load that overlaps begins a cycle before the state's end
    for k in range(32):
        S[FP_READY + k] = 1 if c >> k & 1 else LONG_AGO
    busy = b >> 32 & 0x1F
    long_result = b >> 37 & 0x3F  # register plus one
    if long_result:
        S[FP_READY + long_result - 1] = busy + S[F + fig.FP_RESULT]
    refill = LONG_AGO
    branched = 0

    at = start
    while at < end:
        r = row(at)
        info = S[r + INFO]
        kind = info & 0xFF
        halfwords = info >> SIZE_AT & 3
        count = info >> COUNT_AT & 0x3F
        cycles = info >> CYCLES_AT & 0xFF
        after = at + 2 * halfwords

        # Fetch: a word goes out when the one three before it has left the buffer, a cycle after the last
        final = (after - 1) >> 2
        while last < final:
            last += 1
            issue = max(S[ISSUED + (last - 1 & 3)] + 1, S[FREED + (last - S[F + fig.BUFFER_WORDS] & 3)] + 1)
            if issue == stolen:
                issue += 1
            S[ISSUED + (last & 3)] = issue
        decode = max(decoded, S[ISSUED + (final & 3)] + S[F + fig.FETCH_LATENCY])
        for w in range(at >> 2, after >> 2):
            S[FREED + (w & 3)] = decode

        # Execute
        begin = max(free, decode + 1)
        memory = kind in (LOAD, STORE, STORE_INDEXED)
        if (
            access == LOADED
            and memory
            and (kind != LOAD or S[r + FP_WRITES] == 0 or S[F + fig.FP_LOAD_PIPELINES])
        ) or (kind == NOP and access in (LOADED, STORED_INDEXED) and S[F + fig.NOP_HIDES]):
            begin = max(free - 1, decode + 1)
        elif kind in (LOAD, LOAD_MANY):
            if access == STORED:
                begin = max(begin, free + S[F + fig.LOAD_AFTER_STORE])
            elif access == STORED_INDEXED:
                begin = max(begin, free + S[F + fig.LOAD_AFTER_STORE_INDEXED])
        agu = S[r + AGU]
        k = 0
        while agu:
            if agu & 1:
                begin = max(begin, S[AGU_READY + k])
            agu >>= 1
            k += 1
        reads = S[r + FP_READS]
        if reads:
            addend = S[r + FP_WRITES] if info & ACCUMULATES else 0
            for k in range(32):
                if reads >> k & 1:
                    # A multiply-accumulate takes its addend a cycle later (TRM 7.2.3)
                    begin = max(begin, S[FP_READY + k] - (addend >> k & 1))
        if kind in (FP, FP_LONG):
            begin = max(begin, busy)
        if begin > decoded + 1 and begin > decode + 1:
            late, row_length = HELD, 0
        if halfwords == 2 and at & 2:
            row_length = min(row_length + 1, 3)
            floats = floats + 1 if kind == FP else 0
            if late == BRANCHED:  # paid for with the refill
                late = STEADY
            if row_length == 3 and late != STEADY:
                begin += S[F + fig.UNALIGNED_ROW]
                late = STEADY
            elif floats == 3:
                begin += S[F + fig.UNALIGNED_FLOATS]
                floats = 0
        else:
            row_length = floats = 0
            late = BRANCHED_NARROW if late == BRANCHED and halfwords == 1 else STEADY
        if at == stop:
            return begin

        hidden = False
        narrow_before = narrow
        narrow = 1 if halfwords == 1 else 0
        branched = 0
        next_access = NO_ACCESS
        ready = begin + 1 + S[F + fig.ADDRESS_AFTER_ALU]
        if kind == LOAD:
            spent = 2 + (S[F + fig.LITERAL_CYCLES] if info & LITERAL else 0)
            ready = begin + spent + S[F + fig.ADDRESS_AFTER_LOAD]
            next_access = LOADED
            if info & WRITES_PC:
                refill = begin + S[F + fig.LOAD_PC_FETCH]
                branched = 1
        elif kind == STORE:
            spent = 1
            next_access = STORED
        elif kind == STORE_INDEXED:
            spent = S[F + fig.STORE_INDEXED_CYCLES]
            next_access = STORED_INDEXED
        elif kind == LOAD_MANY:
            spent = 1 + count
            ready = begin + spent + S[F + fig.ADDRESS_AFTER_LOAD]
            if info & WRITES_PC:
                refill = begin + count + S[F + fig.POP_PC_FETCH]
                branched = 1
        elif kind == STORE_MANY:
            spent = 1 + count
            next_access = STORED
        elif kind in (BRANCH, BRANCH_REGISTER, TABLE):
            spent = 2 if kind == TABLE else 1
            branched = 1
            if kind == BRANCH:
                refill = begin + S[F + fig.BRANCH_FETCH]
                if S[F + fig.SPECULATION]:
                    stolen = refill
            elif kind == TABLE:
                refill = begin + S[F + fig.TABLE_FETCH]
            else:
                refill = begin + S[F + fig.BRANCH_REGISTER_FETCH]
        elif kind == DIVIDE:
            spent = S[F + fig.DIVIDE_LEAST]
            ready = begin + spent + S[F + fig.ADDRESS_AFTER_ALU]
        elif kind == FP_LONG:
            spent = 1
            busy = begin + cycles
        elif kind == IT:
            spent = 1
            hidden = narrow_before == 1 and S[F + fig.IT_FOLDS] == 1
        elif kind == BARRIER:
            spent = cycles
        else:
            spent = cycles
            ready = begin + spent + S[F + fig.ADDRESS_AFTER_ALU]

        if hidden:
            at = after
            continue
        free = begin + spent
        decoded = begin
        access = next_access
        writes = S[r + WRITES]
        k = 0
        while writes:
            if writes & 1:
                S[AGU_READY + k] = ready
            writes >>= 1
            k += 1
        base = S[r + BASE]
        k = 0
        while base:
            if base & 1:
                S[AGU_READY + k] = begin + 1 + S[F + fig.ADDRESS_AFTER_BASE]
            base >>= 1
            k += 1
        written = S[r + FP_WRITES]
        if written:
            result = free
            if kind == FP:
                result = free + S[F + fig.FP_RESULT]
            elif kind == FP_LONG:
                result = busy + S[F + fig.FP_RESULT]
            for k in range(32):
                if written >> k & 1:
                    S[FP_READY + k] = result
                    if kind == FP_LONG:
                        long_result = k + 1
        at = after

    # The state left, relative to its end
    word = end >> 2
    a = min(last - word + 1, 3) | _pack(S[ISSUED + (last & 3)] - free, _ISSUED)
    for k in range(3):
        w = last - k
        a |= _pack(S[FREED + (w & 3)] - free if w < word else LONG_AGO, _FREED + 5 * k)
    a |= _pack(stolen - free, _STOLEN) | _pack(refill - free if branched else -3, _REFILL)
    a |= min(max(free - decoded, 0), 31) << _DECODED | access << _ACCESS | narrow << _NARROW | 1 << _SET
    a |= late << _LATE | row_length << _ROW | floats << _FLOATS
    b = 0
    for k in range(16):
        b |= min(max(S[AGU_READY + k] - free + 1, 0), 3) << 2 * k
    wait = max(busy - free, 0)
    b |= min(wait, 31) << 32 | (long_result << 37 if wait else 0)
    c = 0
    for k in range(32):
        if S[FP_READY + k] > free and k + 1 != (long_result if wait else 0):
            c |= 1 << k
    S[RESULT], S[RESULT + 1], S[RESULT + 2] = a, b, c
    return free
