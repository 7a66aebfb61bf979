"""The target's memories as the host sees them: a word costs nanoseconds, by way of unicorn a hundred.

For what the CPU itself reads and writes around exceptions: frames, vectors, instructions. unicorn does not
learn of a write: code that lies where a frame is stacked would go on as it was.
"""

from targets.jit import njit
from targets.mcu import native
from targets.mcu.state import MEMORIES, State

COUNT = 3
NOWHERE = 0


@njit(cache=True)
def _host(S: State, address: int, size: int, first: int) -> int:
    for k in range(first, COUNT):
        base = S[MEMORIES + 3 * k]
        if base <= address and address + size <= base + S[MEMORIES + 3 * k + 1]:
            return S[MEMORIES + 3 * k + 2] + address - base
    return NOWHERE


@njit(cache=True)
def readable(S: State, address: int, size: int) -> int:
    """Host address of `size` bytes of memory, NOWHERE if not all of them are in one."""
    return _host(S, address, size, 0)


@njit(cache=True)
def writable(S: State, address: int, size: int) -> int:
    """The same, the flash left out."""
    return _host(S, address, size, 1)


@njit(cache=True)
def word(S: State, address: int) -> int:
    """A word of memory, -1 if there is none."""
    host = readable(S, address, 4)
    return native.peek(host) if host else -1


@njit(cache=True)
def halfword(S: State, address: int) -> int:
    """A halfword of memory, -1 if there is none."""
    host = readable(S, address, 2)
    return native.peek_half(host) if host else -1
