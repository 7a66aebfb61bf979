"""System configuration, by RM0090's section 9.2."""

import pytest

from tests.targets.mcu.board import Board

SYSCFG = 0x40013800


@pytest.fixture
def board():
    return Board()


def test_registers_keep_what_is_written(board):
    """PMC, EXTICR1 to 4 and CMPCR keep the bits they have; the compensation cell is ready at once."""
    for offset in range(4, 0x18, 4):
        board[SYSCFG + offset] = 0xFFFFFFFF
    board[SYSCFG + 0x20] = 1
    assert [board[SYSCFG + k] for k in range(4, 0x18, 4)] == [1 << 23] + [0xFFFF] * 4
    assert board[SYSCFG + 0x20] == 0x101
    assert board.unmodelled == set()


def test_other_memory_at_zero_is_not_modelled(board):
    """MEMRMP that maps something else than main flash is counted (section 9.2.1)."""
    board[SYSCFG] = 0
    assert board.unmodelled == set()
    board[SYSCFG] = 3
    assert board[SYSCFG] == 3
    assert board.unmodelled == {SYSCFG}


def test_gaps_are_not_modelled(board):
    """There is no register between EXTICR4 and CMPCR."""
    board[SYSCFG + 0x18] = 1
    assert board[SYSCFG + 0x1C] == 0
    assert board.unmodelled == {SYSCFG + 0x18, SYSCFG + 0x1C}
