"""Devices without their clock."""

import pytest

from targets.mcu import gating
from targets.mcu.state import RCC_ENABLE, allocate
from tests.targets.mcu.board import Board

AHB1ENR, GPIOD_ODR = 0x40023830, 0x40020C14


@pytest.fixture
def board():
    return Board(clocks=False)


def test_unclocked_device_reads_zero_and_ignores_writes(board):
    """RM0090 section 7.3.10: without its clock a peripheral's registers cannot be accessed."""
    board[GPIOD_ODR] = 5
    assert board[GPIOD_ODR] == 0
    assert gating.unclocked(board.state) == {"GPIOD": 2}
    assert board.unmodelled == set()
    board[AHB1ENR] |= 1 << 3
    assert board[GPIOD_ODR] == 0
    board[GPIOD_ODR] = 5
    assert board[GPIOD_ODR] == 5
    assert gating.unclocked(board.state) == {"GPIOD": 2}


def test_narrow_write_counts_once(board):
    """A half-word written to a device without clock is one access."""
    board.write(GPIOD_ODR, 1, size=2)
    assert gating.unclocked(board.state) == {"GPIOD": 1}


@pytest.mark.parametrize("base", gating.DEVICES, ids=[name for name, _, _ in gating.DEVICES.values()])
def test_each_device_has_its_own_bit(base):
    """Each device answers with its own enable bit alone (sections 7.3.10 to 7.3.14)."""
    name, register, bit = gating.DEVICES[base]
    S = allocate()
    S[RCC_ENABLE : RCC_ENABLE + 6] = 0xFFFFFFFF
    S[RCC_ENABLE + register] &= ~(1 << bit)
    answering = {n for at, (n, _, _) in gating.DEVICES.items() if gating.answers(S, at + 0x3FC)}
    assert answering == {n for n, _, _ in gating.DEVICES.values()} - {name}


def test_what_has_no_enable_bit_always_answers(board):
    """RCC, EXTI, the watchdog on the LSI and the core's own bus need no enable bit."""
    for address in (0x40023800, 0x40013C00, 0x40003000, 0xE000E100, 0x1FFF7A10):
        assert gating.answers(board.state, address)
