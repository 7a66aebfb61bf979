"""Power controller, by RM0090's section 5.4."""

import pytest

from tests.targets.mcu.board import Board

CR, CSR = 0x40007000, 0x40007004


@pytest.fixture
def board():
    return Board()


def test_voltage_scale_1_after_reset(board):
    """VOS is set after reset, and the regulator ready (section 5.4.1)."""
    assert board[CR] == 1 << 14
    assert board[CSR] >> 14 & 1


def test_registers_keep_what_is_written(board):
    """DBP and VOS are stored; the bits that clear flags read as zero."""
    board[CR] = 1 << 8 | 0xC
    assert board[CR] == 1 << 8
    board[CSR] = 1 << 9 | 1 << 8
    assert board[CSR] == 1 << 14 | 1 << 9 | 1 << 8 | 1 << 3
    assert board.unmodelled == set()


@pytest.mark.parametrize("bit", [0, 1, 4, 9], ids=["LPDS", "PDDS", "PVDE", "FPDS"])
def test_low_power_modes_are_not_modelled(board, bit):
    """Stop and standby modes and the voltage detector are counted."""
    board[CR] |= 1 << bit
    assert board.unmodelled == {CR}
