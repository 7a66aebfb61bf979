"""Instrumentation trace, by ARMv7-M C1.7."""

import pytest

from targets.mcu import textlog
from tests.targets.mcu.board import Board

PORT, TER, TPR, TCR, LAR, LSR = 0xE0000000, 0xE0000E00, 0xE0000E40, 0xE0000E80, 0xE0000FB0, 0xE0000FB4
DEMCR = 0xE000EDFC


@pytest.fixture
def board():
    return Board()


def enable(board):
    board[DEMCR] = 1 << 24
    board[LAR] = 0xC5ACCE55
    board[TCR] = 1
    board[TER] = 1


def test_text_of_port_0(board):
    """Bytes, half-words and words written to port 0 come out in order; other ports are kept apart."""
    enable(board)
    board[TER] = 3
    board.write(PORT, 0x41, size=1)
    board.write(PORT, 0x4342, size=2)
    board.write(PORT + 4, 0x58, size=1)
    board.skip(16_000)
    board[PORT] = 0x47464544
    log = textlog.log(board, "ITM")
    assert log.data.tobytes() == b"ABCDEFG"
    assert log.ns.tolist() == [0, 0, 0] + [1_000_000] * 4


def test_port_says_whether_it_is_ready(board):
    """A stimulus port reads as FIFOREADY: 1 if it is on (C1.7.3)."""
    assert board[PORT] == 0
    enable(board)
    assert (board[PORT], board[PORT + 4]) == (1, 0)


@pytest.mark.parametrize(
    ("register", "value"), [(DEMCR, 0), (TCR, 0), (TER, 2)], ids=["TRCENA", "ITMENA", "TER"]
)
def test_each_switch_is_needed(board, register, value):
    """TRCENA, ITMENA and the port's bit in TER must be set (C1.7.3)."""
    enable(board)
    board[register] = value
    board.write(PORT, 0x41, size=1)
    assert textlog.output(board, "ITM") == b""
    assert board[PORT] == 0


def test_lock(board):
    """Control registers take writes only after the key in LAR (C1.7.3)."""
    board[TCR] = board[TER] = board[TPR] = 1
    assert (board[TCR], board[TER], board[TPR], board[LSR]) == (0, 0, 0, 3)
    board[LAR] = 0xC5ACCE55
    board[TCR] = board[TER] = board[TPR] = 1
    assert (board[TCR], board[TER], board[TPR], board[LSR]) == (1, 1, 1, 1)
    board[LAR] = 0
    board[TER] = 3
    assert board[TER] == 1


def test_trace_port_can_be_set_up(board):
    """The trace port's registers that start-up code writes keep their values (C1.10)."""
    values = {0xE0040004: 1, 0xE0040010: 7, 0xE00400F0: 2, 0xE0040304: 0x100}
    for address, value in values.items():
        board[address] = value
    assert {address: board[address] for address in values} == values
    assert board.unmodelled == set()
    assert board[0xE0040000] == 0
    assert board.unmodelled == {0xE0040000}
