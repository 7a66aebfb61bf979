"""The dispatch of accesses: widths, what is unknown, resets."""

import pytest

from targets.mcu.state import UNMODELLED_MAX
from tests.targets.mcu.board import Board

GPIOC_ODR, GPIOC_MODER = 0x40020814, 0x40020800
AHB1RSTR = 0x40023810


@pytest.fixture
def board():
    return Board()


def test_narrow_reads_and_writes(board):
    """Bytes and half-words of a register are read and written in place."""
    board[GPIOC_MODER] = 0x12345678
    board.write(GPIOC_MODER + 2, 0xABCD, size=2)
    board.write(GPIOC_MODER, 0xEF, size=1)
    assert board[GPIOC_MODER] == 0xABCD56EF
    assert [board.read(GPIOC_MODER + k, size=1) for k in range(4)] == [0xEF, 0x56, 0xCD, 0xAB]
    assert board.read(GPIOC_MODER + 2, size=2) == 0xABCD


def test_unknown_registers_are_counted_up_to_a_limit(board):
    """Access to what no device knows reads as zero and is counted by address; the first ones are kept."""
    for k in range(UNMODELLED_MAX + 10):
        assert board[0x40010000 + 4 * k] == 0
    assert board.unmodelled == {0x40010000 + 4 * k for k in range(UNMODELLED_MAX)}


@pytest.mark.parametrize("address", [0x40010000, 0x50060800, 0xA0000000, 0xE0050000, 0x40007400, 0x40012000])
def test_absent_devices(board, address):
    """TIM1, the random number generator, the memory controller, the trace cell, DAC and ADC are not there."""
    board[address] = 1
    assert board[address] == 0
    assert board.unmodelled == {address}


def test_narrow_write_sets_one_interrupt_enable(board):
    """A byte written to NVIC's clear-enable register clears nothing beside it."""
    iser, icer = 0xE000E100, 0xE000E180
    board[iser] = 0xFFFF
    board.write(icer, 0x01, size=1)
    assert board[iser] == 0xFFFE


@pytest.mark.parametrize(
    ("reset", "bit", "register", "value"),
    [
        (0x40023810, 2, GPIOC_ODR, 1),
        (0x40023810, 12, 0x40023004, 7),
        (0x40023820, 0, 0x4000002C, 7),
        (0x40023820, 3, 0x40000C2C, 7),
        (0x40023820, 11, 0x40002C04, 0x55),
        (0x40023820, 17, 0x40004408, 7),
        (0x40023820, 18, 0x40004808, 7),
        (0x40023820, 19, 0x40004C08, 7),
        (0x40023820, 20, 0x40005008, 7),
        (0x40023820, 28, 0x40007000, 0x100),
        (0x40023824, 4, 0x40011008, 7),
        (0x40023824, 5, 0x40011408, 7),
        (0x40023824, 14, 0x40013808, 7),
    ],
)
def test_each_reset_bit_resets_its_device(board, reset, bit, register, value):
    """Each of RCC's reset bits puts one device back, the others not (sections 7.3.5 to 7.3.9)."""
    before = board[register]
    board[register] = value
    board[reset] = ~(1 << bit) & 0xFFFFFFFF & ~(3 << 25)
    board[reset] = 0
    board[register] = value
    assert board[register] == value != before
    board[reset] = 1 << bit
    assert board[register] == before


def test_reset_bits_act_as_they_rise(board):
    """A bit that stays set does not reset again what has been written since."""
    board[AHB1RSTR] = 4
    board[GPIOC_ODR] = 1
    board[AHB1RSTR] = 4 | 8
    assert board[GPIOC_ODR] == 1
