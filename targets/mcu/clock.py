"""Cycles to nanoseconds and back, exactly, across changes of the CPU's clock."""

from targets.jit import njit
from targets.mcu.state import ATTEND, BASE_CYCLES, BASE_NS, CYCLES, HZ, LATE, State

NS = 1_000_000_000


@njit(cache=True)
def now_cycles(S: State) -> int:
    """The CPU cycles that have passed: of the block at work, those up to the access that a device answers."""
    return S[CYCLES] - S[LATE]


@njit(cache=True)
def ns_of(S: State, cycles: int) -> int:
    """The instant of a cycle count (of the current clock's era), rounded down."""
    # Whole seconds apart: the product of all cycles and 10^9 would leave 64 bits after seven minutes.
    elapsed = cycles - S[BASE_CYCLES]
    return S[BASE_NS] + elapsed // S[HZ] * NS + elapsed % S[HZ] * NS // S[HZ]


@njit(cache=True)
def now_ns(S: State) -> int:
    """The instant the CPU has reached."""
    return ns_of(S, now_cycles(S))


@njit(cache=True)
def cycles_at(S: State, t_ns: int) -> int:
    """The first cycle count whose instant is not before `t_ns`."""
    elapsed = t_ns - S[BASE_NS]
    # -(-a // b) is a / b rounded up
    return S[BASE_CYCLES] + elapsed // NS * S[HZ] - (-(elapsed % NS) * S[HZ]) // NS


@njit(cache=True)
def set_hz(S: State, hz: int, cycles: int) -> None:
    """From `cycles` on the CPU runs at `hz`; the run loop must look at its deadline again."""
    S[BASE_NS] = ns_of(S, cycles)
    S[BASE_CYCLES] = cycles
    S[HZ] = hz
    S[ATTEND] = 1
