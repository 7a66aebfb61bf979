"""Text in and out, from Python."""

import pytest

from targets.mcu import textlog
from tests.targets.mcu.board import Board

USART2 = 0x40004400


@pytest.fixture
def board():
    board = Board()
    board[USART2 + 8], board[USART2 + 12] = 16, 1 << 13 | 8
    return board


def test_lost_text_is_counted(board):
    """The log keeps the newest bytes and says how many it has lost."""
    for k in range(20_000):
        board[USART2 + 4] = k & 0xFF
        board.skip(160)
        board.read(USART2)
    log = textlog.log(board, "USART2")
    assert log.lost + len(log.data) == 19_999  # the last one is under way: the idle frame went first
    assert log.lost > 0
    assert log.data[-1] == 19_998 & 0xFF


def test_more_input_than_there_is_room_for(board):
    """Bytes that would be lost are refused."""
    textlog.feed(board, "USART2", bytes(4000))
    with pytest.raises(ValueError, match="200 bytes for USART2"):
        textlog.feed(board, "USART2", bytes(200))


@pytest.mark.parametrize("name", ["USART7", "ITM0", ""])
def test_no_such_log(board, name):
    """A name that is no port's is refused with those that are."""
    with pytest.raises(ValueError, match=f"no {name}, but USART1"):
        textlog.output(board, name)


def test_nothing_is_fed_to_itm(board):
    """ITM only sends."""
    with pytest.raises(ValueError, match="no ITM"):
        textlog.feed(board, "ITM", b"x")
