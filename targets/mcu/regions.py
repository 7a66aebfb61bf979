"""The address regions that devices answer in, and unicorn's callbacks for all of them.

A callback is told the offset in its region; which region that is, and whose state, says its user data: two
words of the state.
"""

from typing import Any

from numba import carray, types

from targets.jit import cfunc
from targets.mcu import bitband, identity, instants
from targets.mcu.native import pointer
from targets.mcu.peripherals import PERIPHERALS, PERIPHERALS_SIZE, SYSTEM, SYSTEM_SIZE, load, store
from targets.mcu.state import REGION, SELF, SIZE, State

_AHB2, _AHB2_SIZE = 0x50000000, 0x61000  # USB, camera, random numbers
_AHB3, _AHB3_SIZE = 0xA0000000, 0x1000  # external memory controller
REGIONS = (
    (PERIPHERALS, PERIPHERALS_SIZE),
    (SYSTEM, SYSTEM_SIZE),
    (_AHB2, _AHB2_SIZE),
    (_AHB3, _AHB3_SIZE),
    (identity.BASE, identity.SIZE),
    (bitband.SRAM_ALIAS, bitband.SRAM_ALIAS_SIZE),
    (bitband.DEVICES_ALIAS, bitband.DEVICES_ALIAS_SIZE),
)
"""Base and size."""


def user_data(S: State, region: int) -> int:
    """Address of the two words that tell a callback its state and its region's base."""
    S[REGION + 2 * region : REGION + 2 * region + 2] = (S[SELF], REGIONS[region][0])
    return int(S[SELF]) + 8 * (REGION + 2 * region)


@cfunc(types.uint64(types.voidptr, types.uint64, types.uint32, types.voidptr), cache=True)
def on_read(engine: Any, offset: int, size: int, user: Any) -> int:
    """uc_cb_mmio_read_t."""
    region = carray(user, (2,), types.int64)
    S = carray(pointer(region[0]), (SIZE,), types.int64)
    address, count = region[1] + types.int64(offset), types.int64(size)
    if bitband.is_of_memory(address):
        return bitband.bit(bitband.load_memory(S, address, count), address, count)
    at = bitband.place(address, count) if bitband.is_of_devices(address) else address
    instants.locate(S, address)
    value = load(S, at, count)
    instants.leave(S)
    return value if at == address else bitband.bit(value, address, count)


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.uint64, types.voidptr), cache=True)
def on_write(engine: Any, offset: int, size: int, value: int, user: Any) -> None:
    """uc_cb_mmio_write_t."""
    region = carray(user, (2,), types.int64)
    S = carray(pointer(region[0]), (SIZE,), types.int64)
    address, count, written = region[1] + types.int64(offset), types.int64(size), types.int64(value)
    if bitband.is_of_memory(address):
        before = bitband.load_memory(S, address, count)
        bitband.store_memory(S, address, count, bitband.changed(before, address, count, written))
        return
    instants.locate(S, address)
    if bitband.is_of_devices(address):
        at = bitband.place(address, count)
        written = bitband.changed(load(S, at, count), address, count, written)
        address = at
    store(S, address, count, written)
    instants.leave(S)
