"""Device events."""

from targets.mcu import events
from tests.targets.mcu.board import Board


def test_nothing_is_due_after_reset():
    """No device has anything to do of its own accord after reset."""
    assert events.due(Board().state) == events.NEVER


def test_the_earliest_event_comes_first():
    """With several devices under way the run loop is called for each in its turn."""
    board = Board()
    board[0x40000010 - 4], board[0x4000002C] = 1, 49_999  # TIM2: UIE, every 50,000
    board[0x40000014] = 1
    board[0x40000010] = 0
    board[0x40002C00] = 0x80 | 0x41  # WWDG: early wake-up after 4096
    board[0x40000000] = 1
    assert events.due(board.state) == 4096
    board.skip(4096)
    events.service(board.state)
    board[0x40002C00] = 0x7F
    assert events.due(board.state) == 50_001
