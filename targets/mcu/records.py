"""Rings of records: pin edges, text written, bytes fed; compiled code appends, Python reads between runs.

They lie in an array beside the state, which holds its address. A ring keeps its newest records and counts
all of them, so that nothing is lost silently. Belongs here: the rings. Never: what a record means.
"""

from typing import Any

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from targets.jit import njit
from targets.mcu.native import pointer
from targets.mcu.state import RING_STRIDE, RINGS, State

EDGES = 0
LOG = 1  # seven: USART1 to USART6, ITM
INPUT = 8  # six: bytes on their way into USART1 to USART6
COUNT = 14

EDGE_WORDS = 5
LOG_WORDS = 2
_SHAPES = ((8192, EDGE_WORDS), *((16384, LOG_WORDS),) * 7, *((4096, 1),) * 6)


def attach(S: State) -> NDArray[np.int64]:
    """Give the rings of `S` memory; the caller keeps the array as long as the state."""
    memory = np.zeros(sum(capacity * words for capacity, words in _SHAPES), dtype=np.int64)
    address = memory.ctypes.data
    for ring, (capacity, words) in enumerate(_SHAPES):
        at = RINGS + RING_STRIDE * ring
        S[at : at + RING_STRIDE] = (address, capacity, words, 0, 0)
        address += 8 * capacity * words
    return memory


@njit(cache=True)
def append(S: State, ring: int, record: Any) -> None:
    """Append a record, a tuple of integers; the oldest one makes room."""
    at = RINGS + RING_STRIDE * ring
    capacity, count = S[at + 1], S[at + 3]
    S[at + 3] = count + 1
    if capacity > 0:  # a state without memory for its rings only counts
        place = carray(pointer(S[at] + 8 * len(record) * (count % capacity)), (len(record),), types.int64)
        for k in range(len(record)):
            place[k] = record[k]


@njit(cache=True)
def waiting(S: State, ring: int) -> int:
    """Records that have not been taken."""
    at = RINGS + RING_STRIDE * ring
    return S[at + 3] - S[at + 4]


@njit(cache=True)
def take(S: State, ring: int) -> int:
    """The first word of the oldest record not taken yet, which is taken."""
    at = RINGS + RING_STRIDE * ring
    place = S[at] + 8 * S[at + 2] * (S[at + 4] % S[at + 1])
    S[at + 4] += 1
    return carray(pointer(place), (1,), types.int64)[0]


@njit(cache=True)
def room(S: State, ring: int) -> int:
    """Records that may be appended before one not taken is lost."""
    return S[RINGS + RING_STRIDE * ring + 1] - waiting(S, ring)


@njit(cache=True)
def _copy(S: State, ring: int, into: Any) -> None:
    at = RINGS + RING_STRIDE * ring
    kept, words, count = into.shape[0], S[at + 2], S[at + 3]
    memory = carray(pointer(S[at]), (S[at + 1], words), types.int64)
    for k in range(kept):
        into[k] = memory[(count - kept + k) % S[at + 1]]


def kept(S: State, ring: int) -> NDArray[np.int64]:
    """The records of a ring, oldest first: int64 (records, words)."""
    at = RINGS + RING_STRIDE * ring
    into = np.empty((min(int(S[at + 1]), int(S[at + 3])), int(S[at + 2])), dtype=np.int64)
    _copy(S, ring, into)
    return into


def lost(S: State, ring: int) -> int:
    """Records that newer ones have replaced."""
    at = RINGS + RING_STRIDE * ring
    return max(0, int(S[at + 3]) - int(S[at + 1]))
