"""Bit-band aliases (ARMv7-M B3.1, RM0090 section 2.3.3): each bit of a region as a word of its own.

An access to the alias is one of its own size to the place that holds the bit; a write reads before.
"""

from targets.jit import njit
from targets.mcu import memory, native
from targets.mcu.state import State

SRAM, SRAM_ALIAS, SRAM_ALIAS_SIZE = 0x20000000, 0x22000000, 32 * 0x20000
DEVICES, DEVICES_ALIAS, DEVICES_ALIAS_SIZE = 0x40000000, 0x42000000, 32 * 0x80000


@njit(cache=True)
def is_of_memory(address: int) -> bool:
    """In SRAM's alias."""
    return SRAM_ALIAS <= address < SRAM_ALIAS + SRAM_ALIAS_SIZE


@njit(cache=True)
def is_of_devices(address: int) -> bool:
    """In the peripherals' alias."""
    return DEVICES_ALIAS <= address < DEVICES_ALIAS + DEVICES_ALIAS_SIZE


@njit(cache=True)
def place(address: int, size: int) -> int:
    """The address that an access of `size` bytes to an alias goes to: 32 x byte + 4 x bit in the region."""
    region = SRAM if is_of_memory(address) else DEVICES
    return region + ((address & 0x1FFFFFF) >> 5 & ~(size - 1))


@njit(cache=True)
def bit(value: int, address: int, size: int) -> int:
    """Which value the alias reads as, `value` being at its place."""
    return value >> (address >> 2 & (8 * size - 1)) & 1


@njit(cache=True)
def changed(value: int, address: int, size: int, to: int) -> int:
    """`value` with the bit of the alias set to the lowest bit of `to`."""
    mask = 1 << (address >> 2 & (8 * size - 1))
    return value & ~mask | (mask if to & 1 else 0)


@njit(cache=True)
def load_memory(S: State, address: int, size: int) -> int:
    """What lies at the place of an alias of SRAM."""
    at = place(address, size)
    return max(memory.word(S, at & ~3), 0) >> 8 * (at & 3) & (1 << 8 * size) - 1


@njit(cache=True)
def store_memory(S: State, address: int, size: int, value: int) -> None:
    """Write to the place of an alias of SRAM."""
    at = place(address, size)
    host = memory.writable(S, at & ~3, 4)
    if host:
        shift = 8 * (at & 3)
        mask = (1 << 8 * size) - 1 << shift
        native.poke(host, native.peek(host) & ~mask | value << shift & mask)
