"""Bit-band aliases, by RM0090's section 2.3.3."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import bitband
from targets.mcu.machine import Stm32f405
from tests.targets.mcu.assembled import program

SIZES = st.sampled_from([1, 2, 4])
GPIOC_ODR, EXTI_PR, AHB1ENR = 0x40020814, 0x40013C14, 0x40023830


@pytest.fixture(scope="module")
def mcu():
    return Stm32f405(program("e7fe"))


def read(mcu, address, size=4):
    return int.from_bytes(mcu.read_bytes(address, size), "little")


def write(mcu, address, value, size=4):
    mcu._engine.mem_write(address, value.to_bytes(size, "little"))


@given(
    offset=st.integers(0, 0x1FFFF),
    bit=st.integers(0, 7),
    before=st.integers(0, 0xFFFFFFFF),
    value=st.integers(0, 255),
    size=SIZES,
)
def test_alias_of_memory_is_its_bit(mcu, offset, bit, before, value, size):
    """The word at 0x22000000 + 32 x byte + 4 x bit is that bit, whatever the size of the access; of what is
    written only bit 0 counts.
    """
    word, alias = 0x20000000 + (offset & ~3), 0x22000000 + 32 * offset + 4 * bit
    place = 8 * (offset & 3) + bit
    write(mcu, word, before)
    assert read(mcu, alias, size) == before >> place & 1
    write(mcu, alias, value, size)
    assert read(mcu, word) == before & ~(1 << place) | (value & 1) << place


@given(bit=st.integers(0, 15), before=st.integers(0, 0xFFFF), value=st.integers(0, 3), size=SIZES)
def test_alias_of_a_device_is_its_bit(mcu, bit, before, value, size):
    """The word at 0x42000000 + 32 x byte + 4 x bit is that bit of the register."""
    write(mcu, AHB1ENR, 4)
    write(mcu, GPIOC_ODR, before)
    alias = 0x42000000 + 32 * (GPIOC_ODR - 0x40000000) + 4 * bit
    assert read(mcu, alias, size) == before >> bit & 1
    write(mcu, alias, value, size)
    assert read(mcu, GPIOC_ODR) == before & ~(1 << bit) | (value & 1) << bit


def test_flags_cleared_by_ones_go_together(mcu):
    """A bit-band write reads the register and writes it back: flags that a one clears it clears all, as on
    silicon.
    """
    write(mcu, 0x40013C00, 3)  # EXTI_IMR
    write(mcu, 0x40013C10, 3)  # SWIER
    assert read(mcu, EXTI_PR) == 3
    write(mcu, 0x42000000 + 32 * (EXTI_PR - 0x40000000), 1)
    assert read(mcu, EXTI_PR) == 0


def test_aliases_cover_both_regions():
    """All of SRAM1 and SRAM2, and of the peripherals, has an alias."""
    for address, place in (
        (0x22000000, 0x20000000),
        (0x223FFFFC, 0x2001FFFC),
        (0x42000000, 0x40000000),
        (0x42FFFFFC, 0x4007FFFC),
    ):
        assert bitband.is_of_memory(address) ^ bitband.is_of_devices(address)
        assert bitband.place(address, 4) == place
