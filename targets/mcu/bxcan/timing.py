"""bxCAN's bit time (RM0090 section 32.7.7) and its counter of bits for time stamps (32.7.2)."""

from targets.jit import njit
from targets.mcu.bxcan.registers import TTCM
from targets.mcu.clock import NS
from targets.mcu.rcc import apb1_divisor
from targets.mcu.state import CAN_BTR, CAN_EPOCH_NS, CAN_MCR, HZ, State


@njit(cache=True)
def bit_cycles(S: State, c: int) -> int:
    """CPU cycles of one bit, as BTR gives them."""
    btr = S[CAN_BTR + c]
    quanta = 1 + ((btr >> 16 & 0xF) + 1) + ((btr >> 20 & 7) + 1)
    return ((btr & 0x3FF) + 1) * quanta * apb1_divisor(S)


@njit(cache=True)
def bitrate(S: State, c: int) -> int:
    """Bits per second at the present clock."""
    return S[HZ] // bit_cycles(S, c)


@njit(cache=True)
def span_ns(S: State, c: int, bits: int) -> int:
    """Nanoseconds of `bits` bits, rounded down as instants are: the CPU sees them in the right cycle."""
    return bits * bit_cycles(S, c) * NS // S[HZ]


@njit(cache=True)
def whole_spans(S: State, c: int, ns: int, bits: int) -> int:
    """How many times `bits` bits are over after `ns`; half a bit may be missing: clocks differ a little."""
    cycles = bit_cycles(S, c)
    return (ns * S[HZ] + cycles * NS // 2) // (bits * cycles * NS) if ns > 0 else 0


@njit(cache=True)
def stamp(S: State, c: int, t_ns: int) -> int:
    """The 16-bit counter at `t_ns`; it stands at 0 outside time-triggered mode.

    The manual does not say when it starts: here at the entry into normal mode.
    """
    if not S[CAN_MCR + c] & TTCM:
        return 0
    elapsed = t_ns - S[CAN_EPOCH_NS + c]
    cycles = elapsed // NS * S[HZ] + elapsed % NS * S[HZ] // NS
    return cycles // bit_cycles(S, c) & 0xFFFF
