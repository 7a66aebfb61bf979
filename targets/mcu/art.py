"""The flash's wait states behind the ART accelerator (RM0090 section 3.5.1): what fetching a block costs.

Flash gives lines of 128 bits. A line comes from the instruction cache, from the prefetch of the line after
the one that runs, or after the wait states. At zero wait states nothing here is called.
"""

from targets.jit import njit
from targets.mcu.state import (
    ART_CLOCK,
    ART_LINE,
    ART_MAP,
    ART_SLOTS,
    ART_STAMPS,
    CYCLES,
    CYCLES_MAX,
    CYCLES_MIN,
    FLASH_ACR,
    FLASH_LINES,
    State,
)

FLASH = 0x08000000
SLOTS = 64
"""Lines that the instruction cache holds; the least recently used one makes room."""

LATENCY, PREFETCH, ICACHE = 0xF, 1 << 8, 1 << 9
PREFETCH_START = 1
"""Cycles of a line's life that its read does not overlap: fitted, see docs/timing.md."""


@njit(cache=True)
def charge(S: State, at: int, end: int, cycles: int) -> None:
    """Add the waits for the lines of the block [at, end), which takes `cycles` without them."""
    first = (at & 0x07FFFFFF) >> 4
    last = ((end - 1) & 0x07FFFFFF) >> 4
    if at >> 27 > 1 or last >= FLASH_LINES:  # not flash, nor its alias
        return
    control = S[FLASH_ACR]
    wait = control & LATENCY
    per_line = cycles * 16 // (end - at)
    for line in range(first, last + 1):
        if line == S[ART_LINE]:
            continue
        follows = line == S[ART_LINE] + 1
        S[ART_LINE] = line
        S[CYCLES_MAX] += wait
        if control & ICACHE:
            slot = S[ART_MAP + line]
            S[ART_CLOCK] += 1
            if slot:
                S[ART_STAMPS + slot - 1] = S[ART_CLOCK]
                continue
            _keep(S, line)
        if control & PREFETCH and follows:
            S[CYCLES] += max(wait + PREFETCH_START - per_line, 0)
            S[CYCLES_MIN] += max(wait - per_line, 0)
        else:
            S[CYCLES] += wait
            S[CYCLES_MIN] += wait


@njit(cache=True)
def _keep(S: State, line: int) -> None:
    oldest = 0
    for k in range(SLOTS):
        if S[ART_STAMPS + k] < S[ART_STAMPS + oldest]:
            oldest = k
    if S[ART_STAMPS + oldest]:
        S[ART_MAP + S[ART_SLOTS + oldest]] = 0
    S[ART_SLOTS + oldest] = line
    S[ART_STAMPS + oldest] = S[ART_CLOCK]
    S[ART_MAP + line] = oldest + 1


@njit(cache=True)
def clear(S: State) -> None:
    """Forget all lines, as ICRST does."""
    for k in range(SLOTS):
        if S[ART_STAMPS + k]:
            S[ART_MAP + S[ART_SLOTS + k]] = 0
            S[ART_STAMPS + k] = 0
    S[ART_LINE] = -1
