"""The memory-mapped world: which device answers at which address, as unicorn's callbacks.

An access that no device knows reads as zero, changes nothing, and is counted by address.
"""

from typing import Any

from numba import carray, types

from targets.jit import cfunc, njit
from targets.mcu import bxcan, flash, gpio, nvic, rcc, scs
from targets.mcu.state import SIZE, UNMODELLED, UNMODELLED_MAX, State

PERIPHERALS = 0x40000000
PERIPHERALS_SIZE = 0x80000
SYSTEM = 0xE0000000
SYSTEM_SIZE = 0x100000

_READ = types.uint64(types.voidptr, types.uint64, types.uint32, types.voidptr)
_WRITE = types.void(types.voidptr, types.uint64, types.uint32, types.uint64, types.voidptr)


@njit(cache=True)
def count_unmodelled(S: State, address: int) -> None:
    """One more access to an address that nothing answers at; the list keeps the first addresses."""
    entries = S[UNMODELLED]
    for k in range(entries):
        if S[UNMODELLED + 1 + 2 * k] == address:
            S[UNMODELLED + 2 + 2 * k] += 1
            return
    if entries < UNMODELLED_MAX:
        S[UNMODELLED + 1 + 2 * entries] = address
        S[UNMODELLED + 2 + 2 * entries] = 1
        S[UNMODELLED] = entries + 1


@njit(cache=True)
def _read_word(S: State, address: int) -> int:
    value = -1
    if bxcan.BASE <= address < bxcan.BASE + bxcan.SIZE:
        value = bxcan.read(S, address - bxcan.BASE)
    elif gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS:
        value = gpio.read(S, address - gpio.BASE)
    elif rcc.BASE <= address < rcc.BASE + 0x400:
        value = rcc.read(S, address - rcc.BASE)
    elif flash.BASE <= address < flash.BASE + 0x400:
        value = flash.read(S, address - flash.BASE)
    elif 0xE000E100 <= address < 0xE000E500:
        value = nvic.read(S, address - 0xE000E100)
    elif address >= SYSTEM:
        value = scs.read(S, address)
    if value < 0:
        count_unmodelled(S, address)
        return 0
    return value & 0xFFFFFFFF


@njit(cache=True)
def _write_word(S: State, address: int, value: int) -> None:
    known = False
    if bxcan.BASE <= address < bxcan.BASE + bxcan.SIZE:
        known = bxcan.write(S, address - bxcan.BASE, value)
    elif gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS:
        known = gpio.write(S, address - gpio.BASE, value)
    elif rcc.BASE <= address < rcc.BASE + 0x400:
        known = rcc.write(S, address - rcc.BASE, value)
    elif flash.BASE <= address < flash.BASE + 0x400:
        known = flash.write(S, address - flash.BASE, value)
    elif 0xE000E100 <= address < 0xE000E500:
        known = nvic.write(S, address - 0xE000E100, value)
    elif address >= SYSTEM:
        known = scs.write(S, address, value)
    if not known:
        count_unmodelled(S, address)


@njit(cache=True)
def load(S: State, address: int, size: int) -> int:
    """Read `size` bytes at `address`."""
    word = _read_word(S, address & ~3)
    return word >> (8 * (address & 3)) & ((1 << (8 * size)) - 1)


@njit(cache=True)
def store(S: State, address: int, size: int, value: int) -> None:
    """Write `size` bytes at `address`; the rest of the word is what it reads as."""
    if size < 4:
        shift = 8 * (address & 3)
        mask = ((1 << (8 * size)) - 1) << shift
        # BSRR reads as nothing: a half-word write there must not bring anything with it.
        before = 0 if _is_bsrr(address) else _read_word(S, address & ~3)
        value = before & ~mask | value << shift & mask
    _write_word(S, address & ~3, value)


@njit(cache=True)
def _is_bsrr(address: int) -> bool:
    return gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS and address & 0x3FC == 0x18


@cfunc(_READ, cache=True)
def on_peripheral_read(engine: Any, offset: int, size: int, user: Any) -> int:
    """uc_cb_mmio_read_t of the peripherals' region."""
    S = carray(user, (SIZE,), types.int64)
    return load(S, PERIPHERALS + types.int64(offset), types.int64(size))


@cfunc(_WRITE, cache=True)
def on_peripheral_write(engine: Any, offset: int, size: int, value: int, user: Any) -> None:
    """uc_cb_mmio_write_t of the peripherals' region."""
    S = carray(user, (SIZE,), types.int64)
    store(S, PERIPHERALS + types.int64(offset), types.int64(size), types.int64(value))


@cfunc(_READ, cache=True)
def on_system_read(engine: Any, offset: int, size: int, user: Any) -> int:
    """uc_cb_mmio_read_t of the private peripheral bus."""
    S = carray(user, (SIZE,), types.int64)
    return load(S, SYSTEM + types.int64(offset), types.int64(size))


@cfunc(_WRITE, cache=True)
def on_system_write(engine: Any, offset: int, size: int, value: int, user: Any) -> None:
    """uc_cb_mmio_write_t of the private peripheral bus."""
    S = carray(user, (SIZE,), types.int64)
    store(S, SYSTEM + types.int64(offset), types.int64(size), types.int64(value))
